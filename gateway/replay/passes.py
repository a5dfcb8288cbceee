"""An estimator over measurements that are all at hand: as they arrived, or smoothed in their order.

Pure, like the estimator: no files, no clock.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.config import Config
from gateway.estimator import Estimator
from gateway.fusion.memory import Memory
from gateway.fusion.observation import Model, observe
from gateway.fusion.recording import NotingFilter, RecordingFilter, Use
from gateway.fusion.report import calibration, solution
from gateway.fusion.saved import state_of
from gateway.fusion.smoother import between, smooth
from gateway.fusion.state import State
from gateway.messages import (
    Calibration,
    Checkpoint,
    FilterCounts,
    FilterOutput,
    ImuBlock,
    Measurement,
    NavSolution,
    SavedState,
)
from gateway.modes import Mode, claimable
from gateway.nav import strapdown
from gateway.progress import Tell, nobody

Array = NDArray[np.float64]


class Residual(NamedTuple):
    """One row of a used fix against the track: measured minus predicted, edge units.

    ``before`` with all acoustic constants at their configured values, ``after`` with the estimated
    ones; ``sigma`` of the white error.
    """

    t_ns: int
    device: str
    beacon: str
    component: str
    before: float
    after: float
    sigma: float


class ForwardPass:
    """The estimator as a live gateway runs it.

    Parameters
    ----------
    config, rate_hz, resume
        As those of `gateway.estimator.Estimator`.
    """

    def __init__(self, config: Config, rate_hz: float, resume: SavedState | None = None) -> None:
        self._filters: list[NotingFilter] = []
        self._estimator = Estimator(config, rate_hz, resume, self._engine)
        self._last: State | None = None

    def feed(self, measurement: Measurement) -> Iterator[FilterOutput]:
        """Take one measurement in the order of arrival; give what follows from it."""
        for output in self._estimator.feed(measurement):
            if isinstance(output, SavedState):
                self._last = state_of(output)
            yield output

    def finish(self) -> Iterator[FilterOutput]:
        """Give what remains when all measurements were fed."""
        return self._estimator.finish()

    def counts(self) -> FilterCounts:
        """Totals of the filter."""
        return self._estimator.counts()

    def last(self) -> State | None:
        """The last state whose constants were given out; None before the first."""
        return self._last

    def residuals(self) -> list[Residual]:
        """Rows of every used fix against the filter's track, with the constants of its end."""
        if self._last is None:
            return []
        constants = self._last.x[strapdown.N_MEAN :]
        return [
            row
            for engine in self._filters
            for use in engine.uses.values()
            for row in _residuals(engine.model, use, use.state, constants)
        ]

    def _engine(self, model: Model, memory: Memory) -> NotingFilter:
        self._filters.append(NotingFilter(model, memory))
        return self._filters[-1]


@dataclass
class _Stretch:
    """One filter from its start to its end or to a reset, and what was given out meanwhile."""

    engine: RecordingFilter
    epochs: list[tuple[int, FilterOutput]] = field(default_factory=list)
    """Samples consumed and the forward pass's output at that moment."""
    states: list[State] = field(default_factory=list)


class SmoothedPass:
    """A fixed-interval smoother: the same outputs, each from all measurements of the interval.

    Measurements are used in the order of their times, however late they arrived.

    Parameters
    ----------
    config, rate_hz, resume
        As those of `gateway.estimator.Estimator`.
    tell
        Is told how far it is with filtering, smoothing and giving out.
    """

    def __init__(
        self,
        config: Config,
        rate_hz: float,
        resume: SavedState | None = None,
        tell: Tell = nobody,
    ) -> None:
        self._tell = tell
        self._max_age_ns = config.filter.max_fix_age_s * 1e9
        self._measurements: list[Measurement] = []
        self._stretches: list[_Stretch] = []
        self._estimator = Estimator(config, rate_hz, resume, self._engine)
        self._last: State | None = None

    def feed(self, measurement: Measurement) -> Iterator[FilterOutput]:
        """Take one measurement; nothing follows before the last."""
        self._measurements.append(measurement)
        return iter(())

    def finish(self) -> Iterator[FilterOutput]:
        """Run forward and back, and give everything in the order of time."""
        for n, measurement in enumerate(sorted(self._measurements, key=_moment), 1):
            self._tell("filtering", n / len(self._measurements))
            for output in self._estimator.feed(measurement):
                if not self._stretches:
                    yield output  # no filter yet: nothing to smooth
                elif not isinstance(output, SavedState | Checkpoint):
                    stretch = self._stretches[-1]
                    stretch.epochs.append((stretch.engine.consumed, output))
        for stretch in self._stretches:
            stretch.engine.close()
            stretch.states = smooth(stretch.engine, partial(self._tell, "smoothing"))
        used_ns = np.array(self._located())
        for stretch in self._stretches:
            yield from self._outputs(stretch, used_ns)

    def counts(self) -> FilterCounts:
        """Totals of the forward pass."""
        return self._estimator.counts()

    def last(self) -> State | None:
        """The last state whose constants were given out; None before the first."""
        return self._last

    def residuals(self) -> list[Residual]:
        """Rows of every used fix against the smoothed track, with the smoothed constants."""
        return [
            row
            for stretch in self._stretches
            for knot, state in zip(stretch.engine.knots, stretch.states, strict=True)
            if knot.use is not None
            for row in _residuals(
                stretch.engine.model, knot.use, state, state.x[strapdown.N_MEAN :]
            )
        ]

    def _outputs(self, stretch: _Stretch, used_ns: NDArray[np.int64]) -> Iterator[FilterOutput]:
        """The forward pass's outputs with the smoothed state in place of the filter's."""
        end = stretch.engine.knots[-1].position
        within = [at for at, output in stretch.epochs if _is_of_state(output) and 0 < at <= end]
        states = iter(between(stretch.engine, stretch.states, within))
        for n, (at, output) in enumerate(stretch.epochs, 1):
            self._tell("writing", n / len(stretch.epochs))
            if not (_is_of_state(output) and 0 < at <= end):  # aligning, or no longer sound
                yield output
                continue
            state = next(states)
            if isinstance(output, Calibration):
                self._last = state
                yield calibration(state, output.t_ns)
            elif isinstance(output, NavSolution):
                yield self._solution(state, output, used_ns)

    def _solution(
        self, state: State, forward: NavSolution, used_ns: NDArray[np.int64]
    ) -> NavSolution:
        """A smoothed solution; the fix nearest in time is what its claim rests on.

        What the IMU felt is as incredible afterwards.
        """
        knows_heading = claimable(Mode.AIDED, forward.sd_attitude[2]) is Mode.AIDED
        is_doubted = forward.mode is Mode.ALIGNING and forward.fix_age_s is not None
        if used_ns.size == 0 or forward.mode is Mode.FAULT:
            mode, age_ns = forward.mode, None
        else:
            age_ns = int(np.abs(used_ns - forward.t_ns).min())
            mode = Mode.AIDED if age_ns <= self._max_age_ns else Mode.DEAD_RECKONING
            if is_doubted and knows_heading:
                mode = Mode.ALIGNING
        age_s = None if age_ns is None else age_ns * 1e-9
        totals = forward.fixes_used, forward.fixes_rejected
        return solution(state, forward.t_ns, mode, age_s, *totals)

    def _located(self) -> list[int]:
        """Times of the fixes that bound the error of the position."""
        uses = (use for s in self._stretches for use in s.engine.uses.values())
        return [use.fix.t_ns for use in uses if use.fix.locates]

    def _engine(self, model: Model, memory: Memory) -> RecordingFilter:
        engine = RecordingFilter(model, memory)
        self._stretches.append(_Stretch(engine))
        return engine


def _moment(measurement: Measurement) -> tuple[int, bool]:
    """Order in which a forward pass takes measurements: a fix before the samples that reach it."""
    if isinstance(measurement, ImuBlock):
        return int(np.frombuffer(measurement.t_ns, dtype=np.int64)[-1]), True
    return measurement.t_ns, False


def _is_of_state(output: FilterOutput) -> bool:
    """Whether it tells the state, which smoothing changes."""
    if isinstance(output, NavSolution):
        return output.mode is not Mode.FAULT
    return isinstance(output, Calibration)


def _residuals(model: Model, use: Use, state: State, constants: Array) -> list[Residual]:
    """Rows of one fix at a state, without and with the estimated acoustic constants."""
    after, before = state.copy(), state.copy()
    after.x[strapdown.N_MEAN :], before.x[strapdown.N_MEAN :] = constants, 0.0
    z, z_before = (observe(model, s, use.fix, use.past) for s in (after, before))
    if isinstance(z, str) or isinstance(z_before, str):
        return []
    earlier = dict(zip(z_before.names, z_before.residual, strict=True))
    fix, rows = use.fix, []
    for name, residual, variance in zip(z.names, z.residual, z.R.diagonal(), strict=True):
        unit = np.degrees(1.0) if name.endswith("_deg") else 1.0
        numbers = -earlier.get(name, np.nan) * unit, -residual * unit, np.sqrt(variance) * unit
        rows.append(Residual(fix.t_ns, fix.device, fix.beacon, name, *map(float, numbers)))
    return rows
