"""The error-state filter: strapdown between fixes, gated updates at them."""

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.special
from numpy.typing import NDArray

from gateway.engine import Track
from gateway.fusion import echo, robust, target
from gateway.fusion.doubt import is_locked_out, note_refused, note_used, trusts_velocity_again
from gateway.fusion.errors import FAMILY, ErrorDefinition
from gateway.fusion.kalman import Linearised, innovation_covariance, normalised_square, update
from gateway.fusion.memory import Memory
from gateway.fusion.observation import Model, error_for, observe, place, settled
from gateway.fusion.report import components_of
from gateway.fusion.restart import forget
from gateway.fusion.state import ATT, POS, VEL
from gateway.messages import Acoustic, Fix, Innovation, UsblFix, Vec3, Verdict
from gateway.modes import KNOWN_HEADING_SD
from gateway.nav import strapdown
from gateway.nav.earth import C_en, ecef_to_lla

Array = NDArray[np.float64]

GATE_MAX_HEADING_SD = np.radians(30.0)
"""The gate stays open while it is known worse than this: it would lock out good fixes."""
DRIFT = FAMILY["additive"]
"""The error that a place has after long without fixes: it was not turned by that of the heading."""
MISSING = 7
"""Column of the samples that says for how long (s) a sample stands in for lost ones."""
LONG_GAP_S = 2.0
"""Longest gap in which it may: after more the vehicle has moved unseen."""
CAREFUL_PARTS = 30
"""Parts in which a fix is used while the estimate may be far off, each linearised anew."""
STRAIGHT = 0.2
"""By how much of its sigma a fix may bend on the way of an update and count as straight."""
LOOKS = 8
"""How often a fix that bends is looked at again."""
LOST = 0.3
"""Uncertainty over the range from which on a fix gives the place, and angles are not linear."""
ANYWHERE, ANY_VELOCITY = 30.0, 10.0
"""What is added to a place (over the range) and velocity (m/s) that are to be forgotten."""


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
        begin = 0
        # Of one sample, mostly: no work for numpy.
        for k in (k for k, s in enumerate(rows[:, MISSING].tolist()) if s > LONG_GAP_S):
            self._carry(rows[begin:k], track[begin:k])
            self._lose_sight(rows[k], 0.0, 1.0)
            self.mark(track[k])
            begin = k + 1
        self._carry(rows[begin:], track[begin:])

    def advance_part(self, row: Array, begin: float, end: float) -> None:
        """Carry the state over a share of one sample."""
        if row[MISSING] > LONG_GAP_S:
            self._lose_sight(row, begin, end)
        else:
            self._carry_part(row, begin, end)

    def _carry(self, rows: Array, track: Array) -> None:
        """Run over whole samples none of which stands in for a long gap."""
        state = self.memory.state
        strapdown.run(state.x, state.P, rows, self.model.q, track)

    def _carry_part(self, row: Array, begin: float, end: float) -> None:
        """Run over a share of one."""
        state = self.memory.state
        strapdown.advance(state.x, state.P, row, begin, end, self.model.q)

    def _lose_sight(self, row: Array, begin: float, end: float) -> None:
        """Let the pose go on unseen over a share of a long gap.  # (M.135)-(M.138)"""
        x, before = self.memory.state.x, self.memory.state.r_e.copy()
        forget(x, self.memory.state.P, (end - begin) * float(row[0]))
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

    def apply(self, fix: Fix, track: Track) -> Verdict:
        """Use one fix at its time, or say why not; one of a target tells where that was."""
        if fix.beacon in self.model.targets:
            return self._sight(fix, track)
        own = settled(self.model, self.memory.state, fix)
        found = None if isinstance(own, str) else self._found(own, track)
        z = found or (own if isinstance(own, str) else self._observe(own, track))
        if isinstance(own, str) or isinstance(z, str):
            return self._refuse(fix, str(z))
        fix = own
        S = innovation_covariance(self.memory.state.P, z)
        nis = normalised_square(z.residual, S)
        if not (nis >= 0.0 and S.diagonal().min() > 0.0):  # not finite, or not positive
            self.memory.state.P[:] = np.nan  # so that nothing is claimed until a new start
            return self._refuse(fix, "fault")
        inside = nis <= scipy.special.chdtri(len(z.residual), 1.0 - self.model.gate)
        accepted = bool(inside or (found is None and self._gate_is_open(fix)))
        quality = self._judge(fix, nis, len(z.residual))
        doubted_e = self.memory.state.r_e.copy() if is_locked_out(self.memory) else None
        if accepted and found is not None and self.knows_heading():
            self._update(found, DRIFT)
            note_used(self.memory, fix)
        elif accepted:
            self._use(z, S, nis, fix, track)
        else:
            note_refused(self.memory, fix, z)
        reason = "" if accepted else "gate"
        moved = self._moved_from(doubted_e) if accepted and fix.locates else None
        heard = fix.t_ns, fix.device, fix.beacon, components_of(z, S)
        return Innovation(*heard, nis, accepted, reason, quality, moved)

    def _moved_from(self, before_e: Array | None) -> Vec3 | None:
        """How far the place has gone, north, east, down (m); None from nowhere."""
        if before_e is None:
            return None
        lat, lon, _ = ecef_to_lla(before_e)
        north, east, down = (C_en(lat, lon).T @ (self.memory.state.r_e - before_e)).tolist()
        return north, east, down

    def _sight(self, fix: Fix, track: Track) -> Verdict:
        """Tell a target's place: it says nothing of our own, and the gate knows nothing of it."""
        found, state = None, self.memory.state
        own = settled(self.model, state, fix)
        if isinstance(own, UsblFix) and own.device in self.model.arrays:
            found = target.sighting(self.model, state, own, track)
        return found or Innovation(
            fix.t_ns, fix.device, fix.beacon, (), float("nan"), False, "target"
        )

    def _found(self, fix: Fix, track: Track) -> Linearised | None:
        """The place that a fix gives where that, and not all of the heading, is lost.  # (M.140)

        Angles from a place that is far off are not linear, and the gate would refuse them.
        """
        if self._lost_at(fix) is None or self._heading_variance() > GATE_MAX_HEADING_SD**2:
            return None
        return place(replace(self.model, error=DRIFT), self.memory.state, fix, track)

    def _lost_at(self, fix: Fix) -> float | None:
        """Range (m) of a fix that tells of a place of which far less is known."""
        sound = fix.slant_range if isinstance(fix, UsblFix) else None
        far = sound is not None and _is_far(self.memory.state.P[POS, POS], sound)
        return sound if far else None

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
        """Update by a fix: with care while the estimate may be far off."""
        memory = self.memory
        was_doubted = is_locked_out(memory) or trusts_velocity_again(memory, fix)
        if was_doubted or not self.knows_heading():
            self._use_with_care(z, fix, track)
        else:
            weakening = robust.inflation(self.model.robust, nis, len(z.residual))
            prior = memory.state.copy()
            self._update_along(_weakened(z, weakening), fix, track)
            if (share := self._directness(z, S, nis, fix)) < echo.CERTAIN:
                error = self.model.error
                memory.state = echo.mixed(prior, memory.state, share, error, self.origin_e)
            if self.model.adaptive_noise:
                robust.learn_noise(memory.noise, fix.device, z, S)
        note_used(self.memory, fix)

    def _directness(self, z: Linearised, S: Array, nis: float, fix: Fix) -> float:
        """Probability that a fix is what it seems: only sound comes by other ways."""
        if not isinstance(fix, Acoustic):
            return 1.0
        echoes = echo.passing(self.model.echoes, S, z.R)
        return echo.directness(nis, len(z.residual), self.model.gate, echoes)

    def _use_with_care(self, z: Linearised, fix: Fix, track: Track) -> None:
        """Update in small parts, each linearised anew; or by the place alone.  # (M.36)"""
        sound = self._lost_at(fix)
        if sound is not None:
            found = place(self.model, self.memory.state, fix, track)
            if found is not None:
                self._take_place(found, sound)
                return
        error = error_for(self.model, fix)
        self._update(_weakened(z, CAREFUL_PARTS), error)
        for _ in range(1, CAREFUL_PARTS):
            again = self._observe(fix, track)
            if not isinstance(again, str):
                self._update(_weakened(again, CAREFUL_PARTS), error)

    def _take_place(self, found: Linearised, slant_range: float) -> None:
        """Update by the place that a fix gives.  # (M.139)

        A place and a velocity that were as good as unknown are forgotten first: what is left of
        them would turn a heading that is unknown too.
        """
        P = self.memory.state.P
        if _is_far(innovation_covariance(P, found), slant_range):
            P[POS, POS] += (ANYWHERE * slant_range) ** 2 * np.eye(3)
            P[VEL, VEL] += ANY_VELOCITY**2 * np.eye(3)
        self._update(found, self.model.error)

    def _update_along(self, z: Linearised, fix: Fix, track: Track) -> None:
        """Update; where the fix bends on the way, again from the start as it is seen at the end.

        The most likely state by Gauss and Newton: what is believed of a fix is what it tells where
        the vehicle is, not where it was thought to be. Step and derivative are the error
        definition's own, or the step would tell what no fix does.  # (M.38), (M.167)
        """
        error, prior, at = error_for(self.model, fix), self.memory.state.copy(), z
        T = error.to_additive(prior, self.origin_e)
        T_inv = np.linalg.inv(T)
        for _ in range(LOOKS):
            self._update(at, error)
            way = error.boxminus(self.memory.state, prior, self.origin_e)
            way[:9] = T @ way[:9]
            seen = self._observe(fix, track)
            if isinstance(seen, str) or seen.names != z.names:
                return
            bent = seen.residual - (at.residual + at.H @ way)
            if (bent**2 <= STRAIGHT**2 * z.R.diagonal()).all():
                return
            H = seen.H.copy()
            H[:, :9] = H[:, :9] @ error.to_additive(self.memory.state, self.origin_e) @ T_inv
            at = replace(z, residual=seen.residual - H @ way, H=H)
            self.memory.state = prior.copy()
        self._update(at, error)

    def _update(self, z: Linearised, error: ErrorDefinition) -> None:
        """Correct the state in the coordinates of an error."""
        update(self.memory.state, z, error, self.origin_e)

    def knows_heading(self) -> bool:
        """Whether the heading is certain enough to go by, and fixes need no care."""
        return bool(self._heading_variance() <= KNOWN_HEADING_SD**2)

    def _heading_variance(self) -> float:
        """Variance of the heading (rad^2)."""
        state = self.memory.state
        lat, lon, _ = ecef_to_lla(state.r_e)
        down = C_en(lat, lon)[:, 2]
        return float(down @ state.P[ATT, ATT] @ down)

    def _gate_is_open(self, fix: Fix) -> bool:
        """Whether heading or place are too uncertain for a linearised gate to be just.  # (M.186)

        A bearing goes with the heading all the way; the place that is made of it goes round.
        """
        if self.knows_heading():
            return False
        goes_round = isinstance(fix, UsblFix) and self.model.loose is not None
        lost = self._lost_at(fix) is not None
        return goes_round or lost or self._heading_variance() > GATE_MAX_HEADING_SD**2

    def _refuse(self, fix: Fix, reason: str) -> Innovation:
        """Verdict on a fix that cannot be used."""
        self.memory.gated += 1
        return Innovation(fix.t_ns, fix.device, fix.beacon, (), float("nan"), False, reason)


def _is_far(P: Array, slant_range: float) -> bool:
    """Whether a place of covariance `P` is uncertain by much of a range."""
    return bool(np.trace(P) > 3.0 * (LOST * slant_range) ** 2)


def _weakened(z: Linearised, parts: float) -> Linearised:
    """The measurement with so much noise that `parts` of it weigh as much as the whole."""
    return replace(z, R=z.R * parts)
