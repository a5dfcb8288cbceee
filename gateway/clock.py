"""From a device's own count to the host's time: offset and drift under the jitter of arrivals.

Queueing only ever adds delay, so the truth lies on the lower envelope of arrival minus count. The
envelope is the lower convex hull of the least delays of short stretches over the last minute; the
edge below its middle gives offset and drift.
"""

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise

STRETCH_S = 1.0
WINDOW = 60
"""Stretches kept: one minute."""
DRIFT_AFTER = 6
"""Stretches before a drift is believed."""


@dataclass
class Unwrapper:
    """Turns a counter that wraps into one that only grows, helped by the time that passed.

    Attributes
    ----------
    modulus
        Values are 0 .. modulus-1.
    last
        The newest count; None before the first.
    """

    modulus: int
    last: int | None = None

    def extend(self, value: int, expected_step: float) -> int:
        """Next count, the one congruent to `value` that is nearest to the expected step.

        A counter that begins again (power cycle) so lands within half a modulus of where the
        elapsed time says it should be, and never behind the last one.
        """
        if self.last is None:
            self.last = value
            return value
        step = (value - self.last) % self.modulus
        missing = round((expected_step - step) / self.modulus)
        self.last += step + max(missing, 0) * self.modulus
        return self.last


@dataclass
class ArrivalClock:
    """Host time of a device's count, from pairs of count and arrival.

    ``count_s`` is the device's time or its number of samples over the nominal rate, in seconds.
    """

    offset_s: float = 0.0
    drift: float = 0.0
    _origin_ns: int | None = None
    _origin_s: float = 0.0
    _stretch_end: float = 0.0
    _least: tuple[float, float] | None = None
    _past: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def stamp(self, count_s: float, t_arrival_ns: int) -> int:
        """Take one arrival; give the host time (ns) at which the count was true.  # (M.60)"""
        if self._origin_ns is None:
            self._origin_ns, self._origin_s = t_arrival_ns, count_s
            self._stretch_end = STRETCH_S
        c = count_s - self._origin_s
        residual = (t_arrival_ns - self._origin_ns) * 1e-9 - c
        if self._least is None or residual < self._least[1]:
            self._least = (c, residual)
        if c >= self._stretch_end:
            self._close_stretch(c)
        predicted = self.offset_s + self.drift * c
        if residual < predicted:
            self.offset_s += residual - predicted
            predicted = residual
        return self._origin_ns + round((c + predicted) * 1e9)

    def _close_stretch(self, c: float) -> None:
        """Keep the least delay of the stretch and fit the envelope anew."""
        assert self._least is not None
        self._past.append(self._least)
        self._least = None
        self._stretch_end = c + STRETCH_S
        if len(self._past) >= DRIFT_AFTER:
            self.offset_s, self.drift = lower_edge(list(self._past))
        else:
            self.offset_s = min(r for _, r in self._past)


def lower_edge(points: list[tuple[float, float]]) -> tuple[float, float]:
    """Line below all points that is nearest to them on the whole: the hull's edge under their mean.

    Parameters
    ----------
    points
        (abscissa, ordinate) with increasing abscissa, at least two.

    Returns
    -------
    intercept, slope
    """
    hull: list[tuple[float, float]] = []
    for p in points:
        while len(hull) > 1 and _turns_up(hull[-2], hull[-1], p):
            hull.pop()
        hull.append(p)
    middle = sum(x for x, _ in points) / len(points)
    for (x0, y0), (x1, y1) in pairwise(hull):
        if x1 >= middle:
            slope = (y1 - y0) / (x1 - x0)
            return y0 - slope * x0, slope
    raise ValueError("abscissas do not increase")


def _turns_up(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
