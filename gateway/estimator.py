"""The core of the filter process: measurements in, solutions and verdicts out; deterministic.

What comes out depends on the measurements and their order only, never on how they were batched, so
a replay gives what the live run gave.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gateway.checkpoint import Totals, checkpoint
from gateway.config import Config
from gateway.fusion import initial
from gateway.fusion.credible import Credible
from gateway.fusion.filter import MISSING, Filter
from gateway.fusion.memory import Memory
from gateway.fusion.observation import Model
from gateway.fusion.report import calibration, solution
from gateway.fusion.restart import LONG_ABSENCE_S, inflate
from gateway.fusion.saved import memory_of, saved
from gateway.fusion.start import Start
from gateway.fusion.state import State
from gateway.handover import Note
from gateway.messages import (
    Checkpoint,
    FilterCounts,
    FilterOutput,
    Fix,
    ImuBlock,
    Innovation,
    Measurement,
    NavSolution,
    SavedState,
    Verdict,
)
from gateway.modes import Mode
from gateway.order import OrderCounts, Refusal
from gateway.timeline import MAX_WAITING, Timeline, start_ns

CALIBRATION_PERIOD_NS = 1_000_000_000


class Estimator:
    """Timeline and filter of one vehicle.

    Parameters
    ----------
    config
        A validated configuration.
    rate_hz
        Solutions a second: one at the first sample of each period.
    resume
        Where an earlier process left off. A `Checkpoint` wants all measurements since and goes on
        exactly. A `SavedState` is taken for what it is worth at the first sample (see
        `gateway.fusion.restart.inflate`): after a long absence the attitude is found anew where
        `initial.align` says how. None begins at the configured initial state, or with finding the
        attitude.
    engine
        Makes the filter from its model and memory: one that also takes notes, for a replay.
    """

    def __init__(
        self,
        config: Config,
        rate_hz: float,
        resume: Checkpoint | SavedState | None = None,
        engine: Callable[[Model, Memory], Filter] = Filter,
    ) -> None:
        self._config = config
        self._engine = engine
        self._period_ns = round(1e9 / rate_hz)
        self._max_fix_age_ns = int(config.filter.max_fix_age_s * 1e9)
        self._max_gap_s = config.filter.max_gap_s
        self._counts = OrderCounts()
        self._samples = 0
        self._resets = 0
        self._t_last_ns = 0
        self._second = 0
        self._received = 0
        self._said = 0
        self._taken_ns: int | None = None
        self._start: Start | None = None
        self._away: SavedState | None = None
        self._credible = Credible()
        if isinstance(resume, Checkpoint):
            self._go_on(resume)
            return
        memory = Memory(initial.initial_state(config)) if resume is None else memory_of(resume)
        self._sound = memory.state.copy()
        self._begin(memory)
        if resume is not None:
            self._away = resume
            self._t_last_ns = resume.t_ns
            self._second = resume.t_ns // CALIBRATION_PERIOD_NS
        elif config.initial.align is not None:
            self._start = Start(config)

    @property
    def owes(self) -> bool:
        """Whether more is to be done at the newest sample than its solution."""
        return self._timeline.owes or self._t_last_ns // CALIBRATION_PERIOD_NS != self._second

    def feed(self, measurement: Measurement, count: int = 1) -> Iterator[FilterOutput]:
        """Take one measurement in the order of arrival; give what follows from it.

        It may stand for `count` blocks of samples that came one by one.
        """
        for output in self._take(measurement):
            self._said += not isinstance(output, SavedState | Checkpoint)
            yield output
        self._received += count

    def _take(self, measurement: Measurement) -> Iterator[FilterOutput]:
        """Take one measurement; give what follows."""
        if isinstance(measurement, ImuBlock):
            yield from self._feed_samples(measurement)
        else:
            yield from self._take_fix(measurement)

    def _take_fix(self, fix: Fix) -> Iterator[Verdict]:
        """Take a fix; keep it while the attitude is not found."""
        if self._start is not None:
            yield from self._keep_for(self._start, fix)
        else:
            yield from self._feed_fix(fix)

    def counts(self) -> FilterCounts:
        """Running totals."""
        memory, order = self._filter.memory, self._counts
        return FilterCounts(
            t_ns=self._t_last_ns,
            imu_samples=self._samples,
            fixes_used=memory.used,
            fixes_gated=memory.gated,
            fixes_late=order.late,
            fixes_too_late=order.too_late,
            fixes_too_early=order.too_early,
            fixes_duplicate=order.duplicate,
            resets=self._resets,
        )

    def finish(self) -> Iterator[FilterOutput]:
        """Give what remains when no more measurements will come."""
        yield from self._timeline.finish()

    def _begin(self, memory: Memory, after: Note | None = None) -> None:
        """Start a filter and a history, empty but for what a note tells."""
        self._filter = self._engine(initial.model(self._config), memory)
        self._timeline: Timeline[Verdict] = Timeline(
            self._filter,
            self._config.imu[1].rate_hz,
            self._config.filter.history_s,
            ahead_s=self._max_gap_s,
            after=after,
        )
        self._timeline.counts = self._counts
        self._noted: deque[Totals] = deque()

    def _go_on(self, at: Checkpoint) -> None:
        """Take over from an earlier process."""
        self._received, self._said = at.received, at.said
        self._credible = Credible(at.seconds, at.is_credible, at.t_ns)
        self._samples, self._resets = at.imu_samples, at.resets
        self._t_last_ns = self._taken_ns = at.t_ns
        self._second = at.t_ns // CALIBRATION_PERIOD_NS
        counts = at.fixes_late, at.fixes_too_late, at.fixes_too_early, at.fixes_duplicate
        self._counts = OrderCounts(*counts)
        memory = memory_of(at.state)
        self._sound = memory.state.copy()
        if at.aligning is not None:
            prior = memory.state.copy() if at.aligning.again else None
            self._start = Start(self._config, prior)
            self._start.go_on(at.aligning, at.fixes)
            self._begin(memory)
            return
        memory.origin_e = np.array(at.origin_e)
        known = tuple((fix.t_ns, _key(fix), fix) for fix in at.fixes)
        past = {t_ns: np.frombuffer(row).copy() for t_ns, row in at.past.items()}
        self._begin(memory, Note(at.consumed, at.t_ns, at.began_ns, known, self._counts, past=past))

    def _come_back(self, saved: SavedState, t_ns: int) -> None:
        """Take up a state of earlier for what it is worth now."""
        self._away = None
        away_s = max(0.0, (t_ns - saved.t_ns) * 1e-9)
        memory = memory_of(inflate(saved, away_s, self._filter.model.q))
        self._sound = memory.state.copy()
        if self._config.initial.align is not None and away_s > LONG_ABSENCE_S:
            self._start = Start(self._config, memory.state.copy())
        self._begin(memory)

    def _lose_sight(self, t_ns: int) -> Iterator[Verdict]:
        """Begin again after a silence too long to be bridged, at its end.

        Of the sample that stands in for it nothing is used.
        """
        memory, waiting = self._filter.memory, self._timeline.waiting()
        if self._start is not None:
            memory = replace(memory, state=self._start.waiting(self._t_last_ns))
            waiting += self._start.fixes
            self._start = None
        self._come_back(saved(memory, self._t_last_ns), t_ns)
        self._timeline.begin(t_ns)
        self._credible.pass_over()
        self._samples += 1
        self._t_last_ns = t_ns
        for fix in waiting:
            if fix.t_ns <= t_ns:
                yield _refused(fix, self._counts.refuse(Refusal.TOO_LATE))
            else:
                yield from self._take_fix(fix)

    def _begin_again(self) -> Iterator[Verdict]:
        """Start at the last sound state with the configured uncertainty."""
        sound, fresh = self._sound, initial.initial_state(self._config)
        self._resets += 1
        waiting = self._timeline.waiting()
        self._begin(Memory(State.at(sound.C_eb, sound.v_eb_e, sound.r_e, fresh.P, fresh.columns)))
        self._timeline.begin(self._t_last_ns)
        for fix in waiting:
            yield from self._feed_fix(fix)

    def _feed_samples(self, block: ImuBlock) -> Iterator[FilterOutput]:
        """Run over a block, pausing at every sample after which a solution is due."""
        t_ns = np.frombuffer(block.t_ns, dtype=np.int64)
        rows = np.frombuffer(block.rows, dtype=np.float64).reshape(-1, 8)
        if self._taken_ns is not None:  # a checkpoint may lie within a block
            new = t_ns > self._taken_ns
            t_ns, rows = t_ns[new], rows[new]
        if self._away is not None and len(t_ns):
            self._come_back(self._away, start_ns(t_ns, rows))
        begin = 0
        for k in self._too_long(rows):
            yield from self._feed_stretch(t_ns[begin:k], rows[begin:k])
            is_due = bool(self._due(t_ns[k : k + 1]))
            yield from self._lose_sight(int(t_ns[k]))
            if is_due:
                yield from self._report(int(t_ns[k]))
            begin = k + 1
        yield from self._feed_stretch(t_ns[begin:], rows[begin:])

    def _too_long(self, rows: NDArray[np.float64]) -> list[int]:
        """Which samples stand in for more than can be bridged; before the first nothing is lost."""
        missing_s: list[float] = rows[:, MISSING].tolist()  # of one sample, mostly
        long = [k for k, s in enumerate(missing_s) if s > self._max_gap_s]
        return long if self._samples else [k for k in long if k]

    def _feed_stretch(
        self, t_ns: NDArray[np.int64], rows: NDArray[np.float64]
    ) -> Iterator[FilterOutput]:
        """Run over samples without a gap that is too long."""
        begin = 0
        for end in self._due(t_ns):
            yield from self._extend(t_ns[begin:end], rows[begin:end])
            yield from self._report(int(t_ns[end - 1]))
            yield from self._timeline.catch_up()
            begin = end
        if begin < len(t_ns):
            yield from self._extend(t_ns[begin:], rows[begin:])
            yield from self._timeline.catch_up()

    def _extend(self, t_ns: NDArray[np.int64], rows: NDArray[np.float64]) -> Iterator[Verdict]:
        """Run over samples, counting them; before that find the attitude where it is not known."""
        if len(t_ns):
            self._samples += len(t_ns)
            self._t_last_ns = int(t_ns[-1])
        if self._start is not None:
            self._credible.pass_over()
            yield from self._start.take(t_ns, rows)
            start = self._start
            if start.state is None:
                return
            self._start, self._sound = None, start.state
            self._begin(replace(self._filter.memory, state=start.state.copy()))
            for fix in start.fixes:
                yield from self._feed_fix(fix)
            t_ns, rows = start.samples
        else:
            self._credible.add(t_ns, rows)
        if self._timeline.t_head_ns is None:
            for fix in self._timeline.begin(start_ns(t_ns, rows)):
                yield _refused(fix, Refusal.TOO_LATE)
        yield from self._timeline.extend(t_ns, rows)

    def _keep_for(self, start: Start, fix: Fix) -> Iterator[Verdict]:
        """Keep a fix until the attitude is found, within bounds."""
        far_ns = self._t_last_ns + round(self._max_gap_s * 1e9)
        if len(start.fixes) < MAX_WAITING and not (self._samples and fix.t_ns > far_ns):
            start.fixes.append(fix)
        else:
            yield _refused(fix, self._counts.refuse(Refusal.TOO_EARLY))

    def _feed_fix(self, fix: Fix) -> Iterator[Verdict]:
        """Give a fix its place in time."""
        verdicts: list[Verdict] | Refusal
        if self._away is None:
            verdicts = self._timeline.insert(fix, fix.t_ns, _key(fix))
        else:  # it is of the time away
            verdicts = self._counts.refuse(Refusal.TOO_LATE)
        if isinstance(verdicts, Refusal):
            yield _refused(fix, verdicts)
        else:
            yield from verdicts

    def _due(self, t_ns: NDArray[np.int64]) -> list[int]:
        """Counts of samples of the block after which a period begins."""
        due: list[int] = []
        tick = self._t_last_ns // self._period_ns
        for count, t in enumerate(t_ns.tolist(), 1):  # of one sample, mostly: no work for numpy
            before, tick = tick, t // self._period_ns
            if tick > before:
                due.append(count)
        return due

    def _report(self, t_ns: int) -> Iterator[FilterOutput]:
        """Solution at the newest sample, and once a second the constants and totals."""
        if self._start is not None:
            yield self._solution(self._start.waiting(t_ns), t_ns, Mode.ALIGNING, None)
            if self._is_new_second(t_ns):
                yield self.counts()
                yield from self._checkpoint_of(self._start, t_ns)
            return
        memory = self._filter.memory
        if not memory.state.is_sound():
            yield self._solution(self._sound, t_ns, Mode.FAULT, None)
            yield from self._begin_again()
            return
        age_ns = None if memory.t_used_ns is None else t_ns - memory.t_used_ns
        yield self._solution(memory.state, t_ns, self._mode(age_ns), age_ns)
        if self._is_new_second(t_ns):
            self._sound = memory.state.copy()
            self._credible.end_second(memory.state)
            yield calibration(memory.state, t_ns)
            yield self.counts()
            yield saved(memory, t_ns)
            yield from self._checkpoints()

    def _is_new_second(self, t_ns: int) -> bool:
        """Whether the totals of this second are still to be said."""
        before, self._second = self._second, t_ns // CALIBRATION_PERIOD_NS
        return self._second != before

    def _checkpoints(self) -> Iterator[Checkpoint]:
        """Note the present, and give an earlier one that nothing can change any more.

        The block in hand does not count as received: it may go on beyond this sample.
        """
        note = self._timeline.note()
        self._noted.append(self._totals(note))
        settled = self._timeline.settled()
        if settled is None:
            return
        while self._noted[0].note is not settled:
            self._noted.popleft()
        at = self._noted.popleft()
        yield checkpoint(at, tuple(self._filter.origin_e.tolist()), self._resets)

    def _checkpoint_of(self, start: Start, t_ns: int) -> Iterator[Checkpoint]:
        """Give the present of an alignment, where that is little; its end has no other past."""
        aligning = start.memory
        if aligning is None:
            return
        known = tuple((fix.t_ns, _key(fix), fix) for fix in start.fixes)
        order = replace(self._counts)
        note = Note(0, t_ns, 0, known, order, state=self._filter.memory)
        at = self._totals(note)
        yield checkpoint(at, (0.0, 0.0, 0.0), self._resets, aligning)

    def _totals(self, note: Note) -> Totals:
        """What stands beside a note of the present."""
        felt = self._credible
        counts = self._received, self._said, self._samples
        return Totals(note, *counts, felt.seconds, felt.is_credible)

    def _solution(self, state: State, t_ns: int, mode: Mode, age_ns: int | None) -> NavSolution:
        """The solution with the filter's totals."""
        memory = self._filter.memory
        age_s = None if age_ns is None else age_ns * 1e-9
        return solution(state, t_ns, mode, age_s, memory.used, memory.gated)

    def _mode(self, age_ns: int | None) -> Mode:
        """What the last fix that gave a place allows to be claimed, or that there was none."""
        if not self._credible.is_credible:
            return Mode.ALIGNING
        if age_ns is not None:
            return Mode.AIDED if age_ns <= self._max_fix_age_ns else Mode.DEAD_RECKONING
        return Mode.DEAD_RECKONING if self._filter.memory.aided else Mode.ALIGNING


def _refused(fix: Fix, why: str) -> Innovation:
    """Verdict on a fix that the filter does not see."""
    return Innovation(fix.t_ns, fix.device, fix.beacon, (), float("nan"), False, why)


def _key(fix: Fix) -> str:
    """What tells a fix from others of its time."""
    return repr(fix)
