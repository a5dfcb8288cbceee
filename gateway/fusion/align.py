"""Attitude from the inertial unit itself: levelling by gravity, heading by the turning Earth.

The gyros carry the body axes of the window's beginning along, inertially, so that the vehicle may
sway. In those axes the integral of specific force is, but for the sway, a parabola: its slope is
gravity and gives the level, its curvature is gravity turned by the Earth and gives east. Sway is
bounded in displacement, so its part of either falls with the square and the cube of the time.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.window import Sway, Window, carried
from gateway.nav.covariance import GAP_FORCE, GAP_TURN
from gateway.nav.earth import OMEGA_IE, gravity, radii
from gateway.nav.lie import exp_so3, skew

Array = NDArray[np.float64]

MAX_LEVEL_SD = math.radians(2.0)
"""A level known worse is none: the vehicle was manoeuvring."""
MAX_HEADING_SD = math.radians(10.0)
"""A gyrocompass heading known worse is none."""


@dataclass(frozen=True)
class Site:
    """Where and how the vehicle is while it aligns.

    Attributes
    ----------
    lat, h
        rad, m.
    v_n, sigma_v
        (3,) mean velocity NED and its 1-sigma, m/s.
    """

    lat: float
    h: float
    v_n: Array
    sigma_v: float

    @property
    def g(self) -> float:
        """Gravity, m/s^2."""
        return float(gravity(self.lat, self.h))

    @property
    def omega_in_n(self) -> Array:
        """(3,) rate of the local level, rad/s: the Earth's and that of the way over it."""
        R_M, R_N = radii(self.lat)
        north, east = self.v_n[0] / (R_M + self.h), self.v_n[1] / (R_N + self.h)
        earth = OMEGA_IE * np.array([math.cos(self.lat), 0.0, -math.sin(self.lat)])
        return np.asarray(earth + np.array([east, -north, -east * math.tan(self.lat)]))

    @property
    def f_n(self) -> Array:
        """(3,) specific force of the mean motion, m/s^2: gravity and Coriolis."""
        earth = OMEGA_IE * np.array([math.cos(self.lat), 0.0, -math.sin(self.lat)])
        coriolis = np.cross(earth + self.omega_in_n, self.v_n)
        return np.asarray(coriolis - np.array([0.0, 0.0, self.g]))


@dataclass(frozen=True)
class Grade:
    """1-sigma of the unit's errors, SI: random walks of angle and velocity, biases."""

    angle_walk: float
    velocity_walk: float
    gyro_bias: float
    accel_bias: float


@dataclass(frozen=True)
class Found:
    """An attitude and how its error comes about, at the beginning of the window.

    The rotation vector of the error, NED, is ``noise + by_gyro @ db_g + by_accel @ db_a``: what
    the biases do to the attitude is a correlation with them, not a variance of its own.

    Attributes
    ----------
    C_nb
        (3, 3) body to NED.
    noise
        (3, 3) covariance of what does not come from the biases.
    by_gyro, by_accel
        (3, 3) rad per rad/s and per m/s^2.
    sway_v
        (3,) rms of the velocity about its mean, NED, m/s.
    level_parts, heading_parts
        1-sigma by its origin, rad.
    """

    C_nb: Array
    noise: Array
    by_gyro: Array
    by_accel: Array
    sway_v: Array
    level_parts: dict[str, float]
    heading_parts: dict[str, float]

    @property
    def level_sd(self) -> float:
        """1-sigma of the level about any horizontal axis, all origins (rad)."""
        return math.hypot(*self.level_parts.values())

    @property
    def heading_sd(self) -> float:
        """1-sigma of the heading, all origins (rad)."""
        return math.hypot(*self.heading_parts.values())

    @property
    def refusal(self) -> str:
        """Why this is not good enough to begin with: the largest part; "" when it is."""
        if not self.level_sd <= MAX_LEVEL_SD:
            return "level_" + max(self.level_parts, key=lambda k: self.level_parts[k])
        if "given" not in self.heading_parts and not self.heading_sd <= MAX_HEADING_SD:
            return "heading_" + max(self.heading_parts, key=lambda k: self.heading_parts[k])
        return ""


def level(rows: Array, site: Site, grade: Grade, heading: float, heading_sd: float) -> Found:
    """Level of a window, with a heading from elsewhere.  # (M.122)-(M.126)

    Parameters
    ----------
    rows
        (n, 8) samples, see `gateway.messages.ImuBlock`.
    heading, heading_sd
        Heading at the beginning of the window and its 1-sigma, rad.
    """
    window = carried(rows)
    a_b, b_b, rest = window.parabola(window.u)
    a_n, _ = _expected(window, site)
    bow = window.D_mid.T[:, 0]  # where the bow of the beginning points, in the axes of the middle
    a_b, b_b = window.D_mid.T @ a_b, window.D_mid.T @ b_b
    course = heading
    for _ in range(2):  # the Earth turns between the beginning, where the heading is given, and now
        C_mid = _triad(a_b, bow, a_n, np.array([math.cos(course), math.sin(course), 0.0]))
        C_begin = _at_begin(C_mid, window, site)
        course += heading - math.atan2(C_begin[1, 0], C_begin[0, 0])
    sway = Sway(window, rest, C_mid @ window.D_mid.T)
    parts = _level_parts(window, sway, site, grade, C_mid @ b_b)
    noise = _variance(parts, but="bias")
    to_begin = _carry(window, site)
    to_begin[2] = 0.0, 0.0, 1.0  # the heading is given there
    by_gyro = -window.tau[0] * C_begin
    by_gyro[2] = 0.0
    return Found(
        C_begin,
        to_begin @ np.diag([noise, noise, heading_sd**2]) @ to_begin.T,
        by_gyro,
        to_begin @ _tilt_by_accel(site) @ C_mid,
        sway.velocity,
        parts,
        {"given": heading_sd},
    )


def gyrocompass(rows: Array, site: Site, grade: Grade) -> Found:
    """Level and heading of a window by the turn of gravity.  # (M.127)-(M.131)

    Parameters
    ----------
    rows
        (n, 8) samples, see `gateway.messages.ImuBlock`.
    """
    window = carried(rows)
    a_b, b_b, rest = window.parabola(window.u)
    a_n, b_n = _expected(window, site)
    C_mid = _triad(window.D_mid.T @ a_b, window.D_mid.T @ b_b, a_n, b_n)
    C_begin = _at_begin(C_mid, window, site)
    sway = Sway(window, rest, C_mid @ window.D_mid.T)
    levels = _level_parts(window, sway, site, grade, b_n)
    headings = _heading_parts(window, sway, site, grade)
    noise = _variance(levels, but="bias")
    to_begin = _carry(window, site)
    by_gyro_mid, by_accel_mid = np.zeros((3, 3)), _tilt_by_accel(site)
    by_gyro_mid[2] = C_mid[1] / _level_rate(site)
    by_accel_mid[2, 1] = -math.tan(site.lat) / site.g
    diagonal = np.diag([noise, noise, _variance(headings, but="bias")])
    return Found(
        C_begin,
        to_begin @ diagonal @ to_begin.T,
        to_begin @ by_gyro_mid - window.tau[0] * C_begin,
        to_begin @ by_accel_mid @ C_mid,
        sway.velocity,
        levels,
        headings,
    )


def course(v_n: Array, sigma_v: float, sigma_crab: float, min_speed: float) -> tuple[float, float]:
    """Heading of a vehicle that moves bow first, from its velocity.  # (M.132)

    Parameters
    ----------
    v_n
        (3,) velocity over ground NED, m/s.
    sigma_v, sigma_crab
        1-sigma of each of its components, and of the angle between bow and course (rad).
    min_speed
        Below this the course says nothing, m/s.

    Returns
    -------
    heading, sigma
        rad; the sigma is infinite below `min_speed`.
    """
    speed = math.hypot(v_n[0], v_n[1])
    if speed < max(min_speed, 1e-9):
        return 0.0, math.inf
    return math.atan2(v_n[1], v_n[0]), math.hypot(sigma_v / speed, sigma_crab)


def _expected(window: Window, site: Site) -> tuple[Array, Array]:
    """Slope and curvature of a vehicle without sway, NED at the middle.  # (M.121)"""
    W, term, u = skew(site.omega_in_n), site.f_n, np.zeros((len(window.tau), 3))
    power = np.ones_like(window.tau)
    for order in range(1, 5):
        power = power * window.tau / order
        u += power[:, None] * term
        term = W @ term
    slope, curvature, _ = window.parabola(u)
    return slope, curvature


def _triad(a_b: Array, b_b: Array, a_n: Array, b_n: Array) -> Array:
    """(3, 3) C_nb that takes `a` exactly to `a`, and `b` as near to `b` as it may.  # (M.122)"""
    return np.asarray(_axes(a_n, b_n) @ _axes(a_b, b_b).T)


def _axes(a: Array, b: Array) -> Array:
    x = a / np.linalg.norm(a)
    z = np.cross(a, b)
    z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def _at_begin(C_mid: Array, window: Window, site: Site) -> Array:
    """Attitude at the beginning in the level of there.  # (M.123)"""
    return np.asarray(exp_so3(-window.tau[0] * site.omega_in_n) @ C_mid @ window.D_mid.T)


def _carry(window: Window, site: Site) -> Array:
    """(3, 3) what becomes of an attitude error on the way back to the beginning."""
    return np.asarray(exp_so3(-window.tau[0] * site.omega_in_n))


def _tilt_by_accel(site: Site) -> Array:
    """(3, 3) tilt, NED, by the error of the accelerometer bias, NED.  # (M.124)"""
    return np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / site.g


def _level_rate(site: Site) -> float:
    """Horizontal rate of the local level, rad/s."""
    return math.hypot(site.omega_in_n[0], site.omega_in_n[1])


def _turn_rate(window: Window, site: Site) -> float:
    """Mean yaw rate, rad/s."""
    slope, _, _ = window.parabola(window.u)
    yaw = -window.turn @ slope / np.linalg.norm(slope)
    return abs(float(yaw - site.omega_in_n[2]))


def _level_parts(
    window: Window, sway: Sway, site: Site, grade: Grade, b_n: Array
) -> dict[str, float]:
    """1-sigma of the tilt by origin, rad.  # (M.125), (M.126)"""
    T, g = window.span, site.g
    turning = (math.hypot(*site.v_n[:2]) + site.sigma_v) * _turn_rate(window, site)
    explained = g * (_level_rate(site) + 3.0 * grade.gyro_bias) + 3.0 * _sway_jerk(window, sway)
    unsteady = max(0.0, math.hypot(b_n[0], b_n[1]) - explained) * 0.5 * T
    walks = grade.velocity_walk * math.sqrt(1.2 / T) / g
    return {
        "sway": 6.0 * math.sqrt(2.0) * sway.displacement / T**2 / g,
        "turning": turning / g,
        "unsteady": unsteady / g,
        "gaps": math.sqrt(window.blind * (GAP_TURN + GAP_FORCE * (1.5 / T / g) ** 2)),
        "noise": math.hypot(walks, grade.angle_walk * math.sqrt(33.0 / 560.0 * T)),
        "bias": grade.accel_bias / g,
    }


def _sway_jerk(window: Window, sway: Sway) -> float:
    """1-sigma of the curvature by sway, m/s^3.  # (M.129)"""
    return 60.0 * math.sqrt(2.0) * sway.displacement / window.span**3


def _heading_parts(window: Window, sway: Sway, site: Site, grade: Grade) -> dict[str, float]:
    """1-sigma of the gyrocompass heading by origin, rad.  # (M.128)-(M.131)"""
    T, rate = window.span, _level_rate(site)
    force = site.g * rate
    turn = _turn_rate(window, site)
    speed = math.hypot(*site.v_n[:2]) + site.sigma_v
    R_M, _ = radii(site.lat)
    walks = grade.velocity_walk * math.sqrt(120.0 / 7.0 / T**3) / force
    return {
        "sway": _sway_jerk(window, sway) / force,
        "turning": (speed * turn + grade.accel_bias) * turn / force,
        "gaps": 1.875 * math.sqrt(window.blind * GAP_TURN) / T / rate,
        "noise": math.hypot(walks, grade.angle_walk * math.sqrt(10.0 / 7.0 / T) / rate),
        "speed": site.sigma_v / float(R_M) / rate,
        "bias": math.hypot(grade.gyro_bias / rate, grade.accel_bias * math.tan(site.lat) / site.g),
    }


def _variance(parts: dict[str, float], but: str) -> float:
    """Sum of squares of all parts but one."""
    return sum(sd * sd for name, sd in parts.items() if name != but)
