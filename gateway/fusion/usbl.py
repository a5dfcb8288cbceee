"""Tight coupling of an acoustic fix: elevation, bearing and slant range of a moored beacon.

Seed 000 (2.2) with the lever arm, the array's mounting error, the angle offsets and the range scale
as states; the range with the array where it was when the ping left and where the reply found it
(seed 001, exact form).  # (M.40)-(M.46)
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.state import ATT, DALPHA, DBETA, DKD, N_STATES, POS, THETA, VEL, State
from gateway.nav.lie import left_jacobian, skew

Array = NDArray[np.float64]

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


class Past(NamedTuple):
    """Displacement and attitude chain at an earlier moment, see `gateway.nav.strapdown`."""

    s_e: Array
    chain: Array
    age_s: float


@dataclass(frozen=True)
class Sighting:
    """One fix: measured rows (elevation rad, bearing rad, range m; NaN where missing) and noise."""

    measured: Array
    sigma: Array
    beacon_e: Array
    transmit: Past | None
    """Where the array was when the ping left; None for a one-way range."""


def array_to_beacon(state: State, geometry: ArrayGeometry, beacon_e: Array) -> tuple[Array, Array]:
    """Beacon from the array: ``r_b`` in body axes and ``r_u`` in array axes (m).  # (M.40)"""
    r_b = state.C_eb.T @ (beacon_e - state.r_e) - geometry.lever_b
    return r_b, geometry.C_bu.T @ (state.C_theta.T @ r_b)


def angles(r_u: Array) -> tuple[float, float]:
    """Elevation (up) and bearing (to starboard) of a point in array axes, rad.  # (M.41)"""
    x, y, z = r_u
    return float(np.arctan2(-z, np.hypot(x, y))), float(np.arctan2(y, x))


def _angle_rows(r_u: Array) -> Array:
    """(2, 3) derivative of elevation and bearing by ``r_u``.  # (M.42)"""
    x, y, z = r_u
    L2 = x * x + y * y
    L, R2 = np.sqrt(L2), L2 + z * z
    return np.array([[x * z / (R2 * L), y * z / (R2 * L), -L / R2], [-y / L2, x / L2, 0.0]])


def _range_row(state: State, geometry: ArrayGeometry, sight: Sighting, H: Array) -> float:
    """Fill the range row of `H` and give the predicted range.  # (M.44), (M.45)"""
    C, l_b, k = state.C_eb, geometry.lever_b, 1.0 + state.range_scale
    l_e = C @ l_b
    a_rx = state.r_e + l_e - sight.beacon_e
    n_rx = float(np.linalg.norm(a_rx))
    u_rx = a_rx / n_rx
    if sight.transmit is None:
        distance = n_rx
        H[RANGE, POS] = k * u_rx
        H[RANGE, ATT] = k * (skew(l_e) @ u_rx)
    else:
        past = sight.transmit
        l_tx = C @ (state.chain.T @ (past.chain @ l_b))
        a_tx = state.r_e - (state.s_e - past.s_e) + l_tx - sight.beacon_e
        n_tx = float(np.linalg.norm(a_tx))
        u_tx = a_tx / n_tx
        distance = 0.5 * (n_tx + n_rx)
        H[RANGE, POS] = 0.5 * k * (u_tx + u_rx)
        H[RANGE, VEL] = -0.5 * k * past.age_s * u_tx
        H[RANGE, ATT] = 0.5 * k * (skew(l_e) @ u_rx + skew(l_tx) @ u_tx)
    H[RANGE, DKD] = distance
    return distance * k


def linearise(state: State, geometry: ArrayGeometry, sight: Sighting) -> Linearised | None:
    """Predict a fix and its derivatives at the state of the reply's arrival.

    Gives None where the geometry has no bearing (beacon straight below) or nothing was measured.
    """
    C = state.C_eb
    r_b, r_u = array_to_beacon(state, geometry, sight.beacon_e)
    if np.hypot(r_u[0], r_u[1]) < MIN_HORIZONTAL * np.linalg.norm(r_u):
        return None
    h = np.empty(3)
    H = np.zeros((3, N_STATES))
    h[:2] = angles(r_u) + state.angle_offsets
    A = _angle_rows(r_u) @ geometry.C_bu.T
    M = A @ state.C_theta.T @ C.T  # d(angles) / d(beacon - position)
    H[:2, ATT] = M @ skew(sight.beacon_e - state.r_e)
    H[:2, POS] = -M
    H[:2, THETA] = _mounting_columns(state, A, r_b)
    H[ELEVATION, DALPHA] = H[BEARING, DBETA] = 1.0
    h[RANGE] = _range_row(state, geometry, sight, H)
    rows = np.flatnonzero(~np.isnan(sight.measured))
    if rows.size == 0:
        return None
    residual = h - sight.measured
    residual[BEARING] = (residual[BEARING] + np.pi) % (2.0 * np.pi) - np.pi
    return Linearised(residual[rows], H[rows], np.diag(sight.sigma[rows] ** 2))


def _mounting_columns(state: State, A: Array, r_b: Array) -> Array:
    """(2, 3) derivative of the angles by theta, exact for a theta that is not small.  # (M.43)

    ``Exp(theta + d)^T r = Exp(theta)^T (r + [r]x J d)``, so the left Jacobian of theta enters.
    """
    return np.asarray(A @ state.C_theta.T @ skew(r_b) @ left_jacobian(state.theta))
