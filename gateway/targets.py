"""Tracks of what moves and is heard: a constant velocity, disturbed by white acceleration.

Sightings come late and out of order; each is put in its place, and what came after it is worked in
again, so that the track does not depend on the order of arrival. What we do not know of our own
place is the same in all sightings of a while: averaging makes it no smaller, so it is kept apart
and added to what is told.  # (M.173)-(M.176)
"""

from bisect import insort
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gateway.config import Target
from gateway.messages import Covariance3, TargetSighting, Vec3
from gateway.nav.earth import C_en, ecef_to_lla, lla_to_ecef

Array = NDArray[np.float64]

SECOND_NS = 1_000_000_000
GATE = 16.266
"""99.9 % of chi-squared of three degrees of freedom."""
LOCK_OUT = 3
"""Refused in a row, and near each other, they are right and the track is wrong."""
KEPT_S = 60.0
"""How long sightings are kept, for those that come later and are older."""
FIRST_SPEED_M_S = 3.0
"""1-sigma of each component of the velocity at the first sighting."""


@dataclass(frozen=True)
class Motion:
    """How something moves.

    ``acceleration`` is the root of the spectral density of its acceleration (m/s^2 over one
    second), ``max_age_s`` how long it is known without a sighting.
    """

    acceleration: float
    max_age_s: float


@dataclass(frozen=True)
class TrackedPlace:
    """A target at a moment: geodetic (rad, m), NED velocity, covariance (6, 6) of both in NED."""

    t_ns: int
    lat: float
    lon: float
    h: float
    v_n: Vec3
    P: Array
    age_s: float
    """Since the last sighting that was used."""


@dataclass
class _State:
    """North, east, down from the origin and their rates, (6,), with covariance, at a moment."""

    t_ns: int
    x: Array
    P: Array
    used_ns: int
    own: Array
    """(3, 3) what was not known of ourselves at the last sighting that was used; not in ``P``."""
    refused: list[Array] = field(default_factory=list)
    """Places refused since."""

    def copy(self) -> "_State":
        return replace(self, x=self.x.copy(), P=self.P.copy(), refused=list(self.refused))


@dataclass(frozen=True)
class _Seen:
    """A sighting (3,) in the axes of the origin, (3, 3) of the fix and of ourselves."""

    t_ns: int
    place: Array
    R: Array
    own: Array


@dataclass(frozen=True)
class Followed:
    """One target at a moment; ``place`` is None before the first sighting."""

    number: int
    beacon: str
    block: Target
    place: TrackedPlace | None

    @property
    def is_lost(self) -> bool:
        """Whether it has not been seen for too long."""
        return self.place is None or self.place.age_s > self.block.max_age_s


class Targets:
    """All targets of a configuration, numbered from 1 in its order."""

    def __init__(self, targets: Mapping[str, Target]) -> None:
        self._blocks = targets
        self._tracks = {
            address: Track(Motion(block.acceleration_m_s2, block.max_age_s))
            for address, block in targets.items()
        }
        self._second: int | None = None

    def take(self, found: TargetSighting) -> None:
        """Take a sighting."""
        self._tracks[found.beacon].take(found)

    def due(self, t_ns: int) -> list[Followed]:
        """All that were ever seen, at the first moment asked for of each second; else nothing."""
        before, self._second = self._second, t_ns // SECOND_NS
        if before == self._second:
            return []
        followed = [
            Followed(number, address, block, self._tracks[address].at(t_ns))
            for number, (address, block) in enumerate(self._blocks.items(), 1)
        ]
        return [one for one in followed if one.place is not None]


class Track:
    """One target."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._origin_e: Array = np.zeros(3)
        self._C_en: Array = np.eye(3)
        self._seen: list[_Seen] = []
        self._before: _State | None = None  # the state before the first that is kept
        self._now: _State | None = None

    def take(self, found: TargetSighting) -> bool:
        """Take a sighting, in any order; whether it was in time to be worked in."""
        if self._now is None:
            self._origin_e = lla_to_ecef(found.lat, found.lon, found.h)
            self._C_en = C_en(found.lat, found.lon)
        place = self._C_en.T @ (lla_to_ecef(found.lat, found.lon, found.h) - self._origin_e)
        seen = _Seen(found.t_ns, place, _covariance(found.cov), _covariance(found.own_cov))
        if self._before is not None and seen.t_ns <= self._before.t_ns:
            return False
        insort(self._seen, seen, key=lambda one: one.t_ns)
        self._settle(self._seen[-1].t_ns - round(KEPT_S * 1e9))
        self._now = self._run(self._before, self._seen)
        return True

    def at(self, t_ns: int) -> TrackedPlace | None:
        """Where it is at a moment not before the last sighting; None before the first."""
        if self._now is None:
            return None
        state = self._carried(self._now, max(t_ns, self._now.t_ns))
        lat, lon, h = ecef_to_lla(self._origin_e + self._C_en @ state.x[:3])
        north, east, down = state.x[3:].tolist()
        P = state.P.copy()
        P[:3, :3] += state.own
        age_s = (t_ns - state.used_ns) * 1e-9
        return TrackedPlace(t_ns, float(lat), float(lon), float(h), (north, east, down), P, age_s)

    def _settle(self, horizon_ns: int) -> None:
        """Work in for good what is so old that nothing older will come."""
        settled = [one for one in self._seen if one.t_ns < horizon_ns]
        if settled:
            self._before = self._run(self._before, settled)
            self._seen = self._seen[len(settled) :]

    def _run(self, begin: _State | None, seen: list[_Seen]) -> _State:
        """The state after some sightings in their order."""
        state = None if begin is None else begin.copy()
        for one in seen:
            state = _begun(one) if state is None else self._updated(state, one)
        assert state is not None
        return state

    def _updated(self, state: _State, one: _Seen) -> _State:
        """Carry to a sighting and use it; begin again at one that several others agree with."""
        if (one.t_ns - state.used_ns) * 1e-9 > self._motion.max_age_s:
            return _begun(one)
        state = self._carried(state, one.t_ns)
        state.P[:3, :3] += _learned(state.own, one.own)
        S = state.P[:3, :3] + one.R
        residual = one.place - state.x[:3]
        if residual @ np.linalg.solve(S + one.own, residual) > GATE:
            state.refused.append(one.place)
            return _begun(one) if _agree(state.refused, one.R + one.own) else state
        K = np.linalg.solve(S, state.P[:3]).T
        state.x += K @ residual
        I_KH = np.eye(6)
        I_KH[:, :3] -= K
        state.P = I_KH @ state.P @ I_KH.T + K @ one.R @ K.T
        state.used_ns, state.own, state.refused = one.t_ns, one.own, []
        return state

    def _carried(self, state: _State, t_ns: int) -> _State:
        """The state a while later.  # (M.173), (M.174)"""
        dt = (t_ns - state.t_ns) * 1e-9
        F = np.eye(6)
        F[:3, 3:] = dt * np.eye(3)
        q = self._motion.acceleration**2
        Q = np.kron(np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]]), q * np.eye(3))
        later = state.copy()
        later.t_ns, later.x, later.P = t_ns, F @ state.x, F @ state.P @ F.T + Q
        return later


def _begun(one: _Seen) -> _State:
    """A track of one sighting."""
    P = np.zeros((6, 6))
    P[:3, :3] = one.R
    P[3:, 3:] = FIRST_SPEED_M_S**2 * np.eye(3)
    return _State(one.t_ns, np.array([*one.place, 0.0, 0.0, 0.0]), P, one.t_ns, one.own)


def _agree(refused: list[Array], R: Array) -> bool:
    """Whether the last refused places are one: as near as their noise and a few metres allow."""
    if len(refused) < LOCK_OUT:
        return False
    last = np.array(refused[-LOCK_OUT:])
    reach = 3.0 * np.sqrt(np.trace(R)) + FIRST_SPEED_M_S * 10.0
    return bool(np.linalg.norm(last - last[-1], axis=1).max() < reach)


def _covariance(cov: Covariance3) -> Array:
    nn, ee, dd, ne, nd, ed = cov
    return np.array([[nn, ne, nd], [ne, ee, ed], [nd, ed, dd]])


def _learned(then: Array, now: Array) -> Array:
    """By what our own place has been corrected since, which the track has not.  # (M.176)"""
    values, axes = np.linalg.eigh(then - now)
    corrected: Array = (axes * np.maximum(values, 0.0)) @ axes.T
    return corrected
