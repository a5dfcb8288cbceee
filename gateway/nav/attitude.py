"""Euler angles and rotation matrices: ``C_nb = Rz(heading) Ry(pitch) Rx(roll)``, all in rad."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_GIMBAL_LOCK = 1e-12


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
    roll, pitch, heading = np.broadcast_arrays(roll, pitch, heading)
    sr, cr = np.sin(roll), np.cos(roll)
    sp, cp = np.sin(pitch), np.cos(pitch)
    sh, ch = np.sin(heading), np.cos(heading)
    forward = np.stack([cp * ch, cp * sh, -sp], axis=-1)
    right = np.stack([sr * sp * ch - cr * sh, sr * sp * sh + cr * ch, sr * cp], axis=-1)
    down = np.stack([cr * sp * ch + sr * sh, cr * sp * sh - sr * ch, cr * cp], axis=-1)
    return np.stack([forward, right, down], axis=-1)


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
    locked = cos_pitch < _GIMBAL_LOCK
    roll = np.where(locked, 0.0, np.arctan2(C[..., 2, 1], C[..., 2, 2]))
    heading = np.where(
        locked,
        np.arctan2(-C[..., 0, 1], C[..., 1, 1]),
        np.arctan2(C[..., 1, 0], C[..., 0, 0]),
    )
    return roll, pitch, heading
