"""True heading of a sensor's forward axis: a gyrocompass or a pair of antennas.  # (M.80)

The turning of north with the position, tan(lat) / R_e a metre, is left out.
"""

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import C_ne
from gateway.fusion.state import ATT, N_FULL, State

Array = NDArray[np.float64]

MIN_HORIZONTAL = 0.1
"""A forward axis less level than this (84 deg of pitch) has no heading."""


def linearise(state: State, C_bs: Array, heading: float, sigma: float) -> Linearised | None:
    """Compare with the heading of the sensor's forward axis (rad); None if that is upright."""
    to_n = C_ne(state)
    north, east, down = to_n @ state.C_eb @ C_bs[:, 0]
    level2 = north * north + east * east
    if level2 < MIN_HORIZONTAL**2:
        return None
    H = np.zeros((1, N_FULL))
    H[0, ATT] = np.array([-north * down / level2, -east * down / level2, 1.0]) @ to_n
    residual = np.arctan2(east, north) - heading
    return Linearised(
        np.array([(residual + np.pi) % (2.0 * np.pi) - np.pi]),
        np.ascontiguousarray(H[:, state.columns]),
        np.array([[sigma**2]]),
        ("heading_deg",),
    )
