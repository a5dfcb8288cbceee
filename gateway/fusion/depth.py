"""Height of a pressure sensor above the ellipsoid, which is what its depth says.  # (M.78)"""

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.state import ATT, N_FULL, POS, State
from gateway.nav.earth import C_en, ecef_to_lla
from gateway.nav.lie import skew

Array = NDArray[np.float64]


def linearise(state: State, lever_b: Array, h_m: float, sigma: float) -> Linearised:
    """Compare with the sensor's height; the gradient of the height is the vertical, exactly."""
    l_e = state.C_eb @ lever_b
    lat, lon, h = ecef_to_lla(state.r_e + l_e)
    up = -C_en(lat, lon)[:, 2]
    H = np.zeros((1, N_FULL))
    H[0, POS] = up
    H[0, ATT] = skew(l_e) @ up
    return Linearised(
        np.array([float(h) - h_m]),
        np.ascontiguousarray(H[:, state.columns]),
        np.array([[sigma**2]]),
        ("height_m",),
    )
