"""The strapdown once more, with the transition of its error accumulated for a smoother.

Beside `gateway.nav.strapdown` and made of its kernels, so that the filter's own loop stays as it
is. Phi is kept as its first 15 rows and columns; the rest of it is the identity.
"""

import numpy as np
from numpy.typing import NDArray

from gateway.nav import covariance as cov
from gateway.nav import strapdown as sd
from gateway.nav.compiled import compiled

Array = NDArray[np.float64]

N_CORE, PITCH = cov.N_CORE, cov.PITCH


def identity() -> Array:
    """Phi of no time at all, (15, 28): the last columns are room that the kernels want."""
    Phi: Array = np.eye(N_CORE, PITCH)
    return Phi


def whole(Phi: Array, n: int) -> Array:
    """(n, n) transition of the covariance's error from the kernels' `Phi`."""
    out: Array = np.eye(n)
    out[:N_CORE, :N_CORE] = Phi[:, :N_CORE]
    return out


@compiled
def _step(s: cov.Scratch, x: Array, n: int, flat: Array, row: Array, part: float, q: Array) -> None:
    """`strapdown._step` that also carries ``Phi <- Phi_k Phi``.  # (M.100)"""
    sd._step(s, x, n, row, part, q)
    cov.apply_transition(flat, N_CORE, part * row[0], s.u, s.C_mid, s.gradient)


@compiled
def advance(x: Array, P: Array, Phi: Array, row: Array, begin: float, end: float, q: Array) -> None:
    """`strapdown.advance` that also carries ``Phi <- Phi_k Phi``.  # (M.100)"""
    s, flat, steps = cov.scratch(), Phi.reshape(-1), sd.steps_of(row, end - begin)
    cov.take(P, s.top)
    for _ in range(steps):
        _step(s, x, P.shape[0], flat, row, (end - begin) / steps, q)
    cov.give(s.top, P)
    if end == 1.0:
        sd._remember(x, row)


@compiled
def run(x: Array, P: Array, Phi: Array, rows: Array, q: Array, track: Array) -> None:
    """`strapdown.run` that also carries ``Phi <- Phi_k Phi``.  # (M.100)

    Parameters
    ----------
    x, P, rows, q, track
        As in `gateway.nav.strapdown.run`.
    Phi
        (15, 28) see `identity`, changed in place.
    """
    s, flat = cov.scratch(), Phi.reshape(-1)
    cov.take(P, s.top)
    for k in range(rows.shape[0]):
        steps = sd.steps_of(rows[k], 1.0)
        for _ in range(steps):
            _step(s, x, P.shape[0], flat, rows[k], 1.0 / steps, q)
        sd._remember(x, rows[k])
        for i in range(12):
            track[k, i] = x[21 + i]
    cov.give(s.top, P)
