"""A course past waypoints: straight legs, the corners rounded by turns of smooth curvature."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.routes import WindingRoute, turned

Array = NDArray[np.float64]

SHARPEST_DEG = 150.0
"""A sharper turn would have to begin far before its corner."""
_SHARE = 0.45
"""Of a leg that a turn at either end of it may take at most."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)


@dataclass(frozen=True)
class Course:
    """The curve; ``passed`` (n,) is the way at which it passes each waypoint, m."""

    route: WindingRoute
    passed: Array


def course_past(points: Array, turn_m: float, onward_m: float) -> Course:
    """Lay a course from the first waypoint past all others, and straight on.

    Parameters
    ----------
    points
        (n, 2) north and east, m; the first is the origin.
    turn_m
        Way of each turn; less where legs are short.
    onward_m
        How far it goes on after the last.

    Raises
    ------
    ValueError
        Naming the waypoint where it cannot be laid.
    """
    legs = np.diff(points, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    if np.any(lengths < 1e-3):
        raise ValueError(f"points: number {int(np.argmin(lengths)) + 2} is where the one before is")
    courses = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    angles = np.diff(courses)
    sharp = np.abs(angles) > np.deg2rad(SHARPEST_DEG)
    if sharp.any():
        k = int(np.argmax(sharp))
        turn = f"the turn at number {k + 2} is of {np.rad2deg(abs(angles[k])):.0f} deg"
        raise ValueError(f"points: {turn}; at most {SHARPEST_DEG:.0f} are possible")
    reach = np.array([_reach(angle) for angle in angles])
    room = _SHARE * np.minimum(lengths[:-1], lengths[1:])
    turns = np.minimum(turn_m, room / reach)
    cut = np.concatenate([[0.0], turns * reach, [0.0]])
    straight = lengths - cut[:-1] - cut[1:]
    begin = np.cumsum(straight[:-1]) + np.concatenate([[0.0], np.cumsum(turns)[:-1]])[: turns.size]
    total = float(straight.sum() + turns.sum())
    passed = np.concatenate([[0.0], begin + 0.5 * turns, [total]])

    def direction(s: Array) -> Array:
        course = np.full_like(s, courses[0])
        for start, length, angle in zip(begin, turns, angles, strict=True):
            course += angle / np.pi * turned(np.clip((s - start) / length, 0.0, 1.0))
        return course

    return Course(WindingRoute(direction, total + onward_m), passed)


def _reach(angle: float) -> float:
    """How far before its corner a turn of unit length begins."""
    if abs(angle) < 1e-6:
        return 0.5
    u = 0.5 * (1.0 + _NODES)
    return float(0.5 * _WEIGHTS @ np.sin(angle / np.pi * turned(u)) / np.sin(angle))
