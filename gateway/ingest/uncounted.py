"""Frames that neither count nor time themselves: how many are lost, and what was taken for lost.

What has not come may be lost or may wait in a queue. A queue shows in those behind: they come
faster than they were made. Where they do not, samples are bridged; if they come after all, which
shows in more frames than the time allows, each is taken for the share of the bridge that stood in
for it.
"""

from collections import deque
from math import ceil, floor

from gateway.clock import DeviceClock

Vector = tuple[float, float, float]

SURE = 3
"""Chunks that must be late alike before frames are taken for lost."""
DRAINING = 0.5
"""By how many frames less late the last of them is where a queue is running empty."""
WORST_KEPT_S = 10.0
"""How long it is remembered how late frames may come."""
ROUNDING = 0.05
"""Part of a frame by which one that was lost may seem not to be."""
EARLIEST = 0.25
"""Part of a frame by which one may be ahead of the time, at most."""
SWAY_TURN, TURN_WALK = 0.06, 0.05
"""rms of a vessel's turn (rad/s); the walk of its rate that bridges are weighed by."""
NOTHING: Vector = (0.0, 0.0, 0.0)


def in_doubt_s(missing_s: float) -> float:
    """Time for which samples are lost that leaves as little known as one of which they may be late.

    What is then taken for the present is so much older.  # (M.177)
    """
    late_s = float((3.0 * (SWAY_TURN / TURN_WALK * missing_s) ** 2) ** (1.0 / 3.0))
    return max(missing_s, late_s)


class Frames:
    """The count of a unit's frames."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._counted = 0
        self._late: deque[float] = deque(maxlen=SURE)
        self._worst = self._draining = 0.0

    def lost(self, clock: DeviceClock, arrived: int, t_arrival_ns: int) -> int:
        """How many were lost before the ones that came together, the last of them just now.

        They are late by more than any were for a while, and those behind them no less.
        """
        late = clock.expected(t_arrival_ns) - arrived
        self._late.append(late)
        if len(self._late) < SURE:
            return 0
        least = min(self._late)
        is_late = least > 1.5 * self._worst + 0.5
        if is_late and self._late[0] - late > DRAINING:  # or jitter: the next ones tell
            self._draining = max(self._draining, least)
            return 0
        lost = floor(least + ROUNDING) if is_late else 0
        forgotten = min(1.0, arrived * self._period_s / WORST_KEPT_S)
        queued = max(least, self._draining) - lost
        self._worst, self._draining = max(self._worst * (1.0 - forgotten), queued), 0.0
        self._late = deque((one - lost for one in self._late), maxlen=SURE)
        return lost

    def surplus(self, clock: DeviceClock, arrived: int, t_arrival_ns: int) -> int:
        """How many more came than can have been made since the newest."""
        more = arrived - clock.expected(t_arrival_ns)
        return max(0, ceil(more - min(EARLIEST, clock.early)))

    def number(self, arrived: int, lost: int) -> list[int]:
        """Counts of those that came."""
        first = self._counted + lost + 1
        self._counted = first + arrived - 1
        return list(range(first, self._counted + 1))


class Bridge:
    """What stands in for samples that were taken for lost, in the body's present axes.

    Attributes
    ----------
    samples
        How many it still stands in for.
    """

    def __init__(self) -> None:
        self.samples = 0
        self._turn = self._gain = self._since = NOTHING
        self._owed_turn = self._owed_gain = NOTHING

    def build(self, samples: int, turn: Vector, gain: Vector) -> None:
        """Stand in for samples with the increments of one."""
        self.samples, self._turn, self._gain, self._since = samples, turn, gain, NOTHING

    def forget(self) -> None:
        """Take what was bridged for lost."""
        self.samples = 0

    def exchange(self, turn: Vector, gain: Vector) -> None:
        """Take a sample that came after all for its share.  # (M.178)

        What the share turned, it turned the specific force of since then by.
        """
        self.samples -= 1
        self._owed_turn = _plus(self._owed_turn, _less(turn, self._turn))
        bent = _cross(self._turn, self._since)
        self._owed_gain = _plus(self._owed_gain, _less(_less(gain, self._gain), bent))

    def settle(self, turn: Vector, gain: Vector) -> tuple[Vector, Vector]:
        """The next sample with what is owed, and the bridge in the axes after it."""
        turn, gain = _plus(turn, self._owed_turn), _plus(gain, self._owed_gain)
        self._owed_turn = self._owed_gain = NOTHING
        if self.samples:
            self._turn = _less(self._turn, _cross(turn, self._turn))
            self._gain = _less(self._gain, _cross(turn, self._gain))
            self._since = _plus(_less(self._since, _cross(turn, self._since)), gain)
        return turn, gain


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _less(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
