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

`NUMBA_DISABLE_JIT=1` runs the same functions as plain Python.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gateway.nav.compiled import compiled
from gateway.nav.earth import E2, GAMMA_E, M_RATIO, OMEGA_IE, SOMIGLIANA_K, A, F

Array = NDArray[np.float64]

C_EB, V_EB_E, R_E = slice(0, 9), slice(9, 12), slice(12, 15)
B_G, B_A, S_E = slice(15, 18), slice(18, 21), slice(21, 24)
CHAIN, LAST = slice(24, 33), slice(33, 40)
N_MEAN = 40
"""Length of the mean without the constants of the measurement models."""

N_CORE = 15
"""Error states of the strapdown: attitude, velocity, position, gyro and accelerometer bias."""

GAP_TURN = 0.05**2
GAP_FORCE = 0.3**2
"""Density of the unseen changes of rate ((rad/s)^2/s) and of specific force ((m/s^2)^2/s) in a gap:
a vessel in a seaway. They are integrated once over the time missing."""


@compiled
def _gravity(r: Array, g: Array) -> None:
    """Normal gravity with the centrifugal part at ECEF `r`, resolved in e, into `g`.  # (M.10)

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
    if p > 0.0:
        g[0], g[1] = -gh * c * r[0] / p, -gh * c * r[1] / p
    else:
        g[0], g[1] = 0.0, 0.0
    g[2] = -gh * s


@compiled
def _rotate(x: Array, at: int, phi: Array, earth: float) -> None:
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
def _cross(a: Array, b: Array, k: float, out: Array) -> None:
    """Add ``k a x b`` to `out`."""
    out[0] += k * (a[1] * b[2] - a[2] * b[1])
    out[1] += k * (a[2] * b[0] - a[0] * b[2])
    out[2] += k * (a[0] * b[1] - a[1] * b[0])


@compiled
def _compensate(x: Array, row: Array, part: float, phi: Array, dvs: Array) -> None:
    """Rotation vector and velocity increment, in the axes of the start, of a `part` of one sample.

    Biases off, coning and sculling from the sample before, rotation during the part to third
    order: at 100 Hz in a seaway the last term is worth 0.1 m in 400 s.  # (M.12), (M.13)

    A part of a sample is the same motion for a shorter time: a measurement may split it anywhere.
    """
    dth, dvl = np.empty(3), np.empty(3)
    dth0, dvl0 = np.empty(3), np.empty(3)
    turned = np.zeros(3)
    for i in range(3):
        dth[i] = row[1 + i] - x[15 + i] * row[0]
        dvl[i] = row[4 + i] - x[18 + i] * row[0]
        dth0[i] = x[34 + i] - x[15 + i] * x[33]
        dvl0[i] = x[37 + i] - x[18 + i] * x[33]
        phi[i] = part * dth[i]
        dvs[i] = part * dvl[i]
    _cross(dth0, dth, part / 12.0, phi)
    _cross(dth, dvl, part * part / 2.0, turned)
    for i in range(3):
        dvs[i] += turned[i]
    _cross(dth, turned, part / 3.0, dvs)
    _cross(dth0, dvl, part / 12.0, dvs)
    _cross(dvl0, dth, part / 12.0, dvs)


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
    phi, dvs, g = np.empty(3), np.empty(3), np.empty(3)
    _compensate(x, row, part, phi, dvs)
    for i in range(3):
        k = 3 * i
        u[i] = x[k] * dvs[0] + x[k + 1] * dvs[1] + x[k + 2] * dvs[2]
        for j in range(3):
            C_mid[i, j] = 0.5 * x[k + j]
    half = 0.5 * dt * OMEGA_IE
    u0 = u[0]
    u[0] += half * u[1]
    u[1] -= half * u0
    r_mid = np.empty(3)
    for i in range(3):
        r_mid[i] = x[12 + i] + 0.5 * dt * x[9 + i]
    _gravity(r_mid, g)
    vm0 = x[9] + 0.5 * (u[0] + g[0] * dt)
    vm1 = x[10] + 0.5 * (u[1] + g[1] * dt)
    dv0 = u[0] + (g[0] + 2.0 * OMEGA_IE * vm1) * dt
    dv1 = u[1] + (g[1] - 2.0 * OMEGA_IE * vm0) * dt
    dv2 = u[2] + g[2] * dt
    for i in range(3):
        dv = dv0 if i == 0 else (dv1 if i == 1 else dv2)
        ds = dt * (x[9 + i] + 0.5 * dv)
        x[9 + i] += dv
        x[12 + i] += ds
        x[21 + i] += ds
    _rotate(x, 0, phi, OMEGA_IE * dt)
    _rotate(x, 24, phi, OMEGA_IE * dt)
    for i in range(3):
        for j in range(3):
            C_mid[i, j] += 0.5 * x[3 * i + j]


@compiled
def _transition(M: Array, dt: float, u: Array, C: Array, gradient: Array, out: Array) -> None:
    """``out = Phi M`` for the nine rows that Phi changes; `M` is (n, m), `out` (9, m).  # (M.16)"""
    wd = OMEGA_IE * dt
    for j in range(M.shape[1]):
        p0, p1, p2 = M[0, j], M[1, j], M[2, j]
        b0, b1, b2 = M[9, j], M[10, j], M[11, j]
        a0, a1, a2 = M[12, j], M[13, j], M[14, j]
        g0 = -dt * (C[0, 0] * b0 + C[0, 1] * b1 + C[0, 2] * b2)
        g1 = -dt * (C[1, 0] * b0 + C[1, 1] * b1 + C[1, 2] * b2)
        g2 = -dt * (C[2, 0] * b0 + C[2, 1] * b1 + C[2, 2] * b2)
        out[0, j] = p0 + wd * p1 + g0
        out[1, j] = p1 - wd * p0 + g1
        out[2, j] = p2 + g2
        m0, m1, m2 = p0 + 0.5 * g0, p1 + 0.5 * g1, p2 + 0.5 * g2
        r0, r1, r2 = M[6, j], M[7, j], M[8, j]
        v0, v1, v2 = M[3, j], M[4, j], M[5, j]
        f0 = (u[2] * m1 - u[1] * m2) - dt * (C[0, 0] * a0 + C[0, 1] * a1 + C[0, 2] * a2)
        f1 = (u[0] * m2 - u[2] * m0) - dt * (C[1, 0] * a0 + C[1, 1] * a1 + C[1, 2] * a2)
        f2 = (u[1] * m0 - u[0] * m1) - dt * (C[2, 0] * a0 + C[2, 1] * a1 + C[2, 2] * a2)
        f0 += dt * (gradient[0, 0] * r0 + gradient[0, 1] * r1 + gradient[0, 2] * r2)
        f1 += dt * (gradient[1, 0] * r0 + gradient[1, 1] * r1 + gradient[1, 2] * r2)
        f2 += dt * (gradient[2, 0] * r0 + gradient[2, 1] * r1 + gradient[2, 2] * r2)
        out[3, j] = v0 + f0 + 2.0 * wd * v1
        out[4, j] = v1 + f1 - 2.0 * wd * v0
        out[5, j] = v2 + f2
        out[6, j] = r0 + dt * (v0 + 0.5 * f0)
        out[7, j] = r1 + dt * (v1 + 0.5 * f1)
        out[8, j] = r2 + dt * (v2 + 0.5 * f2)


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
def predict(
    P: Array, dt: float, missing: float, u: Array, C_mid: Array, r_e: Array, q: Array
) -> None:
    """``P <- Phi P Phi^T + Q`` in place, block by block.  # (M.16), (M.17)

    Parameters
    ----------
    P
        (n, n) covariance of the additive error, n >= 15.
    dt, u, C_mid, r_e
        Interval and, from `mechanise`, the velocity increment, the middle attitude; the position.
    missing
        Part of the interval that no data covered (s).
    q
        (4,) spectral densities of angle and velocity random walk and of the bias walks, SI units.
    """
    n = P.shape[0]
    gradient = np.empty((3, 3))
    _gravity_gradient(r_e, gradient)
    top = np.empty((9, n))
    _transition(P, dt, u, C_mid, gradient, top)
    for i in range(9):
        for j in range(9, n):
            P[i, j] = top[i, j]
            P[j, i] = top[i, j]
    square = np.empty((9, 9))
    _transition(top.T, dt, u, C_mid, gradient, square)
    for i in range(9):
        for j in range(i + 1):
            m = 0.5 * (square[i, j] + square[j, i])
            P[i, j] = m
            P[j, i] = m
    blind = missing * missing * missing / 3.0
    for i in range(3):
        P[i, i] += q[0] * dt + GAP_TURN * blind
        P[3 + i, 3 + i] += q[1] * dt + GAP_FORCE * blind
        P[9 + i, 9 + i] += q[2] * dt
        P[12 + i, 12 + i] += q[3] * dt


@compiled
def advance(x: Array, P: Array, row: Array, begin: float, end: float, q: Array) -> None:
    """Carry mean and covariance over the share ``begin..end`` of one sample's interval."""
    u, C_mid = np.empty(3), np.empty((3, 3))
    part = end - begin
    mechanise(x, row, part, u, C_mid)
    predict(P, part * row[0], part * row[7], u, C_mid, x[12:15], q)
    if end == 1.0:
        for i in range(7):
            x[33 + i] = row[i]


@compiled
def run(x: Array, P: Array, rows: Array, q: Array, track: Array) -> None:
    """Carry mean and covariance over whole samples, noting the displacement and attitude chain.

    Parameters
    ----------
    x, P
        Mean and covariance, changed in place.
    rows
        (k, 8) increments, oldest first.
    q
        (4,) noise densities, see `predict`.
    track
        (k, 12) out: ``S_E`` and ``CHAIN`` after each sample.
    """
    for k in range(rows.shape[0]):
        advance(x, P, rows[k], 0.0, 1.0, q)
        for i in range(12):
            track[k, i] = x[21 + i]
