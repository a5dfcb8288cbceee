"""In which axes an array tells a direction, and how these turn with the vehicle's attitude.

An array's own axes turn with the vehicle; of those that an instrument has levelled only the heading
does, and those that it has turned north do not. What the array's mounting is wrong by stays in all
of them, but where the motion sensor sits in the array: there it has no prior.  # (M.160), (M.161)
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kinematics import C_ne
from gateway.fusion.state import State
from gateway.nav.lie import left_jacobian

Array = NDArray[np.float64]

AxesName = Literal["array", "level", "north"]
"""The array's own; level with x where the array looks ahead; north, east, down."""

MIN_HORIZONTAL = 0.1
"""A forward axis less level than this (84 deg of pitch) has no heading."""


class ToldAxes(NamedTuple):
    """Axes in which directions are told, with (3, 3) each.

    Attributes
    ----------
    C_ea
        From them to e.
    turning
        ``Psi``: an attitude error phi turns them by ``Psi phi``, in e.
    by_mounting
        The left Jacobian of theta, by which the array is mounted otherwise than its topside thinks.
    C_eu
        From the array's own axes, in which it measures, to e.
    """

    C_ea: Array
    turning: Array
    by_mounting: Array
    C_eu: Array


class Course(NamedTuple):
    """Heading of an axis of the body (rad), and its (3,) derivative by the attitude."""

    heading: float
    by_attitude: Array


def course(C_ne: Array, forward_e: Array) -> Course | None:
    """Heading of an axis (3,) in e; None where it is upright.  # (M.80)"""
    north, east, down = C_ne @ forward_e
    level2 = north * north + east * east
    if level2 < MIN_HORIZONTAL**2:
        return None
    by_n = np.array([-north * down / level2, -east * down / level2, 1.0])
    return Course(float(np.arctan2(east, north)), by_n @ C_ne)


def told_axes(state: State, C_bu: Array, name: AxesName) -> ToldAxes | None:
    """The axes at a state, by the array as it is mounted.  # (M.160), (M.161)

    None where an upright array is said to be level.
    """
    nominal = nominal_axes(state, C_bu, name)
    if nominal is None:
        return None
    C_ea, turning = nominal
    C_eb, C_theta = state.C_eb, state.C_theta
    Q = C_eb @ C_theta @ C_eb.T
    by_mounting = left_jacobian(state.theta)
    return ToldAxes(Q @ C_ea, np.eye(3) - Q + Q @ turning, by_mounting, C_eb @ C_theta @ C_bu)


def nominal_axes(state: State, C_bu: Array, name: AxesName) -> tuple[Array, Array] | None:
    """The axes and how they turn for an array that is mounted as its topside thinks.  # (M.160)

    Parameters
    ----------
    C_bu
        (3, 3) mounting as configured. Of level axes it gives the direction of x.
    """
    if name == "array":
        return state.C_eb @ C_bu, np.eye(3)
    to_n = C_ne(state)
    if name == "north":
        return to_n.T, np.zeros((3, 3))
    ahead = course(to_n, state.C_eb @ C_bu[:, 0])
    if ahead is None:
        return None
    return to_n.T @ about_down(ahead.heading), np.outer(to_n[2], ahead.by_attitude)


def about_down(angle: float) -> Array:
    """(3, 3) from level axes that look there (rad, from north to the east) to north-east-down."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
