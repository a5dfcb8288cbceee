"""The way of sound between a moored beacon and a point that a moving vehicle carries."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.config.blocks import Beacon
from gateway.emulator.trajectory import Trajectory
from gateway.nav import earth

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FIXED_POINT_ROUNDS = 8
"""Each gains a factor c / v, more than 100: far beyond rounding."""
_STEP_S = 0.01
_SLOPE = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
"""Steps and weights of a slope that is exact for polynomials of the fourth degree."""


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

    def range_rate(self, t: Array, b_e: Array) -> Array:
        """Slope of the distance, (n,) m/s: what the Doppler of a sound heard at ``t`` tells.

        Heard at t_rx, sent at t_tx = t_rx - R(t_rx) / c: each second heard lasted 1 - R' / c.
        """
        slope: Array = sum(
            (weight / _STEP_S * self.distance(t + step * _STEP_S, b_e) for step, weight in _SLOPE),
            start=np.zeros(t.shape),
        )
        return slope

    def hears(self, t_sent: Array, b_e: Array) -> Array:
        """When sound that a beacon sends arrives, (n,) s."""
        t = t_sent
        for _ in range(_FIXED_POINT_ROUNDS + 1):
            t = t_sent + self.distance(t, b_e) / self.sound_speed
        return t

    def exchange(
        self, t_ping: Array, b_e: Array, turnaround: Array, two_way: Mask
    ) -> tuple[Array, Array]:
        """When each beacon sends (a one-way beacon at the ping), and when that is heard."""
        out = self.distance(t_ping, b_e) / self.sound_speed
        t_reply = t_ping + np.where(two_way, out + turnaround, 0.0)
        return t_reply, self.hears(t_reply, b_e)


def place(beacon: Beacon) -> Array:
    """Of a beacon in e, (3,) m."""
    lat, lon = np.deg2rad([beacon.lat_deg, beacon.lon_deg])
    return earth.lla_to_ecef(lat, lon, beacon.height_m)


@dataclass(frozen=True, slots=True)
class Moorings:
    """Beacons as arrays: ``r_e`` (m, 3) m, ``turnaround`` (m,) s, ``two_way`` (m,)."""

    names: list[str]
    r_e: Array
    turnaround: Array
    two_way: Mask

    @classmethod
    def of(cls, beacons: dict[str, Beacon], asked: tuple[str, ...]) -> "Moorings":
        """Those that are asked, in their order; all if none is named."""
        names = list(asked or beacons)
        blocks = [beacons[name] for name in names]
        return cls(
            names,
            np.stack([place(beacon) for beacon in blocks]),
            np.array([1e-3 * beacon.turnaround_ms for beacon in blocks]),
            np.array([beacon.travel == "two_way" for beacon in blocks]),
        )
