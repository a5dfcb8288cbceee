"""WGS84: geodetic and Earth-fixed coordinates, radii, normal gravity.

Every function takes scalars or arrays of any leading shape. Angles in rad, lengths in m, ``h``
above the ellipsoid. Frames: ``e`` Earth-centred Earth-fixed, ``n`` north-east-down.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

A = 6378137.0
"""Semi-major axis (m)."""
F = 1.0 / 298.257223563
"""Flattening."""
B = A * (1.0 - F)
"""Semi-minor axis (m)."""
E2 = F * (2.0 - F)
"""First eccentricity squared."""
GM = 3.986004418e14
"""Gravitational constant of the Earth with its atmosphere (m^3/s^2)."""
OMEGA_IE = 7.292115e-5
"""Rate of the Earth (rad/s)."""
GAMMA_E = 9.7803253359
"""Normal gravity at the equator (m/s^2)."""
SOMIGLIANA_K = 0.00193185265241
"""Somigliana's constant."""
M_RATIO = OMEGA_IE**2 * A**2 * B / GM
"""Centrifugal to gravitational acceleration at the equator."""

EP2 = E2 / (1.0 - E2)
BOWRING_ROUNDS = 3


def radii(lat: ArrayLike) -> tuple[Array, Array]:
    """Radii of curvature in the meridian and in the prime vertical.

    Parameters
    ----------
    lat
        (...) geodetic latitude, rad.

    Returns
    -------
    R_M, R_N
        (...) m.
    """
    w2 = 1.0 - E2 * np.sin(lat) ** 2
    R_N = A / np.sqrt(w2)
    return R_N * (1.0 - E2) / w2, R_N


def lla_to_ecef(lat: ArrayLike, lon: ArrayLike, h: ArrayLike) -> Array:
    """Geodetic to Earth-fixed position.

    Returns
    -------
    r_e
        (..., 3) m.
    """
    lat, lon, h = np.broadcast_arrays(lat, lon, h)
    _, R_N = radii(lat)
    p = (R_N + h) * np.cos(lat)
    z = (R_N * (1.0 - E2) + h) * np.sin(lat)
    return np.stack([p * np.cos(lon), p * np.sin(lon), z], axis=-1)


def ecef_to_lla(r_e: ArrayLike) -> tuple[Array, Array, Array]:
    """Earth-fixed to geodetic position.

    Bowring's formula on the reduced latitude, iterated: exact to rounding (4 nm) from the deepest
    trench to above the atmosphere, the poles included.

    Parameters
    ----------
    r_e
        (..., 3) m.

    Returns
    -------
    lat, lon, h
        (...) rad, rad in (-pi, pi], m.
    """
    x, y, z = np.moveaxis(np.asarray(r_e, dtype=np.float64), -1, 0)
    p = np.hypot(x, y)
    beta = np.arctan2(z, (1.0 - F) * p)
    lat = beta
    for _ in range(BOWRING_ROUNDS):
        lat = np.arctan2(z + EP2 * B * np.sin(beta) ** 3, p - E2 * A * np.cos(beta) ** 3)
        beta = np.arctan2((1.0 - F) * np.sin(lat), np.cos(lat))
    s = np.sin(lat)
    h = p * np.cos(lat) + z * s - A * np.sqrt(1.0 - E2 * s**2)
    return lat, np.arctan2(y, x), h


def north_east(
    lat: ArrayLike, lon: ArrayLike, lat_0: ArrayLike, lon_0: ArrayLike, h: ArrayLike = 0.0
) -> tuple[Array, Array]:
    """How far one place lies from another, the short way round, at a height `h`.

    By the radii half way between them: over 10 km right to a few centimetres.

    Returns
    -------
    north, east
        (...) m, of the first place from the second.
    """
    lat, lat_0 = np.asarray(lat), np.asarray(lat_0)
    middle = 0.5 * (lat + lat_0)
    R_M, R_N = radii(middle)
    turn = np.remainder(np.subtract(lon, lon_0) + np.pi, 2.0 * np.pi) - np.pi
    return (lat - lat_0) * np.add(R_M, h), turn * np.add(R_N, h) * np.cos(middle)


def C_en(lat: ArrayLike, lon: ArrayLike) -> Array:
    """Matrix that turns north-east-down coordinates into Earth-fixed ones: ``v_e = C_en @ v_n``.

    Returns
    -------
    C_en
        (..., 3, 3).
    """
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    sin_lon, cos_lon = np.sin(lon), np.cos(lon)
    C = np.zeros((*np.broadcast_shapes(np.shape(lat), np.shape(lon)), 3, 3))
    C[..., 0, 0], C[..., 1, 0], C[..., 2, 0] = -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat
    C[..., 0, 1], C[..., 1, 1] = -sin_lon, cos_lon
    C[..., 0, 2], C[..., 1, 2], C[..., 2, 2] = -cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat
    return C


def gravity(lat: ArrayLike, h: ArrayLike) -> Array:
    """Magnitude of normal gravity, centrifugal part included.

    Somigliana's formula on the ellipsoid and the free-air term to second order in height
    (NIMA TR8350.2, eqs. 4-1 and 4-3).

    Returns
    -------
    g
        (...) m/s^2.
    """
    s2 = np.sin(lat) ** 2
    h = np.asarray(h, dtype=np.float64)
    gamma = GAMMA_E * (1.0 + SOMIGLIANA_K * s2) / np.sqrt(1.0 - E2 * s2)
    free_air = 1.0 - 2.0 / A * (1.0 + F + M_RATIO - 2.0 * F * s2) * h + 3.0 * (h / A) ** 2
    return np.asarray(gamma * free_air)


def gravity_n(lat: ArrayLike, h: ArrayLike) -> Array:
    """Normal gravity vector, straight down the ellipsoid's normal.

    Returns
    -------
    g_n
        (..., 3) m/s^2, north-east-down.
    """
    g = gravity(lat, h)
    return np.stack([np.zeros_like(g), np.zeros_like(g), g], axis=-1)
