"""Filters that take notes: of each fix they used, and of all that a smoother needs."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gateway.engine import Track
from gateway.fusion.filter import Filter
from gateway.fusion.restart import unseen_transition
from gateway.fusion.state import State
from gateway.messages import Fix, Verdict
from gateway.nav import transition

Array = NDArray[np.float64]

KNOT_S = 1.0
"""Knots are at most about this far apart: between them a smoothed solution is interpolated."""


@dataclass
class Remembered:
    """A track that keeps what it was asked, and so can answer it again."""

    track: Track
    answers: dict[int, Array] = field(default_factory=dict)

    def at(self, t_ns: int) -> Array:
        """Interpolated (12,) track at a time in the past."""
        if t_ns not in self.answers:
            self.answers[t_ns] = self.track.at(t_ns)
        return self.answers[t_ns]


@dataclass(frozen=True)
class Use:
    """A fix that was used: the state after it, and the past that its model asked for."""

    fix: Fix
    state: State
    past: Remembered


@dataclass
class NotingFilter(Filter):
    """A filter that keeps the state at each fix it used."""

    uses: dict[Fix, Use] = field(init=False, default_factory=dict)

    def apply(self, fix: Fix, track: Track) -> Verdict:
        """Use one fix at its time, or say why not."""
        past = Remembered(track)
        verdict = super().apply(fix, past)
        self.uses.pop(fix, None)  # used before, and again from an earlier snapshot
        if verdict.accepted:
            self.uses[fix] = Use(fix, self.memory.state.copy(), past)
        return verdict


@dataclass(frozen=True)
class Knot:
    """A moment of the forward pass.

    Attributes
    ----------
    position
        Samples consumed, with the share of the next one.
    before, after
        State before and after the fix of this moment; the same object where there is none.
    Phi
        (n, n) transition of the additive error from ``after`` of the knot before to ``before``.
    use
        The fix, where one was used.
    """

    position: float
    before: State
    Phi: Array
    after: State
    use: Use | None


@dataclass
class RecordingFilter(NotingFilter):
    """A filter that records its forward pass; measurements must come in the order of time."""

    knots: list[Knot] = field(init=False, default_factory=list)
    blocks: list[Array] = field(init=False, default_factory=list)
    """The samples consumed, (k, 8) each."""
    consumed: int = field(init=False, default=0)
    """How many samples they are."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._Phi = transition.identity()
        self._since_s = 0.0
        self._share = 0.0
        self._knot()

    def _carry(self, rows: Array, track: Array) -> None:
        state = self.memory.state
        transition.run(state.x, state.P, self._Phi, rows, self.model.q, track)
        self._consume(rows)
        self._since_s += float(rows[:, 0].sum())
        if self._since_s >= KNOT_S:
            self._knot()

    def _carry_part(self, row: Array, begin: float, end: float) -> None:
        state = self.memory.state
        transition.advance(state.x, state.P, self._Phi, row, begin, end, self.model.q)
        self._since_s += (end - begin) * float(row[0])
        self._pass(row, end)

    def _lose_sight(self, row: Array, begin: float, end: float) -> None:
        """A knot on either side: in between nothing can be interpolated."""
        self._knot()
        super()._lose_sight(row, begin, end)
        self._Phi = unseen_transition((end - begin) * float(row[0]))
        self._pass(row, end)
        self._knot()

    def apply(self, fix: Fix, track: Track) -> Verdict:
        """Use one fix at its time, or say why not.

        A refused one is a knot where it grew the covariance: what the filter doubts is its own
        past, so the smoother must go back through it as through an update, not through noise.
        """
        before = self.memory.state.copy()
        verdict = super().apply(fix, track)
        if verdict.accepted or not np.array_equal(before.P, self.memory.state.P):
            self._knot(before, self.uses.get(fix))
        return verdict

    def restore(self, saved: object) -> None:
        """Refuse: going back would leave knots that never were."""
        raise AssertionError("a forward pass was given a late measurement")

    def close(self) -> None:
        """End the pass with a knot, and forget those at its end that are not sound."""
        self._knot()
        while len(self.knots) > 1 and not self.knots[-1].after.is_sound():
            self.knots.pop()

    @property
    def rows(self) -> Array:
        """(k, 8) all samples consumed."""
        return np.concatenate(self.blocks) if self.blocks else np.zeros((0, 8))

    def _knot(self, before: State | None = None, use: Use | None = None) -> None:
        """Record the present; `before` is the state before the fix just used."""
        after = self.memory.state.copy()
        Phi = transition.whole(self._Phi, len(after.columns))
        self.knots.append(Knot(self.consumed + self._share, before or after, Phi, after, use))
        self._Phi = transition.identity()
        self._since_s = 0.0

    def _pass(self, row: Array, end: float) -> None:
        """Count the share of a sample that is behind."""
        self._share = end
        if end == 1.0:
            self._consume(row[None])

    def _consume(self, rows: Array) -> None:
        self.blocks.append(rows.copy())
        self.consumed += len(rows)
        self._share = 0.0
