"""The Kalman update for one measurement, in the coordinates of an error definition."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.errors import ErrorDefinition, from_additive, retract, to_additive
from gateway.fusion.state import Columns, State, add_constants
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
    _update(state.x, state.P, state.columns, z.residual, z.H, z.R, error.kind, origin_e)


@compiled
def _update(
    x: Array,
    P: Array,
    columns: Columns,
    residual: Array,
    H: Array,
    R: Array,
    kind: int,
    origin_e: Array,
) -> None:
    """Correct `x`, and carry `P` with it.  # (M.34), (M.35)

    What carries P, a matrix that acts on the pose and nothing else, is taken into the factors of
    the Joseph form: one product of large matrices less.
    """
    K = np.ascontiguousarray(_gain(P, H, R).T)
    delta = -(K @ residual)
    before = from_additive(kind, x, origin_e)
    retract(kind, x, before @ delta[:9], origin_e)
    add_constants(x, columns, delta[9:])
    A = np.eye(P.shape[0]) - K @ H
    if kind != 0:
        X = to_additive(kind, x, origin_e) @ before
        A[:9] = X @ A[:9]
        K[:9] = X @ K[:9]
    _joseph(P, A, K, R)


@compiled
def _gain(P: Array, H: Array, R: Array) -> Array:
    """K^T = S^-1 H P, (m, n), by the Cholesky factor of S.  # (M.32)

    Transposed, for the compiler makes vector instructions of what runs along a row.
    """
    n, m = P.shape[0], H.shape[0]
    K_T = H @ P
    L = np.zeros((m, m))
    for i in range(m):
        for j in range(i + 1):
            s = 0.5 * (R[i, j] + R[j, i])
            for k in range(n):
                s += H[i, k] * K_T[j, k]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j and not s > 0.0:
                s = R[i, i]  # P H^T lost to rounding: S is not less than R
            L[i, j] = math.sqrt(s) if i == j else s / L[j, j]
    for i in range(m):
        for k in range(i):
            _add_row(K_T, i, k, -L[i, k])
        _scale_row(K_T, i, 1.0 / L[i, i])
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            _add_row(K_T, i, k, -L[k, i])
        _scale_row(K_T, i, 1.0 / L[i, i])
    return K_T


@compiled
def _add_row(M: Array, to: int, of: int, factor: float) -> None:
    for j in range(M.shape[1]):
        M[to, j] += factor * M[of, j]


@compiled
def _scale_row(M: Array, row: int, factor: float) -> None:
    for j in range(M.shape[1]):
        M[row, j] *= factor


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
