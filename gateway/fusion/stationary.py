"""A vehicle at rest on the Earth: its velocity is zero.  # (M.81)"""

import numpy as np

from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import C_ne
from gateway.fusion.state import N_FULL, VEL, State
from gateway.fusion.velocity import ROW_NAMES


def linearise(state: State, sigma: float) -> Linearised:
    """Compare the velocity with zero, in north, east, down; `sigma` of each component (m/s)."""
    to_n = C_ne(state)
    H = np.zeros((3, N_FULL))
    H[:, VEL] = to_n
    H = np.ascontiguousarray(H[:, state.columns])
    return Linearised(to_n @ state.v_eb_e, H, np.eye(3) * sigma**2, ROW_NAMES)
