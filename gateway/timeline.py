"""A fixed-lag history that gives every measurement its place in time, in any order of arrival.

Inertial samples come in order and are the clock. A measurement waits until the samples reach it,
or, when it is late, the engine goes back to a snapshot before it and runs again over the kept
samples with every measurement in order: the result is that of the run in which nothing was late.
A measurement between two samples splits the increment of the sample that covers it.

The timeline knows order and time only; what a measurement means is the engine's business.
"""

from bisect import bisect_left, bisect_right, insort
from collections import deque
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Times = NDArray[np.int64]
Verdict = TypeVar("Verdict", covariant=True)
V = TypeVar("V")

N_TRACK = 12
SNAPSHOT_S = 0.25
"""Distance of snapshots: going back costs at most this much more than needed."""
LOOK_BACK_S = 8.0
"""How far before the lag the track reaches, for the moment a ping left."""


class Track(Protocol):
    """What the engine may ask about the past."""

    def at(self, t_ns: int) -> Array:
        """Interpolated (12,) track at a time in the past."""
        ...


class Engine(Protocol[Verdict]):
    """What the timeline drives: the filter, or a test's own arithmetic."""

    def advance(self, rows: Array, track: Array) -> None:
        """Carry the state over whole samples (k, 8), writing the (k, 12) track after each."""
        ...

    def advance_part(self, row: Array, begin: float, end: float) -> None:
        """Carry the state over a share of one sample."""
        ...

    def mark(self, track: Array) -> None:
        """Write the (12,) track of the present state."""
        ...

    def apply(self, measurement: Any, track: Track) -> Verdict:
        """Use a measurement at its own time."""
        ...

    def save(self) -> Any:
        """Copy the state."""
        ...

    def restore(self, saved: Any) -> None:
        """Take a copied state as the present one."""
        ...


@dataclass
class _Entry:
    """A measurement in its place: by time, then by `key`, so that ties do not depend on arrival."""

    t_ns: int
    key: str
    measurement: Any
    reported: bool = False

    @property
    def identity(self) -> tuple[int, str]:
        """What orders entries and tells duplicates."""
        return self.t_ns, self.key


@dataclass
class LatePolicy:
    """Counts of what arrived out of order."""

    late: int = 0
    too_late: int = 0
    duplicate: int = 0


class Timeline(Generic[V]):
    """History of one IMU and the measurements that fall into it.

    Parameters
    ----------
    engine
        Driven over samples and measurements in the order of time.
    rate_hz
        Nominal rate of the samples.
    history_s
        Lag within which a measurement may still come.
    snapshot_s
        Distance of snapshots; where little comes late, fewer are faster.
    """

    def __init__(
        self,
        engine: Engine[V],
        rate_hz: float,
        history_s: float,
        snapshot_s: float = SNAPSHOT_S,
    ) -> None:
        self._engine = engine
        self._lag_ns = int(history_s * 1e9)
        self._keep = int((history_s + LOOK_BACK_S) * rate_hz * 1.25) + 64
        self._stride = max(1, round(snapshot_s * rate_hz))
        size = 2 * self._keep
        self._t: Times = np.zeros(size, dtype=np.int64)
        self._rows: Array = np.zeros((size, 8))
        self._track: Array = np.zeros((size, N_TRACK))
        self._n = 0  # samples held; the engine has always consumed all of them
        self._dropped = 0  # samples before the first one held
        self._snapshots: deque[tuple[int, Any]] = deque()  # (samples consumed, state)
        self._entries: list[_Entry] = []  # every measurement of the lag, applied or waiting
        self.counts = LatePolicy()

    @property
    def t_head_ns(self) -> int | None:
        """Time of the newest sample; None before the first."""
        return int(self._t[self._n - 1]) if self._n else None

    def extend(self, t_ns: Times, rows: Array) -> list[V]:
        """Take new samples, oldest first, and give the verdicts on measurements they reached.

        Parameters
        ----------
        t_ns
            (k,) end of each sample's interval, increasing.
        rows
            (k, 8) increments.
        """
        verdicts: list[V] = []
        for begin in range(0, len(t_ns), self._keep):  # a block longer than the history in parts
            part = slice(begin, begin + self._keep)
            self._trim(len(t_ns[part]))
            first, self._n = self._n, self._n + len(t_ns[part])
            self._t[first : self._n] = t_ns[part]
            self._rows[first : self._n] = rows[part]
            if not self._snapshots:
                self._snapshots.append((self._dropped + first, self._engine.save()))
            verdicts += self._run(first)
        return verdicts

    def insert(self, measurement: Any, t_ns: int, key: str) -> list[V] | None:
        """Take a measurement; give the verdicts it leads to, now or (an empty list) later.

        Parameters
        ----------
        measurement
            Handed to the engine as it is.
        t_ns
            Its time of validity.
        key
            Breaks ties of time and tells duplicates; the same for the same measurement.

        Returns
        -------
        verdicts
            None when it was not taken: a duplicate, or older than the lag (see `counts`).
        """
        entry = _Entry(t_ns, key, measurement)
        at = bisect_left(self._entries, entry.identity, key=lambda e: e.identity)
        if at < len(self._entries) and self._entries[at].identity == entry.identity:
            self.counts.duplicate += 1
            return None
        head = self.t_head_ns
        if head is None or t_ns > head:
            insort(self._entries, entry, key=lambda e: e.identity)
            return []
        if t_ns < max(head - self._lag_ns, self._snapshot_time(0) + 1):
            self.counts.too_late += 1
            return None
        self.counts.late += 1
        insort(self._entries, entry, key=lambda e: e.identity)
        return self._run(self._rewind(t_ns))

    def at(self, t_ns: int) -> Array:
        """Track at a past moment, linear between samples and beyond the first."""
        if self._n < 2:
            return np.array(self._track[0])
        k = min(max(int(np.searchsorted(self._t[: self._n], t_ns)), 1), self._n - 1)
        t0, t1 = int(self._t[k - 1]), int(self._t[k])
        f = (t_ns - t0) / (t1 - t0)
        out: Array = self._track[k - 1] + f * (self._track[k] - self._track[k - 1])
        if f < 0.0:
            out[3:] = self._track[k - 1, 3:]
        return out

    def _snapshot_time(self, i: int) -> int:
        """Time up to which snapshot `i` has consumed the samples."""
        consumed: int = self._snapshots[i][0]
        return self._start_of(consumed - self._dropped)

    def _start_of(self, k: int) -> int:
        """Start of the interval of held sample `k`."""
        if k > 0:
            return int(self._t[k - 1])
        return int(self._t[0]) - round(float(self._rows[0, 0]) * 1e9)

    def _rewind(self, t_ns: int) -> int:
        """Go back to the newest snapshot before `t_ns`; give the first sample to run again."""
        while self._snapshot_time(-1) >= t_ns:
            self._snapshots.pop()
        consumed, saved = self._snapshots[-1]
        self._engine.restore(saved)
        return consumed - self._dropped

    def _run(self, k: int) -> list[V]:
        """Drive the engine from held sample `k` to the newest one."""
        verdicts: list[V] = []
        i = bisect_right(self._entries, self._start_of(k), key=lambda e: e.t_ns)
        while k < self._n:
            if i < len(self._entries) and self._entries[i].t_ns <= self._t[k]:
                i = self._run_split(k, i, verdicts)
                k += 1
            else:
                stop = self._next_stop(k, i)
                self._engine.advance(self._rows[k:stop], self._track[k:stop])
                k = stop
            if (self._dropped + k) % self._stride == 0:
                self._snapshots.append((self._dropped + k, self._engine.save()))
        return verdicts

    def _next_stop(self, k: int, i: int) -> int:
        """First sample after `k` that must not run in one go with it."""
        stop = min(self._n, k + self._stride - (self._dropped + k) % self._stride)
        if i < len(self._entries):
            covering = int(np.searchsorted(self._t[k:stop], self._entries[i].t_ns))
            stop = min(stop, k + covering)
        return stop

    def _run_split(self, k: int, i: int, verdicts: list[V]) -> int:
        """Run sample `k` with the measurements inside it, from entry `i`; give the next entry."""
        start, row, track = self._start_of(k), self._rows[k], self._track[k]
        span = int(self._t[k]) - start
        begin = 0.0
        while i < len(self._entries) and self._entries[i].t_ns <= self._t[k]:
            entry = self._entries[i]
            end = (entry.t_ns - start) / span
            if end > begin:
                self._engine.advance_part(row, begin, end)
            self._engine.mark(track)
            verdict = self._engine.apply(entry.measurement, self)
            if not entry.reported:
                entry.reported = True
                verdicts.append(verdict)
            begin, i = end, i + 1
        if begin < 1.0:
            self._engine.advance_part(row, begin, 1.0)
        self._engine.mark(track)
        return i

    def _trim(self, coming: int) -> None:
        """Forget what is older than the lag and make room for `coming` samples."""
        if self._n == 0:
            return
        horizon = int(self._t[self._n - 1]) - self._lag_ns
        while len(self._snapshots) > 1 and self._snapshot_time(1) <= horizon:
            self._snapshots.popleft()
        if self._n + coming > len(self._t):
            drop = self._n - self._keep
            for array in (self._t, self._rows, self._track):
                array[: self._keep] = array[drop : self._n]
            self._n, self._dropped = self._keep, self._dropped + drop
            while self._snapshots[0][0] < self._dropped + 1:
                self._snapshots.popleft()
        oldest = self._snapshot_time(0)
        while self._entries and self._entries[0].t_ns <= oldest:
            if not self._entries.pop(0).reported:
                self.counts.too_late += 1
