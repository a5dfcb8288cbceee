"""The line below delays: where no queue was, how steep it runs, and how surely that is known.

A queue only ever adds, so the truth is the lower envelope of arrival minus count. The least delay
of each short stretch is kept; the line is the mean over all lines below them, each as likely as it
is under delays that thin out exponentially and a drift such as quartz has.
"""

from collections import deque
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STRETCH_S = 1.0
WINDOW = 60
"""Stretches kept: one minute, or as many arrivals where they are rarer than stretches."""
FIT_AFTER = 4
"""Stretches below which the line is that of the least delay alone: its sigma is not known yet."""
DRIFT_BOUND = 1.5e-3
"""No device is worse; beyond it the nominal rate is another one."""
RESOLUTION_S = 1e-6
"""Delays are not told apart any finer."""
STRAY = 20.0
"""Delays of more than this many medians say nothing about the line."""
LATE_S = 0.01
"""Later than this, and than the other stretches' delays differ, is more than queueing; earlier than
this, and the stretches before say nothing."""

_GRID = 65
_NEGLIGIBLE = 16.0
"""Slopes less likely than the best by exp of this do not count."""


class Before(NamedTuple):
    """What is believed beforehand.

    The drift is about `drift`, give or take `scale` (or far more); the mean delay of the stretches
    about `jitter_s`, as surely as if it had been seen on `seen` of them.
    """

    drift: float = 0.0
    scale: float = 50e-6
    jitter_s: float = 0.0
    seen: int = 0


class Line(NamedTuple):
    """A line: its height and slope at an abscissa, and the sigma of the height there (s)."""

    at: float
    height: float
    slope: float
    sigma: float | None


class EnvelopeMemory(NamedTuple):
    """An envelope as it outlives its process: `Envelope` with all it has kept.

    ``end`` is that of the stretch in hand; None where the next arrival begins one.
    """

    before: Before
    line: Line
    jitter_s: float
    spread_s: float
    late: int
    end: float | None
    least: tuple[float, float]
    past: tuple[tuple[float, float], ...]


class Envelope:
    """The lower envelope of delays as they come in, each beyond that of the first.

    Attributes
    ----------
    line
        The envelope as it is known.
    jitter_s
        Mean of the stretches' least delays above it.
    late
        How many stretches up to now kept far above it.
    """

    def __init__(self, before: Before) -> None:
        self._before = before
        self.line = Line(0.0, 0.0, before.drift, None)
        self.jitter_s = before.jitter_s
        self.late = 0
        self._spread_s = 0.0
        self._end: float | None = STRETCH_S
        self._ended_at: float | None = None
        self._least = (0.0, 0.0)
        self._past: deque[tuple[float, float]] = deque(maxlen=WINDOW)

    @classmethod
    def of(cls, memory: EnvelopeMemory) -> "Envelope":
        """The envelope that was remembered."""
        envelope = cls(memory.before)
        envelope.line, envelope.jitter_s = memory.line, memory.jitter_s
        envelope.late, envelope._spread_s = memory.late, memory.spread_s
        envelope._end, envelope._least = memory.end, memory.least
        envelope._past.extend(memory.past)
        return envelope

    @property
    def memory(self) -> EnvelopeMemory:
        """All that it has kept."""
        return EnvelopeMemory(
            self._before,
            self.line,
            self.jitter_s,
            self._spread_s,
            self.late,
            self._end,
            self._least,
            tuple(self._past),
        )

    @property
    def stretches(self) -> int:
        """How many stretches the line rests on."""
        return len(self._past)

    def height(self, c: float) -> float:
        """Delay (s) at the count `c` (s) where there is no queue."""
        at, height, slope, _ = self.line
        return height + slope * (c - at)

    @property
    def owes(self) -> bool:
        """Whether a stretch has ended since the line was found: `fit` has something to do."""
        return self._ended_at is not None

    def add(self, c: float, delay: float, above: float) -> bool:
        """Take the delay of one arrival, so much above the line; tell whether the line moved."""
        if self._end is None:
            self._end = c + STRETCH_S
        if delay < self._least[1]:
            self._least = (c, delay)
        if above < 0.0:
            self.line = self.line._replace(height=self.line.height + above)
        if above < -LATE_S:  # what came before waited in a backlog, or is of another count
            self._past.clear()
            self._ended_at = None
        if c >= self._end:
            self._close(c)
        return above < 0.0

    def fit(self) -> None:
        """Find the line anew from the stretches, for where the last of them ended."""
        c, self._ended_at = self._ended_at, None
        assert c is not None
        x, r = np.array(self._past).T
        above = r - self.line.slope * x
        above -= above.min()
        middle = np.median(above)
        self._spread_s = float(np.median(np.abs(above - middle)))
        near = above <= STRAY * middle + RESOLUTION_S
        if np.count_nonzero(near) + self._before.seen < FIT_AFTER:
            return
        self.line, self.jitter_s = line_below(x[near], r[near], c, self._before)

    def _close(self, c: float) -> None:
        """Keep the least delay of the stretch, and begin the next one."""
        late = self._least[1] - self.height(self._least[0]) > max(LATE_S, STRAY * self._spread_s)
        self.late = self.late + 1 if late else 0
        self._past.append(self._least)
        self._least = (c, inf)
        self._end = c + STRETCH_S
        self._ended_at = c


def line_below(x: Array, r: Array, at: float, before: Before) -> tuple[Line, float]:
    """The line below all points (x, r), as the mean of what it may be.  # (M.61)

    Parameters
    ----------
    x, r
        (n,) s: abscissas, and ordinates that delays raised above the line. At least four, or fewer
        by those `before` has seen.
    at
        Abscissa where its height is asked for.
    before
        What is believed of its slope and of the delays.

    Returns
    -------
    line, jitter
        The line, and the mean delay (s).
    """
    n, middle, mean = x.size, x.mean(), r.mean()
    known = n + before.seen
    z = (x - middle)[:, np.newaxis]
    low, high = -DRIFT_BOUND, DRIFT_BOUND
    while True:
        slope = np.linspace(low, high, _GRID)
        top = (r[:, np.newaxis] - z * slope).min(axis=0)
        gap = np.maximum(mean - top, RESOLUTION_S) + before.seen * before.jitter_s / n
        prior = -2.0 * np.log1p(((slope - before.drift) / before.scale) ** 2 / 3.0)
        likely = prior - (known - 1) * np.log(gap)
        likely -= likely.max()
        first, last = np.flatnonzero(likely > -_NEGLIGIBLE)[[0, -1]]
        if last - first > _GRID // 3:
            break
        low, high = slope[max(first - 1, 0)], slope[min(last + 1, _GRID - 1)]
    weight = np.exp(likely)
    weight /= weight.sum()
    heights = top - gap / (known - 2) + slope * (at - middle)
    height, steepness = float(weight @ heights), float(weight @ slope)
    spread = gap**2 * (known - 1) / ((known - 2) ** 2 * (known - 3))
    sigma = float(np.sqrt(weight @ (spread + (heights - height) ** 2)))
    jitter = float(weight @ gap) * n / (known - 2)
    return Line(at, height, steepness, sigma), jitter
