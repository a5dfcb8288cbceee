"""Acoustic range to a moored beacon: one-way, or there and back with the vehicle moving between.

Seed 001's compensation in its exact form: half the sum of the distances at transmission and at
reception, instead of a pseudo-beacon.  # (M.44), (M.45)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.state import ATT, DKD, LEVER, POS, VEL, State
from gateway.nav.lie import skew

Array = NDArray[np.float64]


class Past(NamedTuple):
    """Displacement and attitude chain at an earlier moment, see `gateway.nav.strapdown`."""

    s_e: Array
    chain: Array
    age_s: float


def range_row(
    state: State, lever_b: Array, beacon_e: Array, transmit: Past | None, H: Array
) -> float:
    """Predict a slant range, scale error included, and fill its row of derivatives.

    Parameters
    ----------
    state
        At reception.
    lever_b
        (3,) from the IMU to the transducer, body axes (m).
    beacon_e
        (3,) ECEF (m).
    transmit
        The moment the ping left; None for a one-way range.
    H
        (25,) row to fill, zero on entry.
    """
    C, k = state.C_eb, 1.0 + state.range_scale
    l_rx = C @ lever_b
    a_rx = state.r_e + l_rx - beacon_e
    n_rx = float(np.sqrt(a_rx @ a_rx))
    u_rx = a_rx / n_rx
    if transmit is None:
        distance = n_rx
        H[POS], H[ATT], H[LEVER] = k * u_rx, k * (skew(l_rx) @ u_rx), k * (C.T @ u_rx)
    else:
        C_tx = C @ (state.chain.T @ transmit.chain)
        l_tx = C_tx @ lever_b
        a_tx = state.r_e - (state.s_e - transmit.s_e) + l_tx - beacon_e
        n_tx = float(np.sqrt(a_tx @ a_tx))
        u_tx = a_tx / n_tx
        distance = 0.5 * (n_tx + n_rx)
        H[POS] = 0.5 * k * (u_tx + u_rx)
        H[VEL] = -0.5 * k * transmit.age_s * u_tx
        H[ATT] = 0.5 * k * (skew(l_rx) @ u_rx + skew(l_tx) @ u_tx)
        H[LEVER] = 0.5 * k * (C.T @ u_rx + C_tx.T @ u_tx)
    H[DKD] = distance
    return distance * k
