"""The last samples of one inertial unit, with the track that was left on them.

Everything is counted by samples consumed: count c is the moment after sample c. The track of a
count is where the vehicle had gone and turned to by then; it is written when a state passes by.
"""

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Times = NDArray[np.int64]
T = TypeVar("T", bound=np.generic)

N_ROW = 8
N_TRACK = 12


class History:
    """Samples of a span of time, and the moment before the first of them.

    Parameters
    ----------
    rate_hz
        Nominal rate; with a faster one there is more to hold.
    span_s
        Time before the newest sample of which nothing is forgotten.
    count
        Samples consumed before the first one held.

    Attributes
    ----------
    count
        Count at the newest sample.
    earlier
        (12,) track at moments before the first sample held, by time, where they are known.
    """

    def __init__(self, rate_hz: float, span_s: float, count: int = 0) -> None:
        size = 2 * (int(span_s * rate_hz * 1.25) + 64)
        self._t: Times = np.zeros(size, dtype=np.int64)
        self._rows: Array = np.zeros((size, N_ROW))
        self._track: Array = np.zeros((size, N_TRACK))
        self._span_ns = int(span_s * 1e9)
        self._base = count  # the count at place 0 of the arrays
        self.count = count
        self.earlier: dict[int, Array] = {}

    def begin(self, t_ns: int) -> None:
        """Set the moment before the first sample."""
        self._t[0] = t_ns

    def t_ns(self, count: int) -> int:
        """Time of a count."""
        return int(self._t[count - self._base])

    def times(self, begin: int, end: int) -> Times:
        """(k,) view: ends of the samples between two counts."""
        return self._t[begin + 1 - self._base : end + 1 - self._base]

    def rows(self, begin: int, end: int) -> Array:
        """(k, 8) view: the samples between two counts."""
        return self._rows[begin + 1 - self._base : end + 1 - self._base]

    def track(self, begin: int, end: int) -> Array:
        """(k, 12) view: track after each sample between two counts."""
        return self._track[begin + 1 - self._base : end + 1 - self._base]

    def append(self, t_ns: Times, rows: Array, keep_from: int) -> None:
        """Take new samples; what is from the count `keep_from` on is not forgotten."""
        self._make_room(len(t_ns), keep_from)
        begin = self.count
        self.count += len(t_ns)
        self.times(begin, self.count)[:] = t_ns
        self.rows(begin, self.count)[:] = rows

    def at(self, t_ns: int, count: int, now_ns: int, now: Array) -> Array:
        """Track at a moment up to `now`, the track at a time within the sample after `count`.

        Linear between samples. Before the first moment known the displacement goes on as it began,
        and the attitude stays.
        """
        n = count - self._base
        if t_ns > self._t[n] or n == 0:
            k, t1, after = n, now_ns, now
        else:
            k = max(int(np.searchsorted(self._t[: n + 1], t_ns)), 1) - 1
            t1, after = int(self._t[k + 1]), self._track[k + 1]
        t0, before = int(self._t[k]), self._track[k]
        f = (t_ns - t0) / (t1 - t0)
        if f >= 0.0:
            return np.asarray(before + f * (after - before))
        if t_ns in self.earlier:
            return self.earlier[t_ns]
        out: Array = before + f * (after - before)
        out[3:] = before[3:]
        return out

    def _make_room(self, coming: int, keep_from: int) -> None:
        """Forget what is older than the span, and grow where that is not enough."""
        held = self.count - self._base + 1
        if held + coming <= len(self._t):
            return
        horizon = int(self._t[held - 1]) - self._span_ns
        within = int(np.searchsorted(self._t[:held], horizon, side="right")) - 1
        drop = max(0, min(within, keep_from - self._base))
        kept = held - drop
        size = len(self._t)
        while kept + coming > 0.75 * size:
            size *= 2
        self._t = _moved(self._t, drop, held, size)
        self._rows = _moved(self._rows, drop, held, size)
        self._track = _moved(self._track, drop, held, size)
        self._base += drop


@dataclass
class Past:
    """What a measurement may ask about the time before it; remembers what it was asked.

    Attributes
    ----------
    count
        Samples consumed before the one in which the measurement lies.
    now_ns, now
        Its own time and (12,) track.
    reach_ns
        How far back it may look; beyond, the answer is that of the furthest.
    """

    history: History
    count: int
    now_ns: int
    now: Array
    reach_ns: int
    asked: dict[int, Array] = field(default_factory=dict)

    def at(self, t_ns: int) -> Array:
        """(12,) track at an earlier time."""
        t_ns = max(t_ns, self.now_ns - self.reach_ns)
        if t_ns not in self.asked:
            self.asked[t_ns] = self.history.at(t_ns, self.count, self.now_ns, self.now)
        return self.asked[t_ns]


def _moved(array: NDArray[T], begin: int, end: int, size: int) -> NDArray[T]:
    """Places `begin` to `end` at the start of an array of a size: the same one where it fits."""
    out = array if size == len(array) else np.zeros((size, *array.shape[1:]), dtype=array.dtype)
    out[: end - begin] = array[begin:end]
    return out
