"""Tight coupling of an acoustic fix: elevation, bearing and slant range of a moored beacon.

Seed 000 (2.2) with the array's lever arm, mounting error, angle offsets, range scale and, where
they are estimated, the errors of the lever arm and of the declared latency; in the array's axes or
in axes that the instrument has levelled or turned north.  # (M.40)-(M.46), (M.160)-(M.163)
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.axes import AxesName, nominal_axes, told_axes
from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import add_latency, earlier
from gateway.fusion.ranging import Past, range_row
from gateway.fusion.state import (
    ATT,
    DALPHA,
    DBETA,
    LATENCY,
    LEVER,
    N_FULL,
    POS,
    THETA,
    State,
)
from gateway.nav.compiled import compiled
from gateway.nav.lie import skew

Array = NDArray[np.float64]
Vec = tuple[float, float, float]

ELEVATION, BEARING, RANGE = 0, 1, 2
ROW_NAMES = ("elevation_deg", "bearing_deg", "range_m")

MIN_HORIZONTAL = 0.02
"""Below this ratio of horizontal to slant range (1.1 deg off the vertical) bearings say nothing."""


@dataclass(frozen=True)
class ArrayGeometry:
    """How an array sits in the body.

    Attributes
    ----------
    lever_b
        (3,) from the IMU to the array, body axes (m).
    C_bu
        (3, 3) nominal mounting, array axes to body; the true one is ``Exp(theta) C_bu``.
    """

    lever_b: Array
    C_bu: Array


@dataclass(frozen=True)
class Sighting:
    """One fix: measured rows (elevation rad, bearing rad, range m; NaN where missing) and noise."""

    measured: Array
    sigma: Array
    beacon_e: Array
    transmit: Past | None
    """Where the array was when the ping left; None for a one-way range."""
    axes: AxesName = "array"
    """What elevation and bearing refer to."""
    sensor_sd: tuple[float, float] = (0.0, 0.0)
    """1-sigma (rad) of level and heading of the motion sensor that has turned them."""
    t_sd_s: float = 0.0
    """1-sigma (s) of its time."""

    def sensor_variance(self) -> Array:
        """(3,) rad^2: by how much the axes are wrong about their own x, y, z."""
        tilt, heading = self.sensor_sd
        match self.axes:
            case "array":
                return np.zeros(3)
            case "level":
                return np.array([tilt**2, tilt**2, 0.0])
            case "north":
                return np.array([tilt**2, tilt**2, heading**2])


def angles(r_u: Vec) -> tuple[float, float]:
    """Elevation (up) and bearing (to starboard) of a point in array axes, rad.  # (M.41)"""
    x, y, z = r_u
    return math.atan2(-z, math.hypot(x, y)), math.atan2(y, x)


def turned_back(state: State, geometry: ArrayGeometry, sight: Sighting) -> Sighting | None:
    """The sighting that an instrument turned by our own attitude, in the array's axes again.

    None without both angles: what was turned is a direction.  # (M.164)
    """
    state, _ = earlier(state)
    nominal = nominal_axes(state, geometry.C_bu, sight.axes)
    if nominal is None or np.isnan(sight.measured[:2]).any():
        return None
    C_ua = (state.C_eb @ geometry.C_bu).T @ nominal[0]
    told = direction(*sight.measured[:2].tolist())
    measured = np.array([*angles(tuple((C_ua @ told).tolist())), sight.measured[RANGE]])
    return replace(sight, measured=measured, axes="array")


def direction(elevation: float, bearing: float) -> Array:
    """(3,) unit vector that lies so; the inverse of `angles`."""
    level = math.cos(elevation)
    return np.array([level * math.cos(bearing), level * math.sin(bearing), -math.sin(elevation)])


def by_polar(elevation: float, bearing: float, range_m: float) -> Array:
    """(3, 3) derivative of a point by elevation, bearing and range."""
    sa, ca, sb, cb = np.sin(elevation), np.cos(elevation), np.sin(bearing), np.cos(bearing)
    return np.array(
        [
            [-range_m * sa * cb, -range_m * ca * sb, ca * cb],
            [-range_m * sa * sb, range_m * ca * cb, ca * sb],
            [-range_m * ca, 0.0, -sa],
        ]
    )


def linearise(state: State, geometry: ArrayGeometry, sight: Sighting) -> Linearised | None:
    """Predict a fix and its derivatives at the state of the reply's arrival.

    A bearing is left out where it has no meaning (beacon straight below). None if nothing is left.
    """
    state, omega_e = earlier(state)
    h = np.empty(3)
    H = np.zeros((3, N_FULL))
    measured = sight.measured
    lever_b = geometry.lever_b + state.lever_b
    d_e = sight.beacon_e - state.r_e
    axes = told_axes(state, geometry.C_bu, sight.axes)
    if axes is None:
        return None
    r_a, A = _angle_rows(state.C_eb, *axes[:3], lever_b, d_e, H)
    if math.hypot(r_a[0], r_a[1]) < MIN_HORIZONTAL * math.hypot(*r_a):
        measured = measured.copy()
        measured[BEARING] = np.nan
    h[:2] = angles(r_a) + state.angle_offsets
    h[RANGE] = range_row(state, lever_b, sight.beacon_e, sight.transmit, H[RANGE])
    add_latency(state, omega_e, H)
    rows = np.flatnonzero(~np.isnan(measured))
    if rows.size == 0:
        return None
    residual = h - measured
    residual[BEARING] = (residual[BEARING] + math.pi) % math.tau - math.pi
    moved = sight.t_sd_s * H[:, LATENCY]
    H = np.ascontiguousarray(H[rows][:, state.columns])
    names = tuple(ROW_NAMES[i] for i in rows)
    R = np.diag(sight.sigma**2)
    if sight.axes != "array":
        R[:2, :2] = _told_noise(A, axes.C_eu.T @ axes.C_ea, np.array(r_a), sight)
    R += np.outer(moved, moved)  # (M.180)
    return Linearised(residual[rows], H, R[np.ix_(rows, rows)], names)


def _told_noise(A: Array, C_ua: Array, r_a: Array, sight: Sighting) -> Array:
    """(2, 2) of angles that the array measured in its own axes and a sensor turned.  # (M.163)"""
    r_u = C_ua @ r_a
    elevation, bearing = angles((r_u[0], r_u[1], r_u[2]))
    measured = A @ C_ua.T @ by_polar(elevation, bearing, float(np.linalg.norm(r_u)))[:, :2]
    turned = A @ skew(r_a)
    by_array = measured * sight.sigma[:2] ** 2 @ measured.T
    noise: Array = by_array + turned * sight.sensor_variance() @ turned.T
    return noise


@compiled
def _angle_rows(
    C_eb: Array,
    C_ea: Array,
    turning: Array,
    by_mounting: Array,
    lever_b: Array,
    d_e: Array,
    H: Array,
) -> tuple[Vec, Array]:
    """Fill the rows of elevation and bearing.  # (M.40)-(M.43), (M.162)

    ``Exp(theta + d)^T r = Exp(theta)^T (r + [r]x J d)``, so the left Jacobian of theta enters.

    Returns
    -------
    r_a, A
        The beacon in the told axes (m), and the (2, 3) derivative of the angles there.
    """
    C_ab = C_ea.T @ C_eb
    r_b = C_eb.T @ d_e - lever_b
    x, y, z = C_ab @ r_b
    L2 = max(x * x + y * y, 1e-12)
    L, R2 = math.sqrt(L2), L2 + z * z
    A = np.array([[x * z / (R2 * L), y * z / (R2 * L), -L / R2], [-y / L2, x / L2, 0.0]])
    A_b = A @ C_ab
    M = A_b @ C_eb.T
    l_e = C_eb @ lever_b
    H[:2, ATT] = M @ (skew(d_e - l_e) @ turning + skew(l_e))
    H[:2, POS] = -M
    H[:2, THETA] = A_b @ skew(r_b) @ by_mounting
    H[:2, LEVER] = -A_b
    H[ELEVATION, DALPHA] = H[BEARING, DBETA] = 1.0
    return (x, y, z), A
