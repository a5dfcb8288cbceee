"""The covariance of the strapdown's error over one sample, block by block, in place.

It is that of the additive error ``[phi_e, dv_e, dr_e, db_g, db_a, constants]`` (estimate minus
truth, attitude error on the left): F is sparse there, and `gateway.fusion.errors` maps it to the
error definition in use. Work is done in rows of fixed pitch, whose distance the compiler knows when
it forms vector instructions.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.nav.compiled import compiled
from gateway.nav.earth import OMEGA_IE

Array = NDArray[np.float64]

N_CORE = 15
"""Error states of the strapdown: attitude, velocity, position, gyro and accelerometer bias."""

PITCH = 28
"""Length of the rows in which a covariance is kept at work, and the largest n: a whole number of
vector registers, for with any other the compiler makes no vector instructions."""

GAP_TURN = 0.05**2
GAP_FORCE = 0.3**2
"""Density of the unseen changes of rate ((rad/s)^2/s) and of specific force ((m/s^2)^2/s) in a gap:
a vessel in a seaway. They are integrated once over the time missing."""

TILTED_S = 10.0
"""For how long a tilt may stay what it is."""


class Scratch(NamedTuple):
    """Room for the work on one sample.

    ``u``, ``C_mid`` are those of `gateway.nav.strapdown.mechanise`, ``gradient`` that of gravity.
    ``top`` holds the first 15 rows of the covariance, the only ones that change but for their
    mirror; ``square`` columns of the first nine, turned.
    """

    u: Array
    C_mid: Array
    gradient: Array
    top: Array
    square: Array


@compiled
def scratch() -> Scratch:
    """Fresh room; zeros, so that nothing undefined is ever computed with."""
    return Scratch(
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros(N_CORE * PITCH),
        np.zeros(N_CORE * PITCH),
    )


@compiled
def apply_transition(
    M: Array, columns: int, dt: float, u: Array, C: Array, gradient: Array
) -> None:
    """``M <- Phi M`` in place for `columns` columns, rows of `PITCH`, 15 of them.  # (M.16)"""
    wd = OMEGA_IE * dt
    u0, u1, u2 = u[0], u[1], u[2]
    c00, c01, c02 = dt * C[0, 0], dt * C[0, 1], dt * C[0, 2]
    c10, c11, c12 = dt * C[1, 0], dt * C[1, 1], dt * C[1, 2]
    c20, c21, c22 = dt * C[2, 0], dt * C[2, 1], dt * C[2, 2]
    d00, d11, d22 = dt * gradient[0, 0], dt * gradient[1, 1], dt * gradient[2, 2]
    d01, d02, d12 = dt * gradient[0, 1], dt * gradient[0, 2], dt * gradient[1, 2]
    for j in range(columns):
        p0, p1, p2 = M[j], M[j + PITCH], M[j + 2 * PITCH]
        v0, v1, v2 = M[j + 3 * PITCH], M[j + 4 * PITCH], M[j + 5 * PITCH]
        r0, r1, r2 = M[j + 6 * PITCH], M[j + 7 * PITCH], M[j + 8 * PITCH]
        b0, b1, b2 = M[j + 9 * PITCH], M[j + 10 * PITCH], M[j + 11 * PITCH]
        a0, a1, a2 = M[j + 12 * PITCH], M[j + 13 * PITCH], M[j + 14 * PITCH]
        g0 = -(c00 * b0 + c01 * b1 + c02 * b2)
        g1 = -(c10 * b0 + c11 * b1 + c12 * b2)
        g2 = -(c20 * b0 + c21 * b1 + c22 * b2)
        m0, m1, m2 = p0 + 0.5 * g0, p1 + 0.5 * g1, p2 + 0.5 * g2
        f0 = u2 * m1 - u1 * m2 - (c00 * a0 + c01 * a1 + c02 * a2)
        f1 = u0 * m2 - u2 * m0 - (c10 * a0 + c11 * a1 + c12 * a2)
        f2 = u1 * m0 - u0 * m1 - (c20 * a0 + c21 * a1 + c22 * a2)
        f0 += d00 * r0 + d01 * r1 + d02 * r2
        f1 += d01 * r0 + d11 * r1 + d12 * r2
        f2 += d02 * r0 + d12 * r1 + d22 * r2
        M[j] = p0 + wd * p1 + g0
        M[j + PITCH] = p1 - wd * p0 + g1
        M[j + 2 * PITCH] = p2 + g2
        M[j + 3 * PITCH] = v0 + f0 + 2.0 * wd * v1
        M[j + 4 * PITCH] = v1 + f1 - 2.0 * wd * v0
        M[j + 5 * PITCH] = v2 + f2
        M[j + 6 * PITCH] = r0 + dt * (v0 + 0.5 * f0)
        M[j + 7 * PITCH] = r1 + dt * (v1 + 0.5 * f1)
        M[j + 8 * PITCH] = r2 + dt * (v2 + 0.5 * f2)


@compiled
def _gravity_gradient(r: Array, out: Array) -> None:
    """Gradient of gravity, spherical: -(g/r)(I - 3 r r^T / r^2) (1/s^2).  # (M.15)"""
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    k = -9.81 / math.sqrt(r2)
    for i in range(3):
        for j in range(3):
            out[i, j] = -3.0 * k * r[i] * r[j] / r2
        out[i, i] += k


@compiled
def take(P: Array, top: Array) -> None:
    """Copy the first 15 rows of `P` to where the work on them is done."""
    if P.shape[0] > PITCH:
        raise ValueError("more states than the strapdown has room for")
    for i in range(N_CORE):
        for j in range(P.shape[0]):
            top[i * PITCH + j] = P[i, j]


@compiled
def give(top: Array, P: Array) -> None:
    """Copy the rows back, and their mirror."""
    for i in range(N_CORE):
        for j in range(P.shape[0]):
            P[i, j] = top[i * PITCH + j]
            P[j, i] = top[i * PITCH + j]


@compiled
def _bent(top: Array, r: Array) -> float:
    """Density of the vertical force that a tilt makes in second order, over |r|^2.  # (M.185)"""
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    tilt = 0.0
    for i in range(3):
        tilt += top[i * PITCH + i]
        for j in range(3):
            tilt -= r[i] * top[i * PITCH + j] * r[j] / r2
    force = 0.5 * 9.81 * tilt
    return float(force * force * TILTED_S / r2)


@compiled
def predict_rows(s: Scratch, n: int, dt: float, blind: float, r_e: Array, q: Array) -> None:
    """``P <- Phi P Phi^T + Q`` for the rows in ``s.top``, block by block.  # (M.16), (M.17)"""
    top, square = s.top, s.square
    _gravity_gradient(r_e, s.gradient)
    apply_transition(top, n, dt, s.u, s.C_mid, s.gradient)
    for i in range(N_CORE):
        for j in range(9):
            square[i * PITCH + j] = top[j * PITCH + i]
    apply_transition(square, 9, dt, s.u, s.C_mid, s.gradient)
    for i in range(9):
        for j in range(9, N_CORE):
            top[j * PITCH + i] = top[i * PITCH + j]
        for j in range(9):
            top[i * PITCH + j] = 0.5 * (square[i * PITCH + j] + square[j * PITCH + i])
    bent = _bent(top, r_e) * dt
    for i in range(3):
        for j in range(3):
            top[(3 + i) * PITCH + 3 + j] += bent * r_e[i] * r_e[j]
        top[i * PITCH + i] += q[0] * dt + GAP_TURN * blind
        top[(3 + i) * PITCH + 3 + i] += q[1] * dt + GAP_FORCE * blind
        top[(9 + i) * PITCH + 9 + i] += q[2] * dt
        top[(12 + i) * PITCH + 12 + i] += q[3] * dt


@compiled
def predict(
    P: Array, dt: float, blind: float, u: Array, C_mid: Array, r_e: Array, q: Array
) -> None:
    """``P <- Phi P Phi^T + Q`` in place, block by block.  # (M.16), (M.17)

    Parameters
    ----------
    P
        (n, n) covariance of the additive error, 15 <= n <= 28.
    dt, u, C_mid, r_e
        Interval (s); from `gateway.nav.strapdown.mechanise` the velocity increment (3,), resolved
        in e, and the attitude at the middle (3, 3); the position (3,) in ECEF (m).
    blind
        Double integral of an unseen change of unit density (s^3), see `blind_of`.
    q
        (4,) spectral densities of angle and velocity random walk and of the bias walks, SI units.
    """
    s = scratch()
    s.u[:], s.C_mid[:] = u, C_mid
    take(P, s.top)
    predict_rows(s, P.shape[0], dt, blind, r_e, q)
    give(s.top, P)


@compiled
def blind_of(row: Array, part: float) -> float:
    """What `predict` wants to know of the time that a `part` of a sample stands in for.  # (M.17)

    As much in any split: a gap in which fixes come is as blind as one without.
    """
    return float(part * row[7] ** 3 / 3.0)
