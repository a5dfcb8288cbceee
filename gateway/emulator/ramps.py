"""Smooth functions of one variable: rates that change, and values that step, without a jerk."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Smooth(Protocol):
    """A function with two continuous derivatives."""

    def at(self, x: Array) -> tuple[Array, Array, Array]:
        """Value and first and second derivative at ``x``, (n,) each."""
        ...


class Change(NamedTuple):
    """The rate goes to ``rate`` from ``at`` on, over the length ``over``."""

    at: float
    over: float
    rate: float


class Ramps:
    """A function from 0 at 0 whose rate is constant but for changes, each a quintic smooth step.

    Parameters
    ----------
    first
        The rate before the first change.
    changes
        In their order, none beginning before the one before it is over; ``over`` 0 only at 0.
    """

    def __init__(self, first: float, changes: Sequence[Change] = ()) -> None:
        rows = [Change(0.0, 0.0, first), *changes]
        at, over, to = (np.array(column) for column in zip(*rows, strict=True))
        before = np.concatenate([[first], to[:-1]])
        gained = 0.5 * (before + to)[:-1] * over[:-1] + to[:-1] * (np.diff(at) - over[:-1])
        self._at, self._over, self._before, self._to = at, over, before, to
        self._value = np.concatenate([[0.0], np.cumsum(gained)])

    def at(self, x: Array) -> tuple[Array, Array, Array]:
        """See `Smooth`."""
        k = np.maximum(np.searchsorted(self._at, x, side="right") - 1, 0)
        since, over, v0, v1 = x - self._at[k], self._over[k], self._before[k], self._to[k]
        u = np.where(over > 0.0, np.clip(since / np.where(over > 0.0, over, 1.0), 0.0, 1.0), 1.0)
        way, step, slope = u**4 * (2.5 - 3.0 * u + u**2), *_step(u)
        y = self._value[k] + v0 * over * u + (v1 - v0) * over * way + v1 * (since - over * u)
        curve = np.where(over > 0.0, (v1 - v0) / np.where(over > 0.0, over, 1.0) * slope, 0.0)
        return y, v0 + (v1 - v0) * step, curve


class Steps:
    """From value to value, a quintic smooth step between each two knots, level outside.

    Parameters
    ----------
    knots, values
        At least one; knots rise.
    """

    def __init__(self, knots: Sequence[float], values: Sequence[float]) -> None:
        self._knots, self._values = np.array(knots), np.array(values)

    def at(self, x: Array) -> tuple[Array, Array, Array]:
        """See `Smooth`."""
        if self._knots.size == 1:
            return np.full_like(x, self._values[0]), np.zeros_like(x), np.zeros_like(x)
        k = np.clip(np.searchsorted(self._knots, x, side="right") - 1, 0, self._knots.size - 2)
        length = np.diff(self._knots)[k]
        rise = np.diff(self._values)[k]
        u = np.clip((x - self._knots[k]) / length, 0.0, 1.0)
        step, slope = _step(u)
        curve = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)
        return self._values[k] + rise * step, rise / length * slope, rise / length**2 * curve


def _step(u: Array) -> tuple[Array, Array]:
    """The quintic smooth step from 0 to 1 and its slope, for ``u`` from 0 to 1."""
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * u**2 * (1.0 - u) ** 2
