"""One Earth-fixed pose with its covariance in geodetic words, compiled: each solution needs it.

What `gateway.nav.earth` and `gateway.nav.attitude` say of arrays in numpy, for one moment and a
hundredth of the time.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gateway.nav.attitude import GIMBAL_LOCK
from gateway.nav.compiled import compiled
from gateway.nav.earth import BOWRING_ROUNDS, E2, EP2, A, B, F

Array = NDArray[np.float64]
Vec = tuple[float, float, float]

N_WORDS = 19
"""Latitude, longitude, height; velocity and Euler angles; sigmas of all nine; cov. north-east."""


@compiled
def words(x: Array, P: Array) -> Array:
    """State in NED and Euler angles with 1-sigma errors.  # (M.50), (M.51)

    Parameters
    ----------
    x
        Mean, see `gateway.nav.strapdown`.
    P
        (n, n) covariance of its additive error: attitude, velocity, position first.

    Returns
    -------
    (19,) rad, m, m/s, in the order of `N_WORDS`; heading in [0, 2 pi].
    """
    out = np.zeros(N_WORDS)
    lat, lon, h = _geodetic(x[12], x[13], x[14])
    n, e, d = _axes(lat, lon)
    roll, pitch, heading = _euler(x, n, e, d)
    v = (x[9], x[10], x[11])
    out[0], out[1], out[2] = lat, lon, h
    out[3], out[4], out[5] = _dot(n, v), _dot(e, v), _dot(d, v)
    out[6], out[7], out[8] = roll, pitch, heading % (2.0 * math.pi)
    r_arc, v_arc = _arc(P, 6, d), _arc(P, 3, d)
    _sigmas(P, 6, (n, e, d), r_arc, out[9:12])
    _sigmas(P, 3, (n, e, d), v_arc, out[12:15])
    _sigmas(P, 0, _euler_axes(pitch, heading, n, e, d), (0.0, 0.0, 0.0), out[15:18])
    out[18] = _covariance(P, 6, n, e) + _dot(n, r_arc) * _dot(e, r_arc)
    return out


@compiled
def _geodetic(x: float, y: float, z: float) -> Vec:
    """Latitude, longitude and height, as `gateway.nav.earth.ecef_to_lla`."""
    p = math.hypot(x, y)
    beta = math.atan2(z, (1.0 - F) * p)
    lat = beta
    for _ in range(BOWRING_ROUNDS):
        lat = math.atan2(z + EP2 * B * math.sin(beta) ** 3, p - E2 * A * math.cos(beta) ** 3)
        beta = math.atan2((1.0 - F) * math.sin(lat), math.cos(lat))
    s = math.sin(lat)
    h = p * math.cos(lat) + z * s - A * math.sqrt(1.0 - E2 * s**2)
    return lat, math.atan2(y, x), h


@compiled
def _axes(lat: float, lon: float) -> tuple[Vec, Vec, Vec]:
    """North, east and down in ECEF coordinates."""
    s, c, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    return (-s * cl, -s * sl, c), (-sl, cl, 0.0), (-c * cl, -c * sl, -s)


@compiled
def _euler(x: Array, n: Vec, e: Vec, d: Vec) -> Vec:
    """Roll, pitch and heading, as `gateway.nav.attitude.euler_from_C`."""
    bow, starboard, keel = (x[0], x[3], x[6]), (x[1], x[4], x[7]), (x[2], x[5], x[8])
    cos_pitch = math.hypot(_dot(n, bow), _dot(e, bow))
    pitch = math.atan2(-_dot(d, bow), cos_pitch)
    if cos_pitch < GIMBAL_LOCK:
        return 0.0, pitch, math.atan2(-_dot(n, starboard), _dot(e, starboard))
    roll = math.atan2(_dot(d, starboard), _dot(d, keel))
    return roll, pitch, math.atan2(_dot(e, bow), _dot(n, bow))


@compiled
def _euler_axes(pitch: float, heading: float, n: Vec, e: Vec, d: Vec) -> tuple[Vec, Vec, Vec]:
    """What a rotation vector is multiplied by to give changes of roll, pitch, heading.  # (M.19)

    Straight up or down, where roll and heading are one, their sigmas are huge, but numbers.
    """
    ahead = _sum(math.cos(heading), n, math.sin(heading), e)
    athwart = _sum(math.cos(heading), e, -math.sin(heading), n)
    secant = 1.0 / max(math.cos(pitch), GIMBAL_LOCK)
    roll = _sum(secant, ahead, 0.0, ahead)
    return roll, athwart, _sum(1.0, d, secant * math.sin(pitch), ahead)


@compiled
def _sigmas(P: Array, at: int, axes: tuple[Vec, Vec, Vec], arc: Vec, out: Array) -> None:
    """Roots of the variances along three axes of the block of three that begins at `at`."""
    for k in range(3):
        variance = _covariance(P, at, axes[k], axes[k]) + _dot(axes[k], arc) ** 2
        out[k] = math.sqrt(max(variance, 0.0))


@compiled
def _arc(P: Array, at: int, d: Vec) -> Vec:
    """How far off its chord a vector lies that is wrong as the heading is, rms.  # (M.51)"""
    variance = _covariance(P, 0, d, d)
    if not variance > 0.0:
        return 0.0, 0.0, 0.0
    off = math.sqrt(max(0.5 * math.expm1(-2.0 * variance) - 2.0 * math.expm1(-0.5 * variance), 0.0))
    share = off / variance
    x = share * _dot((P[at, 0], P[at, 1], P[at, 2]), d)
    y = share * _dot((P[at + 1, 0], P[at + 1, 1], P[at + 1, 2]), d)
    z = share * _dot((P[at + 2, 0], P[at + 2, 1], P[at + 2, 2]), d)
    return d[1] * z - d[2] * y, d[2] * x - d[0] * z, d[0] * y - d[1] * x


@compiled
def _dot(a: Vec, b: Vec) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _sum(j: float, a: Vec, k: float, b: Vec) -> Vec:
    """``j a + k b``."""
    return j * a[0] + k * b[0], j * a[1] + k * b[1], j * a[2] + k * b[2]


@compiled
def _covariance(P: Array, at: int, a: Vec, b: Vec) -> float:
    """``a^T P b`` of the block of three that begins at `at`."""
    total = 0.0
    for i in range(3):
        row = (P[at + i, at], P[at + i, at + 1], P[at + i, at + 2])
        total += a[i] * _dot(row, b)
    return total
