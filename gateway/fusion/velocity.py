"""Velocity over ground of a point of the vehicle: GNSS at the surface.  # (M.77)

The turning of north-east-down with the position, v / R_e a metre, is left out.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import C_ne, lever_velocity
from gateway.fusion.state import ATT, BG, N_FULL, VEL, State

Array = NDArray[np.float64]

ROW_NAMES = ("north_m_s", "east_m_s", "down_m_s")


class OverGround(NamedTuple):
    """Measured (3,) velocity and sigma in n (m/s); an infinite sigma leaves a component out."""

    v_n: Array
    sigma_n: Array


def linearise(state: State, lever_b: Array, measured: OverGround) -> Linearised:
    """Compare with the antenna's velocity, in north, east, down at the estimated place."""
    point = lever_velocity(state, lever_b)
    to_n = C_ne(state)
    H = np.zeros((3, N_FULL))
    H[:, VEL] = to_n
    H[:, ATT] = to_n @ point.by_attitude
    H[:, BG] = to_n @ point.by_gyro_bias
    rows = np.flatnonzero(np.isfinite(measured.sigma_n))
    residual = to_n @ point.v_e - measured.v_n
    return Linearised(
        residual[rows],
        np.ascontiguousarray(H[rows][:, state.columns]),
        np.diag(measured.sigma_n[rows] ** 2),
        tuple(ROW_NAMES[i] for i in rows),
    )
