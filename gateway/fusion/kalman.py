"""The Kalman update for one measurement, in the coordinates of an error definition."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.errors import ErrorDefinition, from_additive, retract, to_additive
from gateway.fusion.state import State
from gateway.nav.compiled import compiled

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Linearised:
    """A measurement of m rows about the current estimate.

    Attributes
    ----------
    residual
        (m,) ``h(estimate) - measured``, angles wrapped.
    H
        (m, n) derivative of ``h`` by the additive error, ``residual = H xi - noise``.
    R
        (m, m) covariance of the noise.
    names
        (m) names of the rows; a row in radians ends in ``_deg``, what it is shown in.
    """

    residual: Array
    H: Array
    R: Array
    names: tuple[str, ...] = ()


def innovation_covariance(P: Array, z: Linearised) -> Array:
    """S = H P H^T + R, (m, m).  # (M.30)"""
    S: Array = z.H @ P @ z.H.T + z.R
    return 0.5 * (S + S.T)


def normalised_square(residual: Array, S: Array) -> float:
    """NIS: residual^T S^-1 residual, chi-squared with m degrees of freedom.  # (M.31)"""
    return float(residual @ np.linalg.solve(S, residual))


def update(state: State, z: Linearised, error: ErrorDefinition, origin_e: Array) -> None:
    """Correct `state` in place.  # (M.32)-(M.35)"""
    delta = _update(state.x, state.P, z.residual, z.H, z.R, error.kind, origin_e)
    state.add_constants(delta[9:])


@compiled
def _update(
    x: Array, P: Array, residual: Array, H: Array, R: Array, kind: int, origin_e: Array
) -> Array:
    """Correct the pose in `x`, carry `P` with it, and give the whole correction (n,).  # (M.35)

    What carries P, a matrix that acts on the pose and nothing else, is taken into the factors of
    the Joseph form: one product of large matrices less.
    """
    K = _gain(P, H, R)
    delta = -(K @ residual)
    before = from_additive(kind, x, origin_e)
    retract(kind, x, before @ delta[:9], origin_e)
    A = np.eye(P.shape[0]) - K @ H
    if kind != 0:
        X = to_additive(kind, x, origin_e) @ before
        A[:9] = X @ A[:9]
        K[:9] = X @ K[:9]
    _joseph(P, A, K, R)
    return delta


@compiled
def _gain(P: Array, H: Array, R: Array) -> Array:
    """K = P H^T S^-1, (n, m), by the Cholesky factor of S.  # (M.32)"""
    n, m = P.shape[0], H.shape[0]
    K = np.zeros((n, m))
    for i in range(n):
        for j in range(m):
            for k in range(n):
                K[i, j] += P[i, k] * H[j, k]
    L = np.zeros((m, m))
    for i in range(m):
        for j in range(i + 1):
            s = 0.5 * (R[i, j] + R[j, i])
            for k in range(n):
                s += H[i, k] * K[k, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j and not s > 0.0:
                s = R[i, i]  # P H^T lost to rounding: S is not less than R
            L[i, j] = math.sqrt(s) if i == j else s / L[j, j]
    for i in range(n):
        for j in range(m):
            for k in range(j):
                K[i, j] -= L[j, k] * K[i, k]
            K[i, j] /= L[j, j]
        for j in range(m - 1, -1, -1):
            for k in range(j + 1, m):
                K[i, j] -= L[k, j] * K[i, k]
            K[i, j] /= L[j, j]
    return K


@compiled
def _joseph(P: Array, A: Array, K: Array, R: Array) -> None:
    """P <- A P A^T + K R K^T, in place and symmetric; A is (I - K H).  # (M.33)

    As a product of three matrices: the short forms lose definiteness to rounding when a precise
    measurement meets a large variance.
    """
    new = A @ P @ np.ascontiguousarray(A.T) + K @ R @ np.ascontiguousarray(K.T)
    for i in range(P.shape[0]):
        for j in range(i + 1):
            P[i, j] = P[j, i] = 0.5 * (new[i, j] + new[j, i])
