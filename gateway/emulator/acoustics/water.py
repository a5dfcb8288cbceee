"""The way of sound between a beacon, moored or moving, and a point that a vehicle carries."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.faults.sound import dead, dragged
from gateway.emulator.scenario import Mobile, Scenario
from gateway.emulator.trajectory import Trajectory
from gateway.nav import earth

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ROUNDS = 7
"""Each gains a factor c / v, more than 100: beyond rounding."""
_STEP_S = 0.01
_SLOPE = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
"""Steps and weights of a slope that is exact for polynomials of the fourth degree."""


def slope(of: Callable[[Array], Array], t: Array) -> Array:
    """Derivative by the time, of the shape of ``of(t)``."""
    parts = [weight / _STEP_S * of(t + step * _STEP_S) for step, weight in _SLOPE]
    return np.asarray(np.sum(parts, axis=0))


@dataclass(frozen=True, slots=True)
class Ear:
    """Where sound leaves and enters: ``l_b`` (3,) m from the IMU in body axes.

    All methods take (n,) times in s and (n, 3) beacons in e; ``sound_speed`` is that of the water.
    """

    trajectory: Trajectory
    l_b: Array
    sound_speed: float

    def position(self, t: Array) -> Array:
        """Place in e, (n, 3) m."""
        pose = self.trajectory.pose(t)
        r_e: Array = pose.r_e + pose.C_eb @ self.l_b
        return r_e

    def distance(self, t: Array, b_e: Array) -> Array:
        """To the beacon at that moment, (n,) m."""
        away: Array = np.linalg.norm(self.position(t) - b_e, axis=-1)
        return away

    def range_rate(self, t: Array, b_e: Array, v_e: Array) -> Array:
        """Slope of the distance, (n,) m/s: what the Doppler of a sound heard at ``t`` tells.

        Heard at t_rx, sent at t_tx = t_rx - R(t_rx) / c: each second heard lasted 1 - R' / c. That
        of a beacon which moves with ``v_e`` (n, 3) m/s is right to v / c of its own part.
        """
        return slope(lambda at: self.distance(at, b_e + (at - t)[:, None] * v_e), t)

    def hears(self, t_sent: Array, b_e: Array) -> Array:
        """When sound that a beacon sends arrives, (n,) s."""
        t = t_sent
        for _ in range(_ROUNDS):
            t = t_sent + self.distance(t, b_e) / self.sound_speed
        return t

    def ask(self, t_ping: Array, period_s: float, beacon: "Mooring | Mover") -> "Ways":
        """Sound to a beacon and back; a one-way beacon sends at the ping's moment by itself."""
        reply = beacon.replies(self, t_ping)
        t_rx = self.hears(reply.t, reply.b_e)
        both = 0.5 * (t_rx - t_ping - beacon.turnaround)
        one_way = both if beacon.two_way else t_rx - reply.t
        return Ways(reply.b_e, reply.v_e, reply.t, t_rx, one_way, beacon.answers(t_ping, period_s))


@dataclass(frozen=True, slots=True)
class Reply:
    """What beacons send: ``t`` (n,) s when, ``b_e`` (n, 3) m where, ``v_e`` (n, 3) m/s how fast."""

    t: Array
    b_e: Array
    v_e: Array


@dataclass(frozen=True, slots=True)
class Ways:
    """Sound between the vehicle and beacons, one row a ping.

    ``b_e`` (n, 3) m, ``v_e`` (n, 3) m/s the beacon as it replies; ``t_reply``, ``t_rx`` (n,) s when
    it sends and is heard; ``one_way`` (n,) s, half of both ways where there are two; ``answered``
    (n,).
    """

    b_e: Array
    v_e: Array
    t_reply: Array
    t_rx: Array
    one_way: Array
    answered: Mask

    @classmethod
    def in_turn(
        cls, ear: Ear, t_ping: Array, period_s: float, asked: "list[Mooring | Mover]"
    ) -> "Ways":
        """The first ping to the first beacon, and so on."""
        n = t_ping.size
        t_reply, t_rx, one_way = np.empty((3, n))
        b_e, v_e = np.empty((2, n, 3))
        whole = cls(b_e, v_e, t_reply, t_rx, one_way, np.empty(n, np.bool_))
        for k, beacon in enumerate(asked):
            rows = slice(k, None, len(asked))
            part = ear.ask(t_ping[rows], len(asked) * period_s, beacon)
            whole.b_e[rows], whole.v_e[rows] = part.b_e, part.v_e
            whole.t_reply[rows] = part.t_reply
            whole.t_rx[rows], whole.one_way[rows] = part.t_rx, part.one_way
            whole.answered[rows] = part.answered
        return whole


@dataclass(frozen=True, slots=True)
class Mooring:
    """A beacon, wherever it is and whether it answers or not: ``turnaround`` s."""

    name: str
    turnaround: float
    two_way: bool
    _scenario: Scenario

    def replies(self, ear: Ear, t_ping: Array) -> Reply:
        """What it sends to pings."""
        b_e, t_reply = self.place(t_ping), t_ping
        if self.two_way:
            t_reply = t_ping + ear.distance(t_ping, b_e) / ear.sound_speed + self.turnaround
        return Reply(t_reply, b_e, np.zeros(b_e.shape))

    def place(self, t: Array) -> Array:
        """Where it is in e, (n, 3) m."""
        beacon = self._scenario.moored[self.name]
        lat, lon = np.deg2rad([beacon.lat_deg, beacon.lon_deg])
        r_e = earth.lla_to_ecef(lat, lon, beacon.height_m)
        moved: Array = r_e + dragged(self._scenario, self.name, t) @ earth.C_en(lat, lon).T
        return moved

    def answers(self, t: Array, period_s: float) -> Mask:
        """Whether it answers pings at these times, one a period, (n,)."""
        return ~dead(self._scenario, self.name, t, period_s)


@dataclass(frozen=True, slots=True)
class Mover:
    """A beacon on something that moves: ``turnaround`` s."""

    name: str
    turnaround: float
    two_way: bool
    _scenario: Scenario
    _trajectory: Trajectory

    def replies(self, ear: Ear, t_ping: Array) -> Reply:
        """What it sends to pings, from where it is by then."""
        t_hit, away = t_ping, ear.position(t_ping)
        if self.two_way:
            for _ in range(_ROUNDS):
                path = np.linalg.norm(away - self._trajectory.pose(t_hit).r_e, axis=-1)
                t_hit = t_ping + path / ear.sound_speed
            t_hit = t_hit + self.turnaround
        return Reply(t_hit, *self._trajectory.point(t_hit, (0.0, 0.0, 0.0)))

    def answers(self, t: Array, period_s: float) -> Mask:
        """Whether it answers pings at these times, one a period, (n,)."""
        return ~dead(self._scenario, self.name, t, period_s)


def moorings(scenario: Scenario, asked: tuple[str, ...]) -> list[Mooring | Mover]:
    """The beacons that are asked, in their order; all if none is named."""
    found: list[Mooring | Mover] = []
    for name in asked or scenario.beacons:
        block = scenario.beacons[name]
        told = name, 1e-3 * block.turnaround_ms, block.travel == "two_way", scenario
        if isinstance(block, Mobile):
            found.append(Mover(*told, Trajectory(block.trajectory, scenario.duration_s)))
        else:
            found.append(Mooring(*told))
    return found
