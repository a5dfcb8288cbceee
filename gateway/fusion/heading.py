"""True heading of a sensor's forward axis: a gyrocompass or a pair of antennas.  # (M.80)

The turning of north with the position, tan(lat) / R_e a metre, is left out.
"""

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.axes import course
from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import C_ne
from gateway.fusion.state import ATT, N_FULL, State
from gateway.nav.attitude import turn

Array = NDArray[np.float64]


def linearise(state: State, C_bs: Array, heading: float, sigma: float) -> Linearised | None:
    """Compare with the heading of the sensor's forward axis (rad); None if that is upright."""
    ahead = course(C_ne(state), state.C_eb @ C_bs[:, 0])
    if ahead is None:
        return None
    H = np.zeros((1, N_FULL))
    H[0, ATT] = ahead.by_attitude
    residual = ahead.heading - heading
    return Linearised(
        np.array([turn(residual)]),
        np.ascontiguousarray(H[:, state.columns]),
        np.array([[sigma**2]]),
        ("heading_deg",),
    )
