"""Acoustic range to a moored beacon: one-way, or there and back with the vehicle moving between.

Seed 001's compensation in its exact form: half the sum of the distances at transmission and at
reception, instead of a pseudo-beacon.  # (M.44), (M.45)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.state import ATT, DKD, LEVER, N_FULL, POS, VEL, State
from gateway.nav.lie import skew

Array = NDArray[np.float64]


class Past(NamedTuple):
    """Displacement and attitude chain at an earlier moment, see `gateway.nav.strapdown`."""

    s_e: Array
    chain: Array
    age_s: float


def leg(state: State, lever_b: Array, beacon_e: Array, when: Past | None) -> tuple[float, Array]:
    """Distance of beacon and transducer, now or at a past moment, and its (25,) derivatives."""
    C, r_e, age_s = state.C_eb, state.r_e, 0.0
    if when is not None:
        C, r_e = pose_then(state, when)
        age_s = when.age_s
    l_e = C @ lever_b
    a = r_e + l_e - beacon_e
    distance = float(np.sqrt(a @ a))
    u = a / distance
    H = np.zeros(N_FULL)
    H[ATT], H[VEL], H[POS], H[LEVER] = skew(l_e) @ u, -age_s * u, u, C.T @ u
    return distance, H


def pose_then(state: State, when: Past) -> tuple[Array, Array]:
    """Attitude (3, 3) and place (3,) of the IMU in e at a past moment."""
    return state.C_eb @ (state.chain.T @ when.chain), state.r_e - (state.s_e - when.s_e)


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
        (25,) row to fill.
    """
    distance, by_distance = leg(state, lever_b, beacon_e, None)
    if transmit is not None:
        there, by_there = leg(state, lever_b, beacon_e, transmit)
        distance, by_distance = 0.5 * (distance + there), 0.5 * (by_distance + by_there)
    k = 1.0 + state.range_scale
    H[:] = k * by_distance
    H[DKD] = distance
    return distance * k
