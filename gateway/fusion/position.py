"""Position of a point of the vehicle: GNSS at the surface, or any other geodetic fix.  # (M.76)"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.state import ATT, N_FULL, POS, State
from gateway.nav.lie import skew

Array = NDArray[np.float64]

ROW_NAMES = ("north_m", "east_m", "down_m")


class Place(NamedTuple):
    """Measured (3,) ECEF position (m), the local (3, 3) C_en there, and (3,) sigma in n (m).

    A sigma of infinity leaves its component out.
    """

    r_e: Array
    C_en: Array
    sigma_n: Array


def linearise(state: State, lever_b: Array, place: Place) -> Linearised:
    """Compare with the antenna's position, in north, east, down at the measured place."""
    l_e = state.C_eb @ lever_b
    H = np.zeros((3, N_FULL))
    C_ne = place.C_en.T
    H[:, POS] = C_ne
    H[:, ATT] = -C_ne @ skew(l_e)
    rows = np.flatnonzero(np.isfinite(place.sigma_n))
    residual = C_ne @ (state.r_e + l_e - place.r_e)
    return Linearised(
        residual[rows],
        np.ascontiguousarray(H[rows][:, state.columns]),
        np.diag(place.sigma_n[rows] ** 2),
        tuple(ROW_NAMES[i] for i in rows),
    )
