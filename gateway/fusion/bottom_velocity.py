"""Velocity over the bottom in a Doppler log's own axes.  # (M.79)"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import OMEGA_IE_E, body_rate
from gateway.fusion.state import ATT, BG, N_FULL, VEL, State
from gateway.nav.lie import skew

Array = NDArray[np.float64]

ROW_NAMES = ("forward_m_s", "starboard_m_s", "down_m_s")


class OverBottom(NamedTuple):
    """Measured (3,) velocity in the sensor's axes and the sigma of each component (m/s)."""

    v_s: Array
    sigma: Array


def linearise(state: State, lever_b: Array, C_bs: Array, measured: OverBottom) -> Linearised:
    """Compare with the log's own velocity; `C_bs` (3, 3) turns its axes into the body's."""
    C_be = state.C_eb.T
    omega_eb_b = body_rate(state) - C_be @ OMEGA_IE_E
    v_b = C_be @ state.v_eb_e + skew(omega_eb_b) @ lever_b
    H = np.zeros((3, N_FULL))
    H[:, VEL] = C_bs.T @ C_be
    # C_be turns both the velocity and the Earth's rate that the lever arm does not feel
    by_attitude = skew(state.v_eb_e) + skew(state.C_eb @ lever_b) @ skew(OMEGA_IE_E)
    H[:, ATT] = C_bs.T @ C_be @ by_attitude
    H[:, BG] = C_bs.T @ skew(lever_b)
    return Linearised(
        C_bs.T @ v_b - measured.v_s,
        np.ascontiguousarray(H[:, state.columns]),
        np.diag(measured.sigma**2),
        ROW_NAMES,
    )
