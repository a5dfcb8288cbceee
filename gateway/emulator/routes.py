"""Curves on the ground, as functions of the distance travelled."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

Array = NDArray[np.float64]

_KNOT_M = 1.0
_SPLINE_DEGREE = 5
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(5)


class Route(Protocol):
    """A curve in the north-east plane."""

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Position (m) and its first and second derivative with respect to ``s``.

        Parameters
        ----------
        s
            (n,) distance along the curve, m.

        Returns
        -------
        r, dr, ddr
            (n, 2) north, east.
        """
        ...


class StraightRoute:
    """From the origin on a constant course (rad)."""

    def __init__(self, course: float) -> None:
        self._direction = np.array([np.cos(course), np.sin(course)])

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """See `Route`."""
        r = s[:, None] * self._direction
        return r, np.broadcast_to(self._direction, r.shape), np.zeros_like(r)


class CircularRoute:
    """About the origin from a start bearing (rad); ``turn`` is 1 to starboard, -1 to port."""

    def __init__(self, radius: float, start_bearing: float, turn: int) -> None:
        self._radius = radius
        self._start = start_bearing
        self._turn = turn

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """See `Route`."""
        bearing = self._start + self._turn * s / self._radius
        outward = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
        ahead = self._turn * np.stack([-np.sin(bearing), np.cos(bearing)], axis=-1)
        return self._radius * outward, ahead, -outward / self._radius


class WindingRoute:
    """From the origin in a direction (rad) that is a function of the distance.

    A quintic spline through points of that curve *is* the route: its derivatives are exact for it.
    """

    def __init__(self, direction_at: Callable[[Array], Array], length: float) -> None:
        s = np.arange(0.0, length + 2.0 * _KNOT_M * _SPLINE_DEGREE, _KNOT_M)
        nodes = s[:-1, None] + 0.5 * _KNOT_M * (1.0 + _GAUSS_NODES)
        direction = direction_at(nodes)
        steps = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
        steps = 0.5 * _KNOT_M * np.einsum("ijk,j->ik", steps, _GAUSS_WEIGHTS)
        points = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
        spline: BSpline = make_interp_spline(s, points, k=_SPLINE_DEGREE)
        self._derivatives = (spline, spline.derivative(1), spline.derivative(2))

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """See `Route`."""
        r, dr, ddr = (np.asarray(spline(s)) for spline in self._derivatives)
        return r, dr, ddr


def lawnmower(course: float, leg: float, spacing: float, length: float) -> WindingRoute:
    """Parallel legs joined by half turns."""
    turn = spacing / _turn_width()
    return WindingRoute(lambda s: course + _mowing_direction(s, leg, turn), length)


def legs(
    course: float, leg: float, turns: Sequence[float], turn: float, length: float
) -> WindingRoute:
    """Legs joined by turns of given angles (rad, to starboard), each over the way ``turn``."""

    def direction(s: Array) -> Array:
        total = np.full_like(s, course)
        for k, angle in enumerate(turns):
            u = np.clip((s - leg - k * (leg + turn)) / turn, 0.0, 1.0)
            total += angle / np.pi * turned(u)
        return total

    return WindingRoute(direction, length)


def turned(u: Array) -> Array:
    """Heading change of a half turn to starboard after the fraction ``u`` of its length.

    Its curvature is a raised cosine: turn rate and lateral acceleration begin and end smoothly.
    """
    return np.pi * u - 0.5 * np.sin(2.0 * np.pi * u)


def _turn_width() -> float:
    """Lateral way of a half turn of unit length."""
    u = 0.5 * (1.0 + np.polynomial.legendre.leggauss(40)[0])
    return float(0.5 * np.polynomial.legendre.leggauss(40)[1] @ np.sin(turned(u)))


def _mowing_direction(s: Array, leg: float, turn: float) -> Array:
    """Direction relative to the first leg: leg, starboard turn, leg, port turn, ..."""
    lap, within = np.divmod(s, leg + turn)
    u = np.clip((within - leg) / turn, 0.0, 1.0)
    back = lap % 2 == 1
    return np.where(back, np.pi - turned(u), turned(u))
