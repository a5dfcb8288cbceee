"""The vehicle's true motion: an analytic function of time with exact derivatives.

The path lies in a tangent frame ``t`` (north-east-down, fixed to the Earth at the path's origin);
attitude angles are relative to it. What leaves this module is Earth-fixed (``e``).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.scenario import Track, Wave
from gateway.emulator.tracks import way_of
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler, euler_from_C

Array = NDArray[np.float64]
_OMEGA_IE_E = np.array([0.0, 0.0, earth.OMEGA_IE])


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the IMU is and how it is turned: ``r_e`` (n, 3) m, ``C_eb`` (n, 3, 3)."""

    r_e: Array
    C_eb: Array


@dataclass(frozen=True, slots=True)
class Geodetic:
    """The same as a navigator reads it: rad, m and m/s, each (n,); ``v_eb_n`` (n, 3)."""

    lat: Array
    lon: Array
    h: Array
    v_eb_n: Array
    roll: Array
    pitch: Array
    heading: Array


@dataclass(frozen=True, slots=True)
class _Motion:
    """In the tangent frame: position, velocity, acceleration, Euler angles and rates, (n, 3)."""

    r: Array
    v: Array
    a: Array
    euler: Array
    rates: Array

    @property
    def C_tb(self) -> Array:
        return C_from_euler(*np.moveaxis(self.euler, -1, 0))

    @property
    def omega_tb_b(self) -> Array:
        roll, pitch, _ = np.moveaxis(self.euler, -1, 0)
        p, q, r = np.moveaxis(self.rates, -1, 0)
        sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
        return np.stack([p - r * sp, q * cr + r * cp * sr, r * cp * cr - q * sr], axis=-1)


class Trajectory:
    """True motion at any time from 0 (s) on; every method is vectorised over ``t`` (n,)."""

    def __init__(self, track: Track, duration_s: float) -> None:
        self._track = track
        self._way = way_of(track, duration_s)
        self._r0_e, self._C_et = self._way.r0_e, self._way.C_et

    def pose(self, t: Array) -> Pose:
        """Position and attitude."""
        m = self._motion(np.asarray(t, dtype=np.float64))
        return Pose(self._r0_e + m.r @ self._C_et.T, self._C_et @ m.C_tb)

    def point(self, t: Array, l_b: tuple[float, float, float]) -> tuple[Array, Array]:
        """Place ``r_e`` (m) and velocity ``v_e`` (m/s), (n, 3), of what is fixed at ``l_b``."""
        m = self._motion(np.asarray(t, dtype=np.float64))
        turning = np.einsum("nij,nj->ni", m.C_tb, np.cross(m.omega_tb_b, l_b))
        return self._r0_e + (m.r + m.C_tb @ l_b) @ self._C_et.T, (m.v + turning) @ self._C_et.T

    def geodetic(self, t: Array) -> Geodetic:
        """Position, velocity and attitude as a navigation solution states them."""
        m = self._motion(np.asarray(t, dtype=np.float64))
        lat, lon, h = earth.ecef_to_lla(self._r0_e + m.r @ self._C_et.T)
        C_nt = np.swapaxes(earth.C_en(lat, lon), -1, -2) @ self._C_et
        v_eb_n = np.einsum("nij,nj->ni", C_nt, m.v)
        return Geodetic(lat, lon, h, v_eb_n, *euler_from_C(C_nt @ m.C_tb))

    def inertial(self, t: Array) -> tuple[Array, Array]:
        """What a perfect IMU senses at an instant.

        Returns
        -------
        omega_ib_b, f_ib_b
            (n, 3) rad/s and m/s^2, body axes.
        """
        m = self._motion(np.asarray(t, dtype=np.float64))
        C_bt = np.swapaxes(m.C_tb, -1, -2)
        omega_ie_t = _OMEGA_IE_E @ self._C_et
        lat, lon, h = earth.ecef_to_lla(self._r0_e + m.r @ self._C_et.T)
        g_e = np.einsum("nij,nj->ni", earth.C_en(lat, lon), earth.gravity_n(lat, h))
        f_t = m.a + 2.0 * np.cross(omega_ie_t, m.v) - g_e @ self._C_et
        omega_ib_b = m.omega_tb_b + C_bt @ omega_ie_t
        return omega_ib_b, np.einsum("nij,nj->ni", C_bt, f_t)

    def _motion(self, t: Array) -> _Motion:
        s, ds, dds = self._way.pace.at(t)
        r, dr, ddr = self._way.route.at(s)
        z, dz, ddz = self._way.depth.at(s)
        sway = self._track.sway
        (roll, droll, _), (pitch, dpitch, _), (yaw, dyaw, _) = (
            _oscillation(t, waves, np.deg2rad(1.0)) for waves in (sway.roll, sway.pitch, sway.yaw)
        )
        if self._track.pitches:
            pitch -= np.arctan(dz)
            dpitch -= ddz * ds / (1.0 + dz**2)
        north, east = _oscillation(t, sway.north, 1.0), _oscillation(t, sway.east, 1.0)
        heave = _oscillation(t, sway.heave, -1.0)
        to_and_fro = [np.column_stack(parts) for parts in zip(north, east, heave, strict=True)]
        tangent2 = np.sum(dr**2, axis=-1)
        course_rate = (dr[:, 0] * ddr[:, 1] - dr[:, 1] * ddr[:, 0]) / tangent2 * ds
        course = np.arctan2(dr[:, 1], dr[:, 0])
        slope, bend = np.column_stack([dr, dz]), np.column_stack([ddr, ddz])
        return _Motion(
            np.column_stack([r, z]) + to_and_fro[0],
            slope * ds[:, None] + to_and_fro[1],
            bend * (ds**2)[:, None] + slope * dds[:, None] + to_and_fro[2],
            np.column_stack([roll, pitch, course + yaw]),
            np.column_stack([droll, dpitch, course_rate + dyaw]),
        )


def _oscillation(t: Array, waves: tuple[Wave, ...], unit: float) -> tuple[Array, Array, Array]:
    """Sum of the waves and its two derivatives, in the amplitudes' unit."""
    y, dy, ddy = np.zeros((3, *t.shape))
    for wave in waves:
        amplitude, rate = unit * wave.amplitude, 2.0 * np.pi / wave.period_s
        phase = rate * t + np.deg2rad(wave.phase_deg)
        y += amplitude * np.sin(phase)
        dy += amplitude * rate * np.cos(phase)
        ddy -= amplitude * rate**2 * np.sin(phase)
    return y, dy, ddy
