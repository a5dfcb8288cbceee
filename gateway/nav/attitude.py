"""Euler angles and rotation matrices: ``C_nb = Rz(heading) Ry(pitch) Rx(roll)``, all in rad."""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

GIMBAL_LOCK = 1e-12

T = TypeVar("T", float, Array)


def turn(angle: T, full: float = 2.0 * math.pi) -> T:
    """The short way round to an angle: from minus half a turn up to half of it.

    Parameters
    ----------
    angle
        (...) in the unit of `full`.
    full
        A whole turn: 2 pi rad, or 360 deg.
    """
    return (angle + 0.5 * full) % full - 0.5 * full


def C_from_euler(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> Array:
    """Matrix of an attitude: turns body (forward-right-down) into navigation coordinates.

    Parameters
    ----------
    roll, pitch, heading
        (...) rad.

    Returns
    -------
    C_nb
        (..., 3, 3) with ``v_n = C_nb @ v_b``.
    """
    sr, cr = np.sin(roll), np.cos(roll)
    sp, cp = np.sin(pitch), np.cos(pitch)
    sh, ch = np.sin(heading), np.cos(heading)
    C = np.empty((*np.broadcast_shapes(*map(np.shape, (roll, pitch, heading))), 3, 3))
    C[..., 0, 0], C[..., 1, 0], C[..., 2, 0] = cp * ch, cp * sh, -sp
    C[..., 0, 1], C[..., 1, 1] = sr * sp * ch - cr * sh, sr * sp * sh + cr * ch
    C[..., 0, 2], C[..., 1, 2] = cr * sp * ch + sr * sh, cr * sp * sh - sr * ch
    C[..., 2, 1], C[..., 2, 2] = sr * cp, cr * cp
    return C


def euler_error_map(pitch: float, heading: float) -> Array:
    """How errors of the Euler angles turn the vehicle.

    Returns
    -------
    M
        (3, 3) with ``phi_n = M @ [d_roll, d_pitch, d_heading]``, the rotation vector in NED axes.
    """
    sp, cp, sh, ch = np.sin(pitch), np.cos(pitch), np.sin(heading), np.cos(heading)
    return np.array([[cp * ch, -sh, 0.0], [cp * sh, ch, 0.0], [-sp, 0.0, 1.0]])


def euler_from_C(C_nb: ArrayLike) -> tuple[Array, Array, Array]:
    """Attitude of a matrix.

    Straight up or down, where roll and heading turn about one axis, the roll is taken as zero.

    Parameters
    ----------
    C_nb
        (..., 3, 3).

    Returns
    -------
    roll, pitch, heading
        (...) rad; roll and heading in (-pi, pi], pitch in [-pi/2, pi/2].
    """
    C = np.asarray(C_nb, dtype=np.float64)
    cos_pitch = np.hypot(C[..., 0, 0], C[..., 1, 0])
    pitch = np.arctan2(-C[..., 2, 0], cos_pitch)
    locked = cos_pitch < GIMBAL_LOCK
    roll = np.where(locked, 0.0, np.arctan2(C[..., 2, 1], C[..., 2, 2]))
    heading = np.where(
        locked,
        np.arctan2(-C[..., 0, 1], C[..., 1, 1]),
        np.arctan2(C[..., 1, 0], C[..., 0, 0]),
    )
    return roll, pitch, heading
