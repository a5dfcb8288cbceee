"""The Kalman update for one measurement, in the coordinates of an error definition."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from gateway.fusion.errors import ErrorDefinition
from gateway.fusion.state import State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Linearised:
    """A measurement of m rows about the current estimate.

    Attributes
    ----------
    residual
        (m,) ``h(estimate) - measured``, angles wrapped.
    H
        (m, 21) derivative of ``h`` by the additive error, ``residual = H xi - noise``.
    R
        (m, m) covariance of the noise.
    """

    residual: Array
    H: Array
    R: Array


def innovation_covariance(P: Array, z: Linearised) -> Array:
    """S = H P H^T + R, (m, m).  # (M.30)"""
    S = z.H @ P @ z.H.T + z.R
    return np.asarray(0.5 * (S + S.T))


def normalised_square(residual: Array, S: Array) -> float:
    """NIS: residual^T S^-1 residual, chi-squared with m degrees of freedom.  # (M.31)"""
    return float(residual @ scipy.linalg.cho_solve(scipy.linalg.cho_factor(S), residual))


def update(state: State, z: Linearised, error: ErrorDefinition, origin_e: Array) -> None:
    """Correct `state` in place.  # (M.32)-(M.35)

    Covariance and H are mapped to the error definition's coordinates at the predicted mean, the
    correction is taken off by its boxplus, and the covariance (Joseph form) is mapped back at the
    corrected mean.
    """
    n = state.P.shape[0]
    T = np.eye(n)
    T[:9, :9] = error.to_additive(state, origin_e)
    T_inv = np.linalg.inv(T)
    P = T_inv @ state.P @ T_inv.T
    H = z.H @ T
    S = H @ P @ H.T + z.R
    K = scipy.linalg.cho_solve(scipy.linalg.cho_factor(0.5 * (S + S.T)), H @ P).T
    corrected = error.boxplus(state, -K @ z.residual, origin_e)
    state.x[:] = corrected.x
    I_KH = np.eye(n) - K @ H
    P = I_KH @ P @ I_KH.T + K @ z.R @ K.T
    T[:9, :9] = error.to_additive(state, origin_e)
    P = T @ P @ T.T
    state.P[:] = 0.5 * (P + P.T)
