"""Rate of the distance to a beacon, by the Doppler of its sound at the elements of an array.

Seed 002. Each element sits at its own lever arm and so moves at its own rate while the vehicle
turns. The instruments' Doppler is that of the reply, which leaves the beacon at a known frequency:
the state at reception is all it depends on, one-way or two-way.  # (M.73)-(M.75)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import acceleration, add_latency, earlier, lever_velocity
from gateway.fusion.state import ATT, BG, LATENCY, LEVER, N_FULL, POS, THETA, VEL, State
from gateway.fusion.usbl import ArrayGeometry
from gateway.nav.lie import left_jacobian, skew

Array = NDArray[np.float64]


class Doppler(NamedTuple):
    """Measured rates (n,) m/s, one an element or a single mean; white noise of each; (3,) beacon.

    ``by_element`` takes the rates as n rows; else their mean, with the noise of a mean, is one.
    """

    rates: Array
    sigma: float
    beacon_e: Array
    by_element: bool = False


def linearise(
    state: State, geometry: ArrayGeometry, elements_u: Array, doppler: Doppler
) -> Linearised | None:
    """Predict the rates at the state of the reception.

    Parameters
    ----------
    elements_u
        (k, 3) places of the elements in array axes (m).

    Returns
    -------
    z
        None if there are several rates but not as many as elements.
    """
    n = len(doppler.rates)
    if n not in (1, len(elements_u)):
        return None
    with_latency = state.latency_s != 0.0 or LATENCY in state.columns
    a_e = acceleration(state) if with_latency else np.zeros(3)
    state, omega_e = earlier(state)
    if state.latency_s != 0.0:
        state.v_eb_e[:] -= state.latency_s * a_e
    H = np.zeros((len(elements_u), N_FULL))
    rows = [
        _element_row(state, geometry, e, doppler.beacon_e, H[i]) for i, e in enumerate(elements_u)
    ]
    h, measured, names = np.array(rows), doppler.rates, _names(n)
    sigma = doppler.sigma
    if n == 1 or not doppler.by_element:
        h, measured, names = h.mean(keepdims=True), measured.mean(keepdims=True), _names(1)
        H = H.mean(axis=0, keepdims=True)
        sigma /= np.sqrt(n)
    by_velocity = H[:, VEL].copy()
    add_latency(state, omega_e, H)
    H[:, LATENCY] -= by_velocity @ a_e
    return Linearised(
        h - measured,
        np.ascontiguousarray(H[:, state.columns]),
        np.eye(len(h)) * sigma**2,
        names,
    )


def _names(n: int) -> tuple[str, ...]:
    return ("range_rate_m_s",) if n == 1 else tuple(f"range_rate_{i + 1}_m_s" for i in range(n))


def _element_row(
    state: State, geometry: ArrayGeometry, element_u: Array, beacon_e: Array, H: Array
) -> float:
    """Rate of one element's distance and its derivatives, (25,) zero on entry.  # (M.73), (M.74)"""
    C = state.C_eb
    e_b = state.C_theta @ geometry.C_bu @ element_u
    lever_b = geometry.lever_b + state.lever_b + e_b
    point = lever_velocity(state, lever_b)
    l_e = C @ lever_b
    a = state.r_e + l_e - beacon_e
    distance = float(np.sqrt(a @ a))
    u = a / distance
    rate = float(u @ point.v_e)
    across = (point.v_e - rate * u) / distance
    H[POS], H[VEL] = across, u
    H[ATT] = u @ point.by_attitude + skew(l_e) @ across
    H[BG] = u @ point.by_gyro_bias
    H[LEVER] = u @ point.by_lever + across @ C
    H[THETA] = -H[LEVER] @ skew(e_b) @ left_jacobian(state.theta)
    return rate
