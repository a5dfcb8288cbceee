"""Heading of a window by the course of a vehicle that moves bow first."""

import math

import numpy as np
from numpy.typing import NDArray

from gateway.fusion import align
from gateway.messages import VelocityFix

Array = NDArray[np.float64]

MIN_SPEED = 0.5
"""Below this (m/s) a course is noise, and many receivers hold the last one."""


def heading_by_course(
    fixes: list[VelocityFix], C_nb: Array, v_arm_n: Array, sway_v: float, sigma_crab: float
) -> tuple[float, float]:
    """Heading at the first of `C_nb` by the mean way of the vehicle about its own bow.  # (M.132)

    Parameters
    ----------
    C_nb
        (1 + n, 3, 3) attitude at the beginning and at each of the n fixes; its heading need not be
        known: only the turn since the beginning counts.
    v_arm_n
        (n, 3) velocity of the antenna about the IMU, NED, m/s.
    sway_v
        rms of the horizontal velocity about its mean, each component, m/s.
    sigma_crab
        1-sigma of the angle between bow and course, rad.

    Returns
    -------
    heading, sigma
        rad; the sigma is infinite where the vehicle is slower than `MIN_SPEED`.
    """
    yaw = np.arctan2(C_nb[:, 1, 0], C_nb[:, 0, 0])
    north, east = (np.array([(fix.north, fix.east) for fix in fixes]) - v_arm_n[:, :2]).T
    way = np.mean((north + 1j * east) * np.exp(1j * (yaw[0] - yaw[1:])))
    sigma_v = math.hypot(max(fix.sd[0] for fix in fixes), sway_v / math.sqrt(len(fixes)))
    return align.course(np.array([way.real, way.imag, 0.0]), sigma_v, sigma_crab, MIN_SPEED)
