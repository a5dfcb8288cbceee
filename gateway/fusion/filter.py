"""The error-state filter: strapdown between fixes, gated updates at them, freeing a lock-out."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy.special
from numpy.typing import NDArray

from gateway.fusion import robust
from gateway.fusion.kalman import (
    Linearised,
    innovation_covariance,
    normalised_square,
    update,
)
from gateway.fusion.observation import Model, observe
from gateway.fusion.restart import forget
from gateway.fusion.state import ATT, POS, VEL, State
from gateway.messages import Component, Fix, Innovation
from gateway.nav import strapdown
from gateway.nav.earth import C_en, ecef_to_lla
from gateway.timeline import Track

Array = NDArray[np.float64]

LOCK_OUT = 8
"""Fixes refused in a row after which the filter doubts itself, not the fixes."""
FREED = 3
"""Fixes used in a row after which it trusts itself again."""
JUMP = ((ATT, 0.5), (VEL, 1.0), (POS, 9.0))
"""Variance that a refusal adds meanwhile to each part of the pose, relative to what it has.

Independent of everything else: scaled together with its correlations, an error in position would
be paid for by velocity, attitude and the instruments' constants.
"""
GATE_MAX_HEADING_SD = np.radians(5.0)
"""The gate stays open while the heading is known worse than this: it would lock out good fixes."""
MISSING = 7
"""Column of the samples that says for how long (s) a sample stands in for lost ones."""
LONG_GAP_S = 2.0
"""Longest gap in which it may: after more the vehicle has moved unseen."""
CAREFUL_PARTS = 30
"""Parts in which a fix is used while the estimate may be far off, each linearised anew."""


@dataclass
class Memory:
    """All of the filter that time changes; a copy of it is a snapshot."""

    state: State
    used: int = 0
    gated: int = 0
    refused_in_a_row: int = 0
    """Once over `LOCK_OUT`, used fixes count it down before it is forgotten."""
    t_used_ns: int | None = None
    quality: dict[str, tuple[int, float]] = field(default_factory=dict)
    """By beacon, see `gateway.fusion.robust`."""
    noise: dict[str, float] = field(default_factory=dict)
    """By device and row, see `gateway.fusion.robust`."""
    origin_e: Array | None = None
    """(3,) local origin of the invariant errors; None is where the filter starts."""

    def copy(self) -> Self:
        """Independent copy."""
        noise, quality = self.noise.copy(), self.quality.copy()
        return replace(self, state=self.state.copy(), noise=noise, quality=quality)


@dataclass
class Filter:
    """The engine that `gateway.timeline` drives."""

    model: Model
    memory: Memory
    origin_e: Array = field(init=False)

    def __post_init__(self) -> None:
        origin_e = self.memory.origin_e
        self.origin_e = self.memory.state.r_e.copy() if origin_e is None else origin_e

    def advance(self, rows: Array, track: Array) -> None:
        """Carry the state over whole samples."""
        state, begin = self.memory.state, 0
        for k in np.flatnonzero(rows[:, MISSING] > LONG_GAP_S).tolist():
            strapdown.run(state.x, state.P, rows[begin:k], self.model.q, track[begin:k])
            self._lose_sight(float(rows[k, 0]))
            self.mark(track[k])
            begin = k + 1
        strapdown.run(state.x, state.P, rows[begin:], self.model.q, track[begin:])

    def advance_part(self, row: Array, begin: float, end: float) -> None:
        """Carry the state over a share of one sample."""
        state = self.memory.state
        if row[MISSING] > LONG_GAP_S:
            self._lose_sight((end - begin) * float(row[0]))
        else:
            strapdown.advance(state.x, state.P, row, begin, end, self.model.q)

    def _lose_sight(self, away_s: float) -> None:
        """Let the pose go on unseen.  # (M.135)-(M.138)"""
        x, before = self.memory.state.x, self.memory.state.r_e.copy()
        forget(x, self.memory.state.P, away_s)
        x[strapdown.S_E] += x[strapdown.R_E] - before
        x[strapdown.LAST] = 0.0  # no sample goes before the next one

    def mark(self, track: Array) -> None:
        """Write displacement and attitude chain of the present."""
        track[:] = self.memory.state.x[strapdown.S_E.start : strapdown.CHAIN.stop]

    def save(self) -> Memory:
        """Copy what time changes."""
        return self.memory.copy()

    def restore(self, saved: Memory) -> None:
        """Go back to a copy, which stays as it is."""
        self.memory = saved.copy()

    def apply(self, fix: Fix, track: Track) -> Innovation:
        """Use one fix at its time, or say why not."""
        z = self._observe(fix, track)
        if isinstance(z, str):
            return self._refuse(fix, z)
        S = innovation_covariance(self.memory.state.P, z)
        nis = normalised_square(z.residual, S)
        if not (nis >= 0.0 and S.diagonal().min() > 0.0):  # not finite, or not positive
            self.memory.state.P[:] = np.nan  # so that nothing is claimed until a new start
            return self._refuse(fix, "fault")
        inside = nis <= scipy.special.chdtri(len(z.residual), 1.0 - self.model.gate)
        accepted = bool(inside or self._gate_is_open())
        quality = self._judge(fix, nis, len(z.residual))
        if accepted:
            self._use(z, S, nis, fix, track)
        else:
            self._doubt(fix)
        reason = "" if accepted else "gate"
        components = _components(z, S)
        return Innovation(
            fix.t_ns, fix.device, fix.beacon, components, nis, accepted, reason, quality
        )

    def _observe(self, fix: Fix, track: Track) -> Linearised | str:
        """Linearise a fix with the noise that its device has shown."""
        z = observe(self.model, self.memory.state, fix, track)
        return z if isinstance(z, str) else robust.rescaled(z, fix.device, self.memory.noise)

    def _judge(self, fix: Fix, nis: float, rows: int) -> float | None:
        """Quality of the beacon with this fix; None where there is no beacon."""
        if not fix.beacon:
            return None
        quality = self.memory.quality
        heard = robust.updated_quality(quality.get(fix.beacon, (0, 0.0)), nis, rows)
        quality[fix.beacon] = heard
        return heard[1]

    def _use(self, z: Linearised, S: Array, nis: float, fix: Fix, track: Track) -> None:
        """Update by a fix; in small parts while the estimate may be far off.  # (M.36)"""
        memory = self.memory
        locked_out = memory.refused_in_a_row > LOCK_OUT
        careful = locked_out or self._gate_is_open()
        parts = CAREFUL_PARTS if careful else 1
        weakening = 1.0 if careful else robust.inflation(self.model.robust, nis, len(z.residual))
        update(memory.state, _weakened(z, parts * weakening), self.model.error, self.origin_e)
        for _ in range(1, parts):
            again = self._observe(fix, track)
            if not isinstance(again, str):
                update(memory.state, _weakened(again, parts), self.model.error, self.origin_e)
        if self.model.adaptive_noise and not careful:
            robust.learn_noise(memory.noise, fix.device, z, S)
        memory.used += 1
        if fix.locates:
            memory.t_used_ns = fix.t_ns
            self._trust(locked_out)

    def _trust(self, locked_out: bool) -> None:
        """Count a used fix towards the end of a lock-out."""
        memory = self.memory
        if locked_out:
            memory.refused_in_a_row = min(memory.refused_in_a_row, LOCK_OUT + FREED) - 1
        if memory.refused_in_a_row <= LOCK_OUT:
            memory.refused_in_a_row = 0

    def _doubt(self, fix: Fix) -> None:
        """Count a refused fix and free a filter that is locked out.  # (M.37)

        Only what locates the vehicle tells of a lock-out: anything else agrees with a wrong place.
        """
        memory = self.memory
        memory.gated += 1
        memory.refused_in_a_row += fix.locates
        if fix.locates and memory.refused_in_a_row > LOCK_OUT:
            for part, share in JUMP:
                block = memory.state.P[part, part]
                block += share * np.trace(block) / 3.0 * np.eye(3)

    def _gate_is_open(self) -> bool:
        """Whether the heading is too uncertain for a linearised gate to be just."""
        state = self.memory.state
        lat, lon, _ = ecef_to_lla(state.r_e)
        down = C_en(lat, lon)[:, 2]
        return bool(down @ state.P[ATT, ATT] @ down > GATE_MAX_HEADING_SD**2)

    def _refuse(self, fix: Fix, reason: str) -> Innovation:
        """Verdict on a fix that cannot be used."""
        self.memory.gated += 1
        return Innovation(fix.t_ns, fix.device, fix.beacon, (), float("nan"), False, reason)


def _weakened(z: Linearised, parts: float) -> Linearised:
    """The measurement with so much noise that `parts` of it weigh as much as the whole."""
    return replace(z, R=z.R * parts)


def _components(z: Linearised, S: Array) -> tuple[Component, ...]:
    """Rows of an innovation in edge units: measured minus predicted, degrees and metres."""
    out = []
    for name, residual, variance in zip(z.names, z.residual, S.diagonal(), strict=True):
        unit = np.degrees(1.0) if name.endswith("_deg") else 1.0
        out.append(Component(name, float(-residual * unit), float(np.sqrt(variance) * unit)))
    return tuple(out)
