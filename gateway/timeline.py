"""A fixed-lag history that gives every measurement its place in time, in any order of arrival.

Inertial samples come in order and are the clock. A measurement waits until the samples reach it,
or, when it is late, the engine goes back to a snapshot before it and runs again over the kept
samples with every measurement in order: the result is that of the run in which nothing was late.
A measurement between two samples splits the increment of the sample that covers it.

Where there is much to run again it is done in slices, one for each new sample, while the newest
state goes on without the measurement; when the rerun has caught up, it is the newest state. No
solution waits for a slice: `catch_up` runs it when that is given. What comes out depends on the
order of samples and measurements, never on time spent.

The timeline knows order and time only; what a measurement means is the engine's business.
"""

from collections import deque
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from gateway.engine import Engine
from gateway.handover import Note, Notes
from gateway.history import N_TRACK, Array, History, Past, Times
from gateway.order import Entry, Order, OrderCounts, Refusal

V = TypeVar("V")

SNAPSHOT_S = 0.25
"""Distance of snapshots: going back costs at most this much more than needed."""
LOOK_BACK_S = 8.0
"""How far before a measurement the track reaches, for the moment a ping left."""
ALL = NEVER = 1 << 62
"""No bound on the work; no moment."""
CHUNK = 1024
"""Samples taken at once: a longer block must not push out the history that it needs."""
SLICE = 400
"""Samples run again at once: half a millisecond."""
UPDATE = 200
"""Samples for which a measurement counts."""
MAX_WAITING = 10_000
"""Measurements that may wait for the samples to reach them."""


@dataclass
class _Rerun:
    """History being run again: how far it is, and the engine's state there."""

    count: int
    state: Any


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
    ahead_s
        How far ahead of the samples a measurement may lie; None is no bound, nor on their number.
    slice_
        Samples run again after each new one; None runs all of them at once.
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
        ahead_s: float | None = None,
        slice_: int | None = SLICE,
        after: Note | None = None,
    ) -> None:
        self._engine = engine
        self._lag_ns = int(history_s * 1e9)
        self._ahead_ns = None if ahead_s is None else int(ahead_s * 1e9)
        self._look_back_ns = int(LOOK_BACK_S * 1e9)
        self._stride = max(1, round(snapshot_s * rate_hz))
        self._history = History(rate_hz, history_s + LOOK_BACK_S, after.count if after else 0)
        self._began_ns: int | None = None
        self._first_ns = 0  # what lies before is in the state that the engine began with
        self._snapshots: deque[tuple[int, Any]] = deque()  # (samples consumed, state)
        self._order = Order()  # every measurement of the lag, applied or waiting
        self._slice = ALL if slice_ is None else slice_
        self._rerun: _Rerun | None = None
        self._owes = False  # the slice of the newest sample
        self._again_ns = NEVER  # of what came late behind the rerun
        self._notes = Notes()
        self._forget_at = 0  # only so often: there is nothing to forget between snapshots
        self.counts = OrderCounts()
        if after is not None:
            self._take_over(after)

    @property
    def t_head_ns(self) -> int | None:
        """Time of the newest sample; None before the first."""
        return None if self._began_ns is None else self._history.t_ns(self._history.count)

    @property
    def owes(self) -> bool:
        """Whether `catch_up` has something to do."""
        return self._owes

    def extend(self, t_ns: Times, rows: Array) -> list[V]:
        """Take new samples, oldest first, and give the verdicts on measurements they reached.

        What `catch_up` was not asked for before is done first.

        Parameters
        ----------
        t_ns
            (k,) end of each sample's interval, increasing.
        rows
            (k, 8) increments.
        """
        verdicts: list[V] = []
        if self._began_ns is None and len(t_ns):
            self.begin(start_ns(t_ns, rows))
        for begin in range(0, len(t_ns), CHUNK):
            part = slice(begin, begin + CHUNK)
            head = self._history.count
            if head >= self._forget_at:
                self._forget()
                self._forget_at = head + self._stride
            self._history.append(t_ns[part], rows[part], self._snapshots[0][0])
            self._advance(head, verdicts)
        return verdicts

    def begin(self, t_ns: int) -> list[Any]:
        """Set the moment of the state that the engine begins with, where no sample has come.

        Otherwise it is the start of the first one. Gives the measurements that waited but lie
        before: they are refused.
        """
        self._began_ns = self._first_ns = t_ns
        self._begin_history(t_ns)
        stale = self._order.forget(self._order.after(t_ns))
        for _ in stale:
            self.counts.refuse(Refusal.TOO_LATE)
        return [entry.measurement for entry in stale]

    def insert(self, measurement: Any, t_ns: int, key: str) -> list[V] | Refusal:
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
            Or why it was not taken, which `counts` counts.
        """
        head = self.t_head_ns
        if head is not None and (t_ns < head - self._lag_ns or t_ns <= self._began()):
            return self.counts.refuse(Refusal.TOO_LATE)
        entry = Entry(t_ns, key, measurement)
        if self._is_too_early(t_ns, head):
            return self.counts.refuse(Refusal.TOO_EARLY)
        if not self._order.add(entry):
            return self.counts.refuse(Refusal.DUPLICATE)
        if head is None or t_ns > head:
            return []
        self.counts.late += 1
        verdicts: list[V] = []
        if t_ns <= self._first_ns:
            entry.reported = True
        elif self._rerun is None:
            self._go_back(t_ns, self._history.count, verdicts)
        elif t_ns <= self._history.t_ns(self._rerun.count):
            self._again_ns = min(self._again_ns, t_ns)
        return verdicts

    def catch_up(self) -> list[V]:
        """Run the slice that the newest sample has brought, if any; give the verdicts."""
        verdicts: list[V] = []
        self._run_slice(self._history.count, verdicts)
        return verdicts

    def at(self, t_ns: int) -> Array:
        """Track at a moment before the newest sample."""
        history, head = self._history, self._history.count
        return history.at(t_ns, head - 1, history.t_ns(head), history.track(head - 1, head)[0])

    def note(self) -> Note:
        """Note the present, to be given out by `settled` when nothing can change it any more."""
        count = self._history.count
        t_ns = self._history.t_ns(count)
        known = tuple(
            (e.t_ns, e.key, e.measurement) for e in self._order if e.t_ns >= t_ns - self._lag_ns
        )
        note = Note(count, t_ns, self._began(), known, replace(self.counts))
        self._notes.add(note)
        if self._rerun is None and self._snapshots[-1][0] < count:
            self._snapshots.append((count, self._engine.save()))
        return note

    def settled(self) -> Note | None:
        """Take the newest note that is settled, and forget those before; None where there is none.

        It is when every measurement that may change the state of then has come, and every one
        that may ask about the time before.
        """
        head = self.t_head_ns
        if head is None:
            return None
        final_ns = min(head - self._lag_ns, self._again_ns)
        if self._rerun is not None:
            final_ns = min(final_ns, self._history.t_ns(self._rerun.count))
        return self._notes.settled(final_ns, self._look_back_ns, self._order)

    def finish(self) -> list[V]:
        """Run to its end what is being run again; give the verdicts."""
        verdicts: list[V] = []
        while self._rerun is not None:
            self._owes = True
            self._run_slice(self._history.count, verdicts)
        return verdicts

    def waiting(self) -> list[Any]:
        """Measurements without a verdict, in their order."""
        return [entry.measurement for entry in self._order if not entry.reported]

    def _is_too_early(self, t_ns: int, head: int | None) -> bool:
        """Whether a measurement would wait too long, or with too many."""
        if self._ahead_ns is None or (head is not None and t_ns <= head):
            return False
        if head is not None and t_ns > head + self._ahead_ns:
            return True
        waiting = len(self._order) - (0 if head is None else self._order.after(head))
        return waiting >= MAX_WAITING

    def _began(self) -> int:
        """Moment before the first sample of all."""
        assert self._began_ns is not None
        return self._began_ns

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
        for t_ns, key, measurement in note.known:
            self._order.add(Entry(t_ns, key, measurement, reported=t_ns <= note.t_ns))
        self.counts = replace(note.order)

    def _go_back(self, t_ns: int, head: int, verdicts: list[V]) -> None:
        """Run again up to `head` from before a moment: at once where it is little."""
        history, order = self._history, self._order
        while history.t_ns(self._snapshots[-1][0]) >= t_ns:
            self._snapshots.pop()
        count, state = self._snapshots[-1]
        updates = order.after(history.t_ns(head)) - order.after(history.t_ns(count))
        if head - count + UPDATE * updates > self._slice:
            self._rerun = _Rerun(count, state)
        else:
            self._engine.restore(state)
            self._run(count, head, ALL, verdicts)

    def _advance(self, count: int, verdicts: list[V]) -> None:
        """Carry the newest state on over the samples after a count, and the rerun with it."""
        history = self._history
        while count < history.count:
            self._run_slice(count, verdicts)
            if self._rerun is None:
                self._run(count, history.count, ALL, verdicts)
                return
            self._engine.advance(history.rows(count, count + 1), history.track(count, count + 1))
            self._owes = True
            count += 1

    def _run_slice(self, head: int, verdicts: list[V]) -> None:
        """Run the slice that is owed; at `head` the rerun's state becomes the newest."""
        rerun, owes, self._owes = self._rerun, self._owes, False
        if rerun is None or not owes:
            return
        newest = self._engine.save()
        self._engine.restore(rerun.state)
        rerun.count = self._run(rerun.count, head, self._slice, verdicts)
        if rerun.count < head:
            rerun.state = self._engine.save()
            self._engine.restore(newest)
            return
        again_ns, self._again_ns, self._rerun = self._again_ns, NEVER, None
        if again_ns < NEVER:
            self._go_back(again_ns, head, verdicts)

    def _run(self, count: int, stop: int, work: int, verdicts: list[V]) -> int:
        """Drive the engine from a count to another, or until the work is done; say how far."""
        history, order = self._history, self._order
        i = order.after(history.t_ns(count))
        all_of_it = work
        while count < stop and work > 0:
            if i < len(order) and order[i].t_ns <= history.t_ns(count + 1):
                if work < min(UPDATE, all_of_it):
                    break
                before, i = i, self._run_split(count, i, verdicts)
                work -= 1 + UPDATE * (i - before)
                count += 1
            else:
                upto = self._next_stop(count, min(stop, count + work), i)
                self._engine.advance(history.rows(count, upto), history.track(count, upto))
                work -= upto - count
                count = upto
            if count % self._stride == 0 or self._notes.next_after(count - 1) == count:
                self._snapshots.append((count, self._engine.save()))
        return count

    def _next_stop(self, count: int, stop: int, i: int) -> int:
        """Count up to which the samples may run in one go, `i` being the next measurement."""
        stop = min(stop, count + self._stride - count % self._stride)
        noted = self._notes.next_after(count)
        if noted is not None:
            stop = min(stop, noted)
        if i < len(self._order):
            times = self._history.times(count, stop)
            stop = min(stop, count + int(np.searchsorted(times, self._order[i].t_ns)))
        return stop

    def _run_split(self, count: int, i: int, verdicts: list[V]) -> int:
        """Run the sample after `count` with the measurements in it, from `i`; give the next."""
        start, stop = self._history.t_ns(count), self._history.t_ns(count + 1)
        row = self._history.rows(count, count + 1)[0]
        begin = 0.0
        while i < len(self._order) and self._order[i].t_ns <= stop:
            entry = self._order[i]
            end = (entry.t_ns - start) / (stop - start)
            if end > begin:
                self._engine.advance_part(row, begin, end)
            self._apply(entry, count, verdicts)
            begin, i = end, i + 1
        if begin < 1.0:
            self._engine.advance_part(row, begin, 1.0)
        self._engine.mark(self._history.track(count, count + 1)[0])
        return i

    def _apply(self, entry: Entry, count: int, verdicts: list[V]) -> None:
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
        self._notes.tell(entry.t_ns)

    def _forget(self) -> None:
        """Forget what is older than the lag; a note's state that is, is final."""
        horizon = self._history.t_ns(self._history.count) - self._lag_ns
        horizon = min(horizon, self._again_ns)
        while len(self._snapshots) > 1 and self._history.t_ns(self._snapshots[1][0]) < horizon:
            count, saved = self._snapshots.popleft()
            self._notes.conclude(count, saved)
        oldest = min(horizon, self._history.t_ns(self._snapshots[0][0]))
        if self._notes.oldest_ns is not None:
            oldest = min(oldest, self._notes.oldest_ns)
        self._order.forget(self._order.after(oldest - 1))


def start_ns(t_ns: Times, rows: Array) -> int:
    """Start of the first of some samples."""
    return int(t_ns[0]) - round(float(rows[0, 0]) * 1e9)
