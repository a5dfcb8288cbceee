"""Rotations SO(3): exponential, logarithm and left Jacobian."""

import math

import numpy as np
from numpy.typing import NDArray

from gateway.nav.compiled import compiled

Array = NDArray[np.float64]

_SMALL = 1e-4
"""Angle (rad) below which the series are exact to rounding."""


@compiled
def skew(a: Array) -> Array:
    """Matrix [a]x with ``skew(a) @ b == cross(a, b)``; (3,) -> (3, 3)."""
    K = np.zeros((3, 3))
    K[0, 1], K[0, 2], K[1, 2] = -a[2], a[1], -a[0]
    K[1, 0], K[2, 0], K[2, 1] = a[2], -a[1], a[0]
    return K


@compiled
def _sine_terms(t: float) -> tuple[float, float, float]:
    """Give sin(t)/t, (1 - cos t)/t^2 (by the half angle) and (t - sin t)/t^3, series near zero."""
    if t < _SMALL:
        t2 = t * t
        return 1.0 - t2 / 6.0, 0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0
    return math.sin(t) / t, 2.0 * (math.sin(0.5 * t) / t) ** 2, (t - math.sin(t)) / t**3


@compiled
def exp_so3(phi: Array) -> Array:
    """Rotation matrix of the rotation vector `phi` (rad); (3,) -> (3, 3).  # (M.1)"""
    a, b, _ = _sine_terms(math.sqrt(phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2))
    K = skew(phi)
    return np.eye(3) + a * K + b * (K @ K)


def log_so3(C: Array) -> Array:
    """Rotation vector of a rotation matrix, |phi| <= pi; (3, 3) -> (3,).

    Through the quaternion, so that it holds near pi as well.
    """
    K = np.array(
        [
            [C[0, 0] - C[1, 1] - C[2, 2], 0.0, 0.0, 0.0],
            [C[0, 1] + C[1, 0], C[1, 1] - C[0, 0] - C[2, 2], 0.0, 0.0],
            [C[0, 2] + C[2, 0], C[1, 2] + C[2, 1], C[2, 2] - C[0, 0] - C[1, 1], 0.0],
            [C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1], np.trace(C)],
        ]
    )
    q = np.linalg.eigh(K / 3.0)[1][:, -1]
    if q[3] < 0.0:
        q = -q
    norm = float(np.linalg.norm(q[:3]))
    if norm < 1e-9:
        return np.asarray(2.0 * q[:3])
    return np.asarray(2.0 * math.atan2(norm, q[3]) / norm * q[:3])


@compiled
def left_jacobian(phi: Array) -> Array:
    """J with exp(phi + d) = exp(J d) exp(phi) to first order; (3,) -> (3, 3).  # (M.2)"""
    _, b, c = _sine_terms(math.sqrt(phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2))
    K = skew(phi)
    return np.eye(3) + b * K + c * (K @ K)


@compiled
def orthonormal(C: Array) -> Array:
    """Nearest rotation matrix to one that has drifted by rounding (one Newton step)."""
    return 0.5 * C @ (3.0 * np.eye(3) - C.T @ C)
