"""Local axes, the body's rate, the velocity of a lever arm, the state a moment earlier."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.state import ATT, LATENCY, POS, VEL, State
from gateway.nav import strapdown as sd
from gateway.nav.earth import OMEGA_IE, C_en, ecef_to_lla, gravity_n
from gateway.nav.lie import exp_so3, skew

Array = NDArray[np.float64]

OMEGA_IE_E = np.array([0.0, 0.0, OMEGA_IE])


def C_ne(state: State) -> Array:
    """(3, 3) ECEF to north-east-down at the estimated place."""
    lat, lon, _ = ecef_to_lla(state.r_e)
    return C_en(lat, lon).T


def body_rate(state: State) -> Array:
    """(3,) omega_ib_b, rad/s, of the newest whole sample; zero before the first.  # (M.70)"""
    dt, increment = state.x[sd.LAST][0], state.x[sd.LAST][1:4]
    rate: Array = increment / dt - state.b_g if dt > 0.0 else np.zeros(3)
    return rate


class LeverVelocity(NamedTuple):
    """Velocity over the Earth of a point of the body, (3,) in e, with its (3, 3) derivatives.

    The attitude's derivative is of the part that the turning adds; the velocity's is the identity.
    """

    v_e: Array
    by_attitude: Array
    by_gyro_bias: Array
    by_lever: Array


def lever_velocity(state: State, lever_b: Array) -> LeverVelocity:
    """``v_eb_e + omega_eb_e x C_eb l``, the Earth's own turning taken out.  # (M.71)"""
    C = state.C_eb
    omega_ib_e = C @ body_rate(state)
    omega_eb_e = omega_ib_e - OMEGA_IE_E
    l_e = C @ lever_b
    L, W = skew(l_e), skew(omega_eb_e)
    return LeverVelocity(
        state.v_eb_e + W @ l_e,
        L @ skew(omega_ib_e) - W @ L,
        L @ C,
        W @ C,
    )


def acceleration(state: State) -> Array:
    """(3,) change of the velocity over the Earth in the newest whole sample (m/s^2, in e)."""
    dt, increment = state.x[sd.LAST][0], state.x[sd.LAST][4:7]
    if not dt > 0.0:
        return np.zeros(3)
    lat, lon, h = ecef_to_lla(state.r_e)
    gravity_e = C_en(lat, lon) @ gravity_n(lat, h)
    f_e = state.C_eb @ (increment / dt - state.b_a)
    change: Array = f_e + gravity_e - 2.0 * skew(OMEGA_IE_E) @ state.v_eb_e
    return change


def earlier(state: State) -> tuple[State, Array]:
    """The state ``latency_s`` before its stamp, and the body's rate in e (rad/s).  # (M.46)

    Position and attitude only: what depends on the velocity asks for `acceleration` itself.
    """
    omega_e = state.C_eb @ body_rate(state)
    latency = state.latency_s
    if latency != 0.0:
        state = state.copy()
        state.r_e[:] -= latency * state.v_eb_e
        state.C_eb[:] = exp_so3(-latency * omega_e) @ state.C_eb
    return state, omega_e


def add_latency(state: State, omega_e: Array, H: Array) -> None:
    """Complete the rows of acoustic models taken at the state that `earlier` gave.  # (M.46)"""
    H[:, LATENCY] = -(H[:, POS] @ state.v_eb_e + H[:, ATT] @ omega_e)
    H[:, VEL] -= state.latency_s * H[:, POS]
