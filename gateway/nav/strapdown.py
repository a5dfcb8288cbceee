"""Earth-frame strapdown and covariance prediction: the hot loop, compiled in small kernels.

The mean is one flat vector, so that a snapshot is a copy and a kernel call passes few arrays:

==========  ====  =================================================================================
slice       size  meaning
==========  ====  =================================================================================
``C_EB``    9     rotation body -> ECEF, row by row
``V_EB_E``  3     velocity relative to the Earth, resolved in e (m/s)
``R_E``     3     position in ECEF (m)
``B_G``     3     gyro bias (rad/s): measured = true + bias
``B_A``     3     accelerometer bias (m/s^2)
``S_E``     3     integral of the velocity (m): displacement without position feedback
``CHAIN``   9     attitude propagated without feedback, for the attitude at a past moment
``LAST``    7     dt, angle and velocity increment of the previous sample, as measured
``AUX``     n     constants of the measurement models, see `gateway.fusion.state`
==========  ====  =================================================================================

The covariance is that of the additive error ``[phi_e, dv_e, dr_e, db_g, db_a, constants]``
(estimate minus truth, attitude error on the left): F is sparse there, and `gateway.fusion.errors`
maps it to the error definition in use.

Nothing is allocated per sample: three numbers are a tuple, and what is larger lives in `_Scratch`,
in rows of fixed pitch, whose distance the compiler knows when it forms vector instructions.

`NUMBA_DISABLE_JIT=1` runs the same functions as plain Python.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.nav.compiled import compiled
from gateway.nav.earth import E2, GAMMA_E, M_RATIO, OMEGA_IE, SOMIGLIANA_K, A, F

Array = NDArray[np.float64]
Vec = tuple[float, float, float]

C_EB, V_EB_E, R_E = slice(0, 9), slice(9, 12), slice(12, 15)
B_G, B_A, S_E = slice(15, 18), slice(18, 21), slice(21, 24)
CHAIN, LAST = slice(24, 33), slice(33, 40)
N_MEAN = 40
"""Length of the mean without the constants of the measurement models."""

N_CORE = 15
"""Error states of the strapdown: attitude, velocity, position, gyro and accelerometer bias."""

PITCH = 28
"""Length of the rows in which a covariance is kept at work, and the largest n: a whole number of
vector registers, for with any other the compiler makes no vector instructions."""

GAP_TURN = 0.05**2
GAP_FORCE = 0.3**2
"""Density of the unseen changes of rate ((rad/s)^2/s) and of specific force ((m/s^2)^2/s) in a gap:
a vessel in a seaway. They are integrated once over the time missing."""
GAP_STEP_S = 0.1
"""In steps of at most so long a gap is gone through, for what it turns unseen turns gravity."""


class _Scratch(NamedTuple):
    """Room for the work on one sample.

    ``u``, ``C_mid`` are those of `mechanise`, ``gradient`` that of gravity. ``top`` holds the first
    15 rows of the covariance, the only ones that change but for their mirror; ``square`` columns
    of the first nine, turned.
    """

    u: Array
    C_mid: Array
    gradient: Array
    top: Array
    square: Array


@compiled
def _scratch() -> _Scratch:
    """Fresh room; zeros, so that nothing undefined is ever computed with."""
    return _Scratch(
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros(N_CORE * PITCH),
        np.zeros(N_CORE * PITCH),
    )


@compiled
def _gravity(r: Vec | Array) -> Vec:
    """Normal gravity with the centrifugal part at ECEF `r`, resolved in e.  # (M.10)

    Latitude by Bowring's formula (once is exact to 1e-11 rad near the Earth's surface),
    Somigliana's formula and the second-order free-air reduction.
    """
    p = math.hypot(r[0], r[1])
    b = A * (1.0 - F)
    t = math.atan2(r[2] * A, p * b)
    lat = math.atan2(r[2] + E2 / (1.0 - E2) * b * math.sin(t) ** 3, p - E2 * A * math.cos(t) ** 3)
    s, c = math.sin(lat), math.cos(lat)
    w = math.sqrt(1.0 - E2 * s * s)
    h = p * c + r[2] * s - A * w
    g0 = GAMMA_E * (1.0 + SOMIGLIANA_K * s * s) / w
    gh = g0 * (1.0 - 2.0 / A * (1.0 + F + M_RATIO - 2.0 * F * s * s) * h + 3.0 * h * h / (A * A))
    if not p > 0.0:
        return 0.0, 0.0, -gh * s
    return -gh * c * r[0] / p, -gh * c * r[1] / p, -gh * s


@compiled
def _rotate(x: Array, at: int, phi: Vec, earth: float) -> None:
    """C <- Exp(-w_ie dt) C Exp(phi) for the matrix that begins at ``x[at]``.  # (M.11)"""
    t2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    if t2 < 1e-8:
        a, b = 1.0 - t2 / 6.0, 0.5 - t2 / 24.0
    else:
        t = math.sqrt(t2)
        a, b = math.sin(t) / t, (1.0 - math.cos(t)) / t2
    x1, y1, z1 = a * phi[0], a * phi[1], a * phi[2]
    e00 = 1.0 - b * (phi[1] * phi[1] + phi[2] * phi[2])
    e11 = 1.0 - b * (phi[0] * phi[0] + phi[2] * phi[2])
    e22 = 1.0 - b * (phi[0] * phi[0] + phi[1] * phi[1])
    xy, xz, yz = b * phi[0] * phi[1], b * phi[0] * phi[2], b * phi[1] * phi[2]
    for i in range(3):
        k = at + 3 * i
        c0, c1, c2 = x[k], x[k + 1], x[k + 2]
        x[k] = c0 * e00 + c1 * (xy + z1) + c2 * (xz - y1)
        x[k + 1] = c0 * (xy - z1) + c1 * e11 + c2 * (yz + x1)
        x[k + 2] = c0 * (xz + y1) + c1 * (yz - x1) + c2 * e22
    ce, se = math.cos(earth), math.sin(earth)
    for j in range(3):
        top, below = x[at + j], x[at + 3 + j]
        x[at + j] = ce * top + se * below
        x[at + 3 + j] = ce * below - se * top


@compiled
def _cross(a: Vec, b: Vec) -> Vec:
    """``a x b``."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _plus(a: Vec, k: float, b: Vec) -> Vec:
    """``a + k b``."""
    return a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]


@compiled
def _three(x: Array, at: int) -> Vec:
    """The three numbers that begin at ``x[at]``."""
    return x[at], x[at + 1], x[at + 2]


@compiled
def _compensate(x: Array, row: Array, part: float) -> tuple[Vec, Vec]:
    """Rotation vector and velocity increment, in the axes of the start, of a `part` of one sample.

    Biases off, coning and sculling from the sample before, rotation during the part to third
    order: at 100 Hz in a seaway the last term is worth 0.1 m in 400 s.  # (M.12), (M.13)

    A part of a sample is the same motion for a shorter time: a measurement may split it anywhere.
    """
    zero, b_g, b_a = (0.0, 0.0, 0.0), _three(x, 15), _three(x, 18)
    dth, dvl = _plus(_three(row, 1), -row[0], b_g), _plus(_three(row, 4), -row[0], b_a)
    dth0, dvl0 = _plus(_three(x, 34), -x[33], b_g), _plus(_three(x, 37), -x[33], b_a)
    phi = _plus(_plus(zero, part, dth), part / 12.0, _cross(dth0, dth))
    turned = _plus(zero, part * part / 2.0, _cross(dth, dvl))
    dvs = _plus(_plus(turned, part, dvl), part / 3.0, _cross(dth, turned))
    sculling = _plus(_cross(dth0, dvl), 1.0, _cross(dvl0, dth))
    return phi, _plus(dvs, part / 12.0, sculling)


@compiled
def mechanise(x: Array, row: Array, part: float, u: Array, C_mid: Array) -> None:
    """Carry the mean over a `part` of one sample.  # (M.11)-(M.14)

    Parameters
    ----------
    x
        (N,) mean, changed in place.
    row
        (8,) increments of the whole sample.
    part
        Share of the sample's interval, in (0, 1].
    u, C_mid
        (3,) velocity increment by specific force, resolved in e, and (3, 3) attitude at the middle:
        given back for the covariance.
    """
    dt = part * row[0]
    phi, dvs = _compensate(x, row, part)
    for i in range(3):
        k = 3 * i
        u[i] = x[k] * dvs[0] + x[k + 1] * dvs[1] + x[k + 2] * dvs[2]
        for j in range(3):
            C_mid[i, j] = 0.5 * x[k + j]
    half = 0.5 * dt * OMEGA_IE
    u0 = u[0]
    u[0] += half * u[1]
    u[1] -= half * u0
    g = _gravity(_plus(_three(x, 12), 0.5 * dt, _three(x, 9)))
    vm0 = x[9] + 0.5 * (u[0] + g[0] * dt)
    vm1 = x[10] + 0.5 * (u[1] + g[1] * dt)
    dv = (
        u[0] + (g[0] + 2.0 * OMEGA_IE * vm1) * dt,
        u[1] + (g[1] - 2.0 * OMEGA_IE * vm0) * dt,
        u[2] + g[2] * dt,
    )
    for i in range(3):
        ds = dt * (x[9 + i] + 0.5 * dv[i])
        x[9 + i] += dv[i]
        x[12 + i] += ds
        x[21 + i] += ds
    _rotate(x, 0, phi, OMEGA_IE * dt)
    _rotate(x, 24, phi, OMEGA_IE * dt)
    for i in range(3):
        for j in range(3):
            C_mid[i, j] += 0.5 * x[3 * i + j]


@compiled
def _transition(M: Array, columns: int, dt: float, u: Array, C: Array, gradient: Array) -> None:
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
def _take(P: Array, top: Array) -> None:
    """Copy the first 15 rows of `P` to where the work on them is done."""
    if P.shape[0] > PITCH:
        raise ValueError("more states than the strapdown has room for")
    for i in range(N_CORE):
        for j in range(P.shape[0]):
            top[i * PITCH + j] = P[i, j]


@compiled
def _give(top: Array, P: Array) -> None:
    """Copy the rows back, and their mirror."""
    for i in range(N_CORE):
        for j in range(P.shape[0]):
            P[i, j] = top[i * PITCH + j]
            P[j, i] = top[i * PITCH + j]


@compiled
def _predict(s: _Scratch, n: int, dt: float, blind: float, r_e: Array, q: Array) -> None:
    """``P <- Phi P Phi^T + Q`` for the rows in ``s.top``, block by block.  # (M.16), (M.17)"""
    top, square = s.top, s.square
    _gravity_gradient(r_e, s.gradient)
    _transition(top, n, dt, s.u, s.C_mid, s.gradient)
    for i in range(N_CORE):
        for j in range(9):
            square[i * PITCH + j] = top[j * PITCH + i]
    _transition(square, 9, dt, s.u, s.C_mid, s.gradient)
    for i in range(9):
        for j in range(9, N_CORE):
            top[j * PITCH + i] = top[i * PITCH + j]
        for j in range(9):
            top[i * PITCH + j] = 0.5 * (square[i * PITCH + j] + square[j * PITCH + i])
    for i in range(3):
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
        Interval and, from `mechanise`, the velocity increment, the middle attitude; the position.
    blind
        Double integral of an unseen change of unit density (s^3), see `blind_of`.
    q
        (4,) spectral densities of angle and velocity random walk and of the bias walks, SI units.
    """
    s = _scratch()
    s.u[:], s.C_mid[:] = u, C_mid
    _take(P, s.top)
    _predict(s, P.shape[0], dt, blind, r_e, q)
    _give(s.top, P)


@compiled
def steps_of(row: Array, part: float) -> int:
    """Steps in which a `part` of a sample is gone through: one unless it stands in for many."""
    return 1 + int(part * row[7] / GAP_STEP_S)


@compiled
def blind_of(row: Array, part: float) -> float:
    """What `predict` wants to know of the time that a `part` of a sample stands in for.  # (M.17)

    As much in any split: a gap in which fixes come is as blind as one without.
    """
    return float(part * row[7] ** 3 / 3.0)


@compiled
def _step(s: _Scratch, x: Array, n: int, row: Array, part: float, q: Array) -> None:
    """Carry the mean, and the covariance in ``s.top``, over a `part` of a sample."""
    mechanise(x, row, part, s.u, s.C_mid)
    _predict(s, n, part * row[0], blind_of(row, part), x[12:15], q)


@compiled
def _remember(x: Array, row: Array) -> None:
    """Keep a sample for the coning and sculling of the next."""
    for i in range(7):
        x[33 + i] = row[i]


@compiled
def advance(x: Array, P: Array, row: Array, begin: float, end: float, q: Array) -> None:
    """Carry mean and covariance over the share ``begin..end`` of one sample's interval.

    Parameters
    ----------
    x, P, q
        As in `run`.
    row
        (8,) increments of the whole sample.
    begin, end
        Shares of its interval, 0 <= begin < end <= 1.
    """
    s, steps = _scratch(), steps_of(row, end - begin)
    _take(P, s.top)
    for _ in range(steps):
        _step(s, x, P.shape[0], row, (end - begin) / steps, q)
    _give(s.top, P)
    if end == 1.0:
        _remember(x, row)


@compiled
def run(x: Array, P: Array, rows: Array, q: Array, track: Array) -> None:
    """Carry mean and covariance over whole samples, noting the displacement and attitude chain.

    Parameters
    ----------
    x
        (40 + constants,) mean, changed in place.
    P
        (n, n) covariance of its additive error, 15 <= n <= 28, changed in place.
    rows
        (k, 8) increments, oldest first, see `gateway.messages.ImuBlock`.
    q
        (4,) noise densities, see `predict`.
    track
        (k, 12) out: ``S_E`` and ``CHAIN`` after each sample.
    """
    s = _scratch()
    _take(P, s.top)
    for k in range(rows.shape[0]):
        steps = steps_of(rows[k], 1.0)
        for _ in range(steps):
            _step(s, x, P.shape[0], rows[k], 1.0 / steps, q)
        _remember(x, rows[k])
        for i in range(12):
            track[k, i] = x[21 + i]
    _give(s.top, P)
