"""A fixed-lag history that gives every measurement its place in time, in any order of arrival.

Inertial samples come in order and are the clock. A measurement waits until the samples reach it,
or, when it is late, the engine goes back to a snapshot before it and runs again over the kept
samples with every measurement in order: the result is that of the run in which nothing was late.
A measurement between two samples splits the increment of the sample that covers it.

The timeline knows order and time only; what a measurement means is the engine's business.
"""

from bisect import bisect_left, bisect_right, insort
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from gateway.history import N_TRACK, Array, History, Past, Times

Verdict = TypeVar("Verdict", covariant=True)
V = TypeVar("V")

SNAPSHOT_S = 0.25
"""Distance of snapshots: going back costs at most this much more than needed."""
LOOK_BACK_S = 8.0
"""How far before a measurement the track reaches, for the moment a ping left."""
CHUNK = 1024
"""Samples taken at once: a longer block must not push out the history that it needs."""
MAX_NOTES = 64
"""Notes that may wait to be settled; of more the oldest are forgotten."""


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
    asked: dict[int, Array] = field(default_factory=dict)
    """What its model asked about the past when it was last applied."""

    @property
    def identity(self) -> tuple[int, str]:
        """What orders entries and tells duplicates."""
        return self.t_ns, self.key


@dataclass
class OrderCounts:
    """Counts of what arrived out of order."""

    late: int = 0
    too_late: int = 0
    duplicate: int = 0


@dataclass
class Note:
    """A moment at which another timeline can take over, given all that came after it.

    Attributes
    ----------
    count, t_ns
        Samples consumed, and the time of the last.
    began_ns
        Moment before the first sample of all.
    known
        Measurements that had come by then and may still come again or wait: time, key, itself.
    order
        The counts of then.
    told
        Verdicts given since on measurements that lie before it: their effect is in `state`, so
        that the other timeline takes them in silence.
    state
        The engine's, once nothing can change it; None before.
    past
        Track before ``t_ns`` as far as measurements after it asked for it.
    """

    count: int
    t_ns: int
    began_ns: int
    known: tuple[tuple[int, str, Any], ...]
    order: OrderCounts
    told: int = 0
    state: Any = None
    past: dict[int, Array] = field(default_factory=dict)


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
    after
        A settled note of another timeline, whose state the engine has; all samples and
        measurements that came after it are to follow in the order of their arrival.
    """

    def __init__(
        self,
        engine: Engine[V],
        rate_hz: float,
        history_s: float,
        snapshot_s: float = SNAPSHOT_S,
        after: Note | None = None,
    ) -> None:
        self._engine = engine
        self._lag_ns = int(history_s * 1e9)
        self._look_back_ns = int(LOOK_BACK_S * 1e9)
        self._stride = max(1, round(snapshot_s * rate_hz))
        self._history = History(rate_hz, history_s + LOOK_BACK_S, after.count if after else 0)
        self._began_ns: int | None = None
        self._first_ns = 0  # what lies before is in the state that the engine began with
        self._snapshots: deque[tuple[int, Any]] = deque()  # (samples consumed, state)
        self._entries: list[_Entry] = []  # every measurement of the lag, applied or waiting
        self._notes: deque[Note] = deque()
        self.counts = OrderCounts()
        if after is not None:
            self._take_over(after)

    @property
    def t_head_ns(self) -> int | None:
        """Time of the newest sample; None before the first."""
        return None if self._began_ns is None else self._history.t_ns(self._history.count)

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
        if self._began_ns is None and len(t_ns):
            self._begin(int(t_ns[0]) - round(float(rows[0, 0]) * 1e9))
        for begin in range(0, len(t_ns), CHUNK):
            part = slice(begin, begin + CHUNK)
            self._forget()
            head = self._history.count
            self._history.append(t_ns[part], rows[part], self._snapshots[0][0])
            verdicts += self._run(head)
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
        head = self.t_head_ns
        if head is not None and (t_ns < head - self._lag_ns or t_ns <= self._began()):
            self.counts.too_late += 1
            return None
        entry = _Entry(t_ns, key, measurement)
        at = bisect_left(self._entries, entry.identity, key=lambda e: e.identity)
        if at < len(self._entries) and self._entries[at].identity == entry.identity:
            self.counts.duplicate += 1
            return None
        insort(self._entries, entry, key=lambda e: e.identity)
        if head is None or t_ns > head:
            return []
        self.counts.late += 1
        if t_ns <= self._first_ns:
            entry.reported = True
            return []
        return self._run(self._rewind(t_ns))

    def at(self, t_ns: int) -> Array:
        """Track at a moment before the newest sample."""
        history, head = self._history, self._history.count
        return history.at(t_ns, head - 1, history.t_ns(head), history.track(head - 1, head)[0])

    def note(self) -> Note:
        """Note the present, to be given out by `settled` when nothing can change it any more."""
        count = self._history.count
        t_ns = self._history.t_ns(count)
        known = tuple(
            (e.t_ns, e.key, e.measurement) for e in self._entries if e.t_ns >= t_ns - self._lag_ns
        )
        note = Note(count, t_ns, self._began(), known, replace(self.counts))
        self._notes.append(note)
        if len(self._notes) > MAX_NOTES:
            self._notes.popleft()
        if self._snapshots[-1][0] < count:
            self._snapshots.append((count, self._engine.save()))
        return note

    def settled(self) -> Note | None:
        """Take the newest note that is settled, and forget those before; None where there is none.

        It is when every measurement that may change the state of then has come, and every one
        that may ask about the time before.
        """
        head, found = self.t_head_ns, None
        while self._notes and head is not None:
            note = self._notes[0]
            asked_until = note.t_ns + self._look_back_ns
            if note.state is None or head < asked_until + self._lag_ns:
                break
            for entry in self._entries:
                if note.t_ns < entry.t_ns <= asked_until:
                    note.past |= {t: row for t, row in entry.asked.items() if t < note.t_ns}
            found = self._notes.popleft()
        return found

    def _began(self) -> int:
        """Moment before the first sample of all."""
        assert self._began_ns is not None
        return self._began_ns

    def _begin(self, t_ns: int) -> None:
        """Set the moment of the state that the engine begins with."""
        self._began_ns = self._first_ns = t_ns
        self._begin_history(t_ns)
        stale = bisect_right(self._entries, t_ns, key=lambda e: e.t_ns)
        self.counts.too_late += stale
        del self._entries[:stale]

    def _begin_history(self, t_ns: int) -> None:
        """Make the engine's state the one before the first sample."""
        count = self._history.count
        self._history.begin(t_ns)
        self._engine.mark(self._history.track(count - 1, count)[0])
        self._snapshots.append((count, self._engine.save()))

    def _take_over(self, note: Note) -> None:
        """Go on where another timeline was."""
        self._began_ns, self._first_ns = note.began_ns, note.t_ns
        self._begin_history(note.t_ns)
        self._history.earlier = note.past
        self._entries = [_Entry(*known, reported=known[0] <= note.t_ns) for known in note.known]
        self.counts = replace(note.order)

    def _rewind(self, t_ns: int) -> int:
        """Go back to the newest snapshot before `t_ns`; give its count."""
        while self._history.t_ns(self._snapshots[-1][0]) >= t_ns:
            self._snapshots.pop()
        count, saved = self._snapshots[-1]
        self._engine.restore(saved)
        return count

    def _run(self, count: int) -> list[V]:
        """Drive the engine from a count to the newest sample."""
        verdicts: list[V] = []
        history, entries = self._history, self._entries
        i = bisect_right(entries, history.t_ns(count), key=lambda e: e.t_ns)
        while count < history.count:
            if i < len(entries) and entries[i].t_ns <= history.t_ns(count + 1):
                i = self._run_split(count, i, verdicts)
                count += 1
            else:
                stop = self._next_stop(count, i)
                self._engine.advance(history.rows(count, stop), history.track(count, stop))
                count = stop
            if count % self._stride == 0 or self._next_note(count - 1) == count:
                self._snapshots.append((count, self._engine.save()))
        return verdicts

    def _next_stop(self, count: int, i: int) -> int:
        """Count up to which the samples may run in one go, `i` being the next measurement."""
        stop = min(self._history.count, count + self._stride - count % self._stride)
        noted = self._next_note(count)
        if noted is not None:
            stop = min(stop, noted)
        if i < len(self._entries):
            times = self._history.times(count, stop)
            stop = min(stop, count + int(np.searchsorted(times, self._entries[i].t_ns)))
        return stop

    def _next_note(self, count: int) -> int | None:
        """Count of the first note after a count."""
        if not self._notes or self._notes[-1].count <= count:
            return None
        return next(note.count for note in self._notes if note.count > count)

    def _run_split(self, count: int, i: int, verdicts: list[V]) -> int:
        """Run the sample after `count` with the measurements in it, from `i`; give the next."""
        start, stop = self._history.t_ns(count), self._history.t_ns(count + 1)
        row = self._history.rows(count, count + 1)[0]
        begin = 0.0
        while i < len(self._entries) and self._entries[i].t_ns <= stop:
            entry = self._entries[i]
            end = (entry.t_ns - start) / (stop - start)
            if end > begin:
                self._engine.advance_part(row, begin, end)
            self._apply(entry, count, verdicts)
            begin, i = end, i + 1
        if begin < 1.0:
            self._engine.advance_part(row, begin, 1.0)
        self._engine.mark(self._history.track(count, count + 1)[0])
        return i

    def _apply(self, entry: _Entry, count: int, verdicts: list[V]) -> None:
        """Use a measurement; its verdict is given the first time."""
        now = np.empty(N_TRACK)
        self._engine.mark(now)
        past = Past(self._history, count, entry.t_ns, now, self._look_back_ns)
        verdict = self._engine.apply(entry.measurement, past)
        entry.asked = past.asked
        if entry.reported:
            return
        entry.reported = True
        verdicts.append(verdict)
        for note in self._notes:
            note.told += entry.t_ns <= note.t_ns

    def _forget(self) -> None:
        """Forget what is older than the lag; a note's state that is, is final."""
        horizon = self._history.t_ns(self._history.count) - self._lag_ns
        while len(self._snapshots) > 1 and self._history.t_ns(self._snapshots[1][0]) < horizon:
            count, saved = self._snapshots.popleft()
            for note in self._notes:
                if note.count == count:
                    note.state = saved
        oldest = min(horizon, self._history.t_ns(self._snapshots[0][0]))
        if self._notes:
            oldest = min(oldest, self._notes[0].t_ns)
        del self._entries[: bisect_left(self._entries, oldest, key=lambda e: e.t_ns)]
