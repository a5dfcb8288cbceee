"""Tight coupling of an acoustic fix: elevation, bearing and slant range of a moored beacon.

Seed 000 (2.2) with the array's lever arm, mounting error, angle offsets, range scale and, where
they are estimated, the errors of the lever arm and of the declared latency.  # (M.40)-(M.46)
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import add_latency, earlier
from gateway.fusion.ranging import Past, range_row
from gateway.fusion.state import (
    ATT,
    DALPHA,
    DBETA,
    LEVER,
    N_FULL,
    POS,
    THETA,
    State,
)
from gateway.nav.compiled import compiled
from gateway.nav.lie import exp_so3, left_jacobian, skew

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


def angles(r_u: Vec) -> tuple[float, float]:
    """Elevation (up) and bearing (to starboard) of a point in array axes, rad.  # (M.41)"""
    x, y, z = r_u
    return math.atan2(-z, math.hypot(x, y)), math.atan2(y, x)


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
    r_u = _angle_rows(state.C_eb, state.theta, geometry.C_bu, lever_b, d_e, H)
    if math.hypot(r_u[0], r_u[1]) < MIN_HORIZONTAL * math.hypot(*r_u):
        measured = measured.copy()
        measured[BEARING] = np.nan
    h[:2] = angles(r_u) + state.angle_offsets
    h[RANGE] = range_row(state, lever_b, sight.beacon_e, sight.transmit, H[RANGE])
    add_latency(state, omega_e, H)
    rows = np.flatnonzero(~np.isnan(measured))
    if rows.size == 0:
        return None
    residual = h - measured
    residual[BEARING] = (residual[BEARING] + math.pi) % math.tau - math.pi
    H = np.ascontiguousarray(H[rows][:, state.columns])
    names = tuple(ROW_NAMES[i] for i in rows)
    return Linearised(residual[rows], H, np.diag(sight.sigma[rows] ** 2), names)


@compiled
def _angle_rows(
    C_eb: Array, theta: Array, C_bu: Array, lever_b: Array, d_e: Array, H: Array
) -> Vec:
    """Fill the rows of elevation and bearing; give the beacon in array axes (m).  # (M.40)-(M.43)

    ``Exp(theta + d)^T r = Exp(theta)^T (r + [r]x J d)``, so the left Jacobian of theta enters.
    """
    C_ub = C_bu.T @ exp_so3(theta).T
    r_b = C_eb.T @ d_e - lever_b
    x, y, z = C_ub @ r_b
    L2 = max(x * x + y * y, 1e-12)
    L, R2 = math.sqrt(L2), L2 + z * z
    A_u = np.array([[x * z / (R2 * L), y * z / (R2 * L), -L / R2], [-y / L2, x / L2, 0.0]])
    A_b = A_u @ C_ub
    M = A_b @ C_eb.T
    H[:2, ATT] = M @ skew(d_e)
    H[:2, POS] = -M
    H[:2, THETA] = A_b @ skew(r_b) @ left_jacobian(theta)
    H[:2, LEVER] = -A_b
    H[ELEVATION, DALPHA] = H[BEARING, DBETA] = 1.0
    return x, y, z
