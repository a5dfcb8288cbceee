"""The error-state filter: strapdown between fixes, gated updates at them, freeing a lock-out."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy.special
from numpy.typing import NDArray

from gateway.fusion import usbl
from gateway.fusion.errors import ErrorDefinition
from gateway.fusion.kalman import (
    Linearised,
    innovation_covariance,
    normalised_square,
    update,
)
from gateway.fusion.state import ATT, State
from gateway.messages import Component, Innovation, UsblFix
from gateway.nav import strapdown
from gateway.nav.earth import C_en, ecef_to_lla
from gateway.timeline import Track

Array = NDArray[np.float64]

LOCK_OUT = 8
"""Fixes refused in a row after which each further refusal doubles the covariance."""
GATE_MAX_HEADING_SD = np.radians(5.0)
"""The gate stays open while the heading is known worse than this: it would lock out good fixes."""


@dataclass(frozen=True)
class Transponder:
    """A moored beacon: ECEF position, turn-around time, and whether its range is two-way."""

    r_e: Array
    turnaround_s: float
    two_way: bool


@dataclass(frozen=True)
class AcousticArray:
    """An array of the vehicle: geometry and white noise of elevation, bearing (rad), range (m)."""

    geometry: usbl.ArrayGeometry
    sigma: Array


@dataclass(frozen=True)
class Model:
    """All that the filter takes as known.

    Attributes
    ----------
    error
        The error definition in whose coordinates updates are made.
    q
        (4,) noise densities of the IMU, see `gateway.nav.strapdown.predict`.
    gate
        Probability inside the chi-squared gate.
    """

    error: ErrorDefinition
    q: Array
    gate: float
    sound_speed: float
    arrays: dict[str, AcousticArray]
    beacons: dict[str, Transponder]


@dataclass
class Memory:
    """All of the filter that time changes; a copy of it is a snapshot."""

    state: State
    used: int = 0
    gated: int = 0
    refused_in_a_row: int = 0
    t_used_ns: int | None = None

    def copy(self) -> Self:
        """Independent copy."""
        return replace(self, state=self.state.copy())


@dataclass
class Filter:
    """The engine that `gateway.timeline` drives.

    The local origin of the invariant errors is where the filter started.
    """

    model: Model
    memory: Memory
    origin_e: Array = field(init=False)

    def __post_init__(self) -> None:
        self.origin_e = self.memory.state.r_e.copy()

    def advance(self, rows: Array, track: Array) -> None:
        """Carry the state over whole samples."""
        state = self.memory.state
        strapdown.run(state.x, state.P, rows, self.model.q, track)

    def advance_part(self, row: Array, begin: float, end: float) -> None:
        """Carry the state over a share of one sample."""
        state = self.memory.state
        strapdown.advance(state.x, state.P, row, begin, end, self.model.q)

    def mark(self, track: Array) -> None:
        """Write displacement and attitude chain of the present."""
        track[:] = self.memory.state.x[strapdown.S_E.start : strapdown.CHAIN.stop]

    def save(self) -> Memory:
        """Copy what time changes."""
        return self.memory.copy()

    def restore(self, saved: Memory) -> None:
        """Go back to a copy, which stays as it is."""
        self.memory = saved.copy()

    def apply(self, fix: UsblFix, track: Track) -> Innovation:
        """Use one fix at its time, or say why not."""
        array, beacon = self.model.arrays[fix.device], self.model.beacons.get(fix.beacon)
        if beacon is None:
            return self._refuse(fix, "unknown_beacon")
        sight = self._sighting(fix, array, beacon, track)
        z = usbl.linearise(self.memory.state, array.geometry, sight)
        if z is None:
            return self._refuse(fix, "geometry")
        S = innovation_covariance(self.memory.state.P, z)
        nis = normalised_square(z.residual, S)
        inside = nis <= scipy.special.chdtri(len(z.residual), 1.0 - self.model.gate)
        accepted = bool(inside or self._gate_is_open())
        self._learn(fix, z, accepted)
        reason = "" if accepted else "gate"
        return Innovation(
            fix.t_ns, fix.device, fix.beacon, _components(sight, z, S), nis, accepted, reason
        )

    def _learn(self, fix: UsblFix, z: Linearised, accepted: bool) -> None:
        """Update by an accepted fix; count a refused one and free a filter that is locked out."""
        memory = self.memory
        if accepted:
            update(memory.state, z, self.model.error, self.origin_e)
            memory.used += 1
            memory.refused_in_a_row = 0
            memory.t_used_ns = fix.t_ns
            return
        memory.gated += 1
        memory.refused_in_a_row += 1
        if memory.refused_in_a_row > LOCK_OUT:
            memory.state.P *= 2.0

    def _gate_is_open(self) -> bool:
        """Whether the heading is too uncertain for a linearised gate to be just."""
        state = self.memory.state
        lat, lon, _ = ecef_to_lla(state.r_e)
        down = C_en(lat, lon)[:, 2]
        return bool(down @ state.P[ATT, ATT] @ down > GATE_MAX_HEADING_SD**2)

    def _sighting(
        self, fix: UsblFix, array: AcousticArray, beacon: Transponder, track: Track
    ) -> usbl.Sighting:
        """Measured rows, noise and the moment the ping left."""
        rows = (fix.elevation, fix.bearing, fix.slant_range)
        measured = np.array([np.nan if v is None else v for v in rows])
        transmit = None
        if beacon.two_way and fix.slant_range is not None:
            age = 2.0 * fix.slant_range / self.model.sound_speed + beacon.turnaround_s
            past = track.at(fix.t_ns - round(age * 1e9))
            transmit = usbl.Past(past[:3], past[3:].reshape(3, 3), age)
        return usbl.Sighting(measured, array.sigma, beacon.r_e, transmit)

    def _refuse(self, fix: UsblFix, reason: str) -> Innovation:
        """Verdict on a fix that cannot be used."""
        self.memory.gated += 1
        return Innovation(fix.t_ns, fix.device, fix.beacon, (), float("nan"), False, reason)


def _components(sight: usbl.Sighting, z: Linearised, S: Array) -> tuple[Component, ...]:
    """Rows of an innovation in edge units: measured minus predicted, degrees and metres."""
    names = [n for n, v in zip(usbl.ROW_NAMES, sight.measured, strict=True) if not np.isnan(v)]
    out = []
    for name, residual, variance in zip(names, z.residual, S.diagonal(), strict=True):
        unit = np.degrees(1.0) if name.endswith("_deg") else 1.0
        out.append(Component(name, float(-residual * unit), float(np.sqrt(variance) * unit)))
    return tuple(out)


def warm_up() -> None:
    """Compile or load the hot loop, so that the first sample does not wait for it."""
    x, P, rows, track = np.zeros(46), np.zeros((21, 21)), np.zeros((1, 8)), np.zeros((1, 12))
    x[[0, 4, 8]] = 1.0
    x[12] = 6.4e6
    rows[:, 0] = 0.005
    strapdown.run(x, P, rows, np.zeros(4), track)
    strapdown.advance(x, P, rows[0], 0.0, 1.0, np.zeros(4))
