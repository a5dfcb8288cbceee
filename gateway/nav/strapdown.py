"""Earth-frame strapdown with its covariance beside it: the hot loop, compiled in small kernels.

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

The covariance goes beside it, see `gateway.nav.covariance`. Nothing is allocated per sample: three
numbers are a tuple, and what is larger lives in its `Scratch`.

`NUMBA_DISABLE_JIT=1` runs the same functions as plain Python.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gateway.nav.compiled import compiled
from gateway.nav.covariance import Scratch, blind_of, give, predict_rows, scratch, take
from gateway.nav.earth import E2, GAMMA_E, M_RATIO, OMEGA_IE, SOMIGLIANA_K, A, F

Array = NDArray[np.float64]
Vec = tuple[float, float, float]

C_EB, V_EB_E, R_E = slice(0, 9), slice(9, 12), slice(12, 15)
B_G, B_A, S_E = slice(15, 18), slice(18, 21), slice(21, 24)
CHAIN, LAST = slice(24, 33), slice(33, 40)
N_MEAN = 40
"""Length of the mean without the constants of the measurement models."""
GAP_STEP_S = 0.1
"""In steps of at most so long a gap is gone through, for what it turns unseen turns gravity."""


@compiled
def gravity_e(r: Vec | Array) -> Vec:
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
    g = gravity_e(_plus(_three(x, 12), 0.5 * dt, _three(x, 9)))
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
def steps_of(row: Array, part: float) -> int:
    """Steps in which a `part` of a sample is gone through: one unless it stands in for many."""
    return 1 + int(part * row[7] / GAP_STEP_S)


@compiled
def _step(s: Scratch, x: Array, n: int, row: Array, part: float, q: Array) -> None:
    """Carry the mean, and the covariance in ``s.top``, over a `part` of a sample."""
    mechanise(x, row, part, s.u, s.C_mid)
    predict_rows(s, n, part * row[0], blind_of(row, part), x[12:15], q)


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
    s, steps = scratch(), steps_of(row, end - begin)
    take(P, s.top)
    for _ in range(steps):
        _step(s, x, P.shape[0], row, (end - begin) / steps, q)
    give(s.top, P)
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
        (4,) noise densities, see `gateway.nav.covariance.predict`.
    track
        (k, 12) out: ``S_E`` and ``CHAIN`` after each sample.
    """
    s = scratch()
    take(P, s.top)
    for k in range(rows.shape[0]):
        steps = steps_of(rows[k], 1.0)
        for _ in range(steps):
            _step(s, x, P.shape[0], rows[k], 1.0 / steps, q)
        _remember(x, rows[k])
        for i in range(12):
            track[k, i] = x[21 + i]
    give(s.top, P)
