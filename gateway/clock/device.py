"""From a device's own count to the host's time: its wraps, its resets, its offset and drift.

A count is placed by the lower envelope of the arrivals. It can never be ahead of what the time
since the one before allows, and never be late for good: either means that the device, or the host,
began anew.
"""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from gateway.clock.envelope import Before, Envelope
from gateway.clock.memory import (
    DRIFT_AGAIN,
    LATE_STRETCHES,
    OUTAGE_S,
    QUICK_S,
    ClockMemory,
    Placed,
)
from gateway.clock.report import ClockReport, Source, State

LOCKED_AFTER = 8
"""Stretches after which a clock is locked: what it learns then is slewed in, not stepped to."""
SLEW = 1e-3
"""Fastest correction of a locked clock: a millisecond a second."""
JITTER_AGAIN = 10
"""As if so many stretches after it had shown the jitter that was before: it is the line's."""
QUEUES = 100
"""Chunks over which the mean queue is taken."""
BACKLOG_S = 0.5
"""How much earlier than the first ones an arrival may be, for a line may begin with a backlog."""
EARLY_S = 1e-3
"""The same once locked, or ten sigma: whatever is earlier counts wrongly."""
WANDER = 1e-5
"""How far off a drift may be after a silence."""

NEVER = 1 << 62
"""Modulus of a count that does not turn over."""


class Tick(NamedTuple):
    """One count in the host's time.

    ``t_ns`` is when it was true; ``step_s`` nominal seconds of the device since the newest count
    before: 0 at the very first, not positive where that one or a newer one has been seen.
    """

    t_ns: int
    step_s: float


_Seen = tuple[float, float, float | None]
"""A count not placed yet: seconds of the device, delay of its arrival, and seconds since the last;
where the count began anew the host has to tell those."""


class DeviceClock:
    """Host time of one device's count.

    Parameters
    ----------
    unit_s
        Nominal seconds of one count.
    modulus
        Counts are 0 .. modulus-1 and then begin again.
    reorder_s
        How far behind the newest an older count may come; farther back, the device began anew.

    Attributes
    ----------
    resets
        How often it began anew.
    """

    def __init__(self, unit_s: float, modulus: int, reorder_s: float = 0.1) -> None:
        self._unit_s = self._period_s = unit_s
        self._modulus = modulus
        self._reorder = min(reorder_s / unit_s, modulus / 8)
        self._backlog = self._early = min(BACKLOG_S / unit_s, modulus / 8)
        self._patience = OUTAGE_S / unit_s if modulus * unit_s < QUICK_S else inf
        self._silent, self._locked = True, False
        self._origin_ns = self._t_last_ns = 0
        self._first = self._last = 0
        self._due_s = self._lag_s = 0.0
        self._before = Before()
        self._envelope = Envelope(self._before)
        self._queue_s = self._sure_queue_s = 0.0
        self._chunks = 0
        self.resets = 0

    @property
    def drift(self) -> float:
        """Host seconds in a nominal second of the device, less one."""
        return self._envelope.line.slope

    @property
    def early(self) -> float:
        """By how many counts an arrival may be early and still be believed."""
        return self._early

    @property
    def state(self) -> State:
        """Whether it has heard anything, and enough to be relied on."""
        if self._silent:
            return "silent"
        return "locked" if self._locked else "warming"

    def expected(self, t_arrival_ns: int) -> float:
        """Counts since the newest one, if what arrives now came without a queue."""
        if self._silent:
            return 0.0
        since_s = (t_arrival_ns - self._origin_ns) * 1e-9 - self._due_s
        return since_s / self._period_s

    def now(self, t_ns: int) -> float | None:
        """What the device counts at a moment, turns included; None before its first count."""
        return None if self._silent else self._last + self.expected(t_ns)

    def locate(self, value: int) -> int:
        """When a count near the newest one was, or will be, true (ns)."""
        half = self._modulus // 2
        count = self._last + (value - self._last + half) % self._modulus - half
        c = (count - self._first) * self._unit_s
        return self._origin_ns + round((c + self._envelope.height(c) + self._lag_s) * 1e9)

    def take(self, chunk: Sequence[tuple[int, int]]) -> list[Tick]:
        """Place the counts that came together.  # (M.60)

        What `learn` was not asked for before is done first.

        Parameters
        ----------
        chunk
            Counts with their arrivals (ns), all known delays taken off, in the order they came. The
            last says most, for it waited least: none is placed before it is known.
        """
        self.learn()
        ticks: list[Tick] = []
        seen: list[_Seen] = []
        for value, t_arrival_ns in chunk:
            one = self._look(value, t_arrival_ns)
            if one is None:
                ticks += map(self._place, seen)
                seen = [self._begin(value, t_arrival_ns)]
            else:
                seen.append(one)
        self._learn_queue(seen[-1])
        return ticks + [self._place(one) for one in seen]

    def learn(self) -> None:
        """Find the envelope anew where a stretch has ended: nothing that came waits for that."""
        envelope = self._envelope
        if not envelope.owes:
            return
        c = (self._last - self._first) * self._unit_s
        before = envelope.height(c)
        envelope.fit()
        if envelope.line.sigma is None:
            return
        moved = envelope.height(c) - before
        self._due_s += moved
        self._moved(moved)
        if not envelope.late:  # else it may be no queue
            self._sure_queue_s = self._queue_s

    def memory(self) -> ClockMemory | None:
        """What is worth keeping when this process ends; None where nothing is known."""
        self.learn()
        known = self._unit_s, self._modulus, self._heritage(), self._sure_queue_s
        if self._locked:
            where = self._origin_ns, self._t_last_ns, self._first, self._last
            placed = Placed(*where, self._due_s, self._lag_s, self._envelope.memory)
            return ClockMemory(*known, placed)
        return None if self._before == Before() else ClockMemory(*known)

    def resume(self, memory: ClockMemory) -> None:
        """Go on from what an earlier process knew; that of another count is of no use."""
        if (memory.unit_s, memory.modulus) != (self._unit_s, self._modulus):
            return
        self._before = memory.before
        self._queue_s = self._sure_queue_s = memory.queue_s
        placed = memory.placed
        if placed is None:
            return
        self._silent, self._locked = False, True
        self._origin_ns, self._t_last_ns = placed.origin_ns, placed.t_last_ns
        self._first, self._last = placed.first, placed.last
        self._due_s, self._lag_s = placed.due_s, placed.lag_s
        self._envelope = Envelope.of(placed.envelope)
        self._rely_on_envelope()

    def report(self, source: Source, untimed: int = 0) -> ClockReport:
        """Offset, drift and how sure they are."""
        if self._silent:
            return ClockReport(source, "silent", resets=self.resets, untimed=untimed)
        line = self._envelope.line
        c = (self._last - self._first) * self._unit_s
        zero_s = self._origin_ns * 1e-9 + self._envelope.height(c) - self._first * self._unit_s
        return ClockReport(
            source,
            self.state,
            offset_s=round(zero_s, 6),
            drift_ppm=round(1e6 * line.slope, 3) if line.sigma is not None else None,
            sigma_ms=round(1e3 * (line.sigma + abs(self._lag_s)), 4)
            if line.sigma is not None
            else None,
            jitter_ms=round(1e3 * self._envelope.jitter_s, 4) if line.sigma is not None else None,
            resets=self.resets,
            untimed=untimed,
        )

    def _look(self, value: int, t_arrival_ns: int) -> _Seen | None:
        """Learn from an arrival; None if the count began anew.

        A count cannot arrive before it is true, so of all steps that lead to the value the longest
        that ends by now is right, whole turns missing or none.
        """
        since_origin_s = (t_arrival_ns - self._origin_ns) * 1e-9
        expected = (since_origin_s - self._due_s) / self._period_s
        if self._silent or expected > self._patience:
            return None
        at_most = int(expected * (1.0 + WANDER) + self._early)
        step = (value - self._last) % self._modulus
        step += (at_most - step) // self._modulus * self._modulus
        if step < -self._reorder:
            return None
        count, envelope = self._last + step, self._envelope
        c = (count - self._first) * self._unit_s
        delay = since_origin_s - c
        at, height, slope, _ = envelope.line
        y = height + slope * (c - at)
        if envelope.add(c, delay, delay - y):
            self._moved(delay - y)
            y = delay
        if envelope.late >= LATE_STRETCHES and envelope.line.sigma is not None:
            return None
        if step > 0:
            self._last, self._due_s = count, c + y
        return c, delay, step * self._unit_s

    def _moved(self, by_s: float) -> None:
        """Note that the envelope moved: a locked clock slews, and knows what is too early."""
        if self._envelope.stretches < LOCKED_AFTER:
            self._lag_s = 0.0
            self._period_s = self._unit_s * (1.0 + self.drift)
        else:
            self._locked = True
            self._lag_s -= by_s
            self._rely_on_envelope()

    def _rely_on_envelope(self) -> None:
        """Take it for the truth, within what it says of itself."""
        self._period_s = self._unit_s * (1.0 + self.drift)
        early_s = max(EARLY_S, 10.0 * (self._envelope.line.sigma or 0.0))
        self._early = min(self._backlog, early_s / self._unit_s)

    def _learn_queue(self, last: _Seen) -> None:
        """How long a chunk waits on the mean: so much the first ones after a reset are late."""
        if self._locked:
            c, delay, _ = last
            self._queue_s += (delay - self._envelope.height(c) - self._queue_s) / QUEUES
        elif self._envelope.line.sigma is None:
            self._chunks += 1
            self._lag_s = -self._queue_s / self._chunks

    def _place(self, seen: _Seen) -> Tick:
        """Time of a count by the envelope, corrections slewed in; never after its arrival."""
        c, delay, step_s = seen
        at, height, slope, _ = self._envelope.line
        y = height + slope * (c - at)
        if self._lag_s:
            reach = SLEW * max(step_s or 0.0, 0.0)
            self._lag_s -= min(max(self._lag_s, -reach), reach)
            y += self._lag_s
            if y > delay:
                self._lag_s -= y - delay
                y = delay
        t_ns = self._origin_ns + round((c + y) * 1e9)
        if step_s is None:
            step_s = max(t_ns - self._t_last_ns, 0) * 1e-9 / (1.0 + self.drift)
        self._t_last_ns = t_ns
        return Tick(t_ns, step_s)

    def _begin(self, value: int, t_arrival_ns: int) -> _Seen:
        """Start from this arrival; a drift that was known is nearly the same still."""
        self._before = self._heritage()
        if self._silent:
            self._silent, self._t_last_ns = False, t_arrival_ns
        else:
            self.resets += 1
        self._origin_ns = t_arrival_ns
        self._first = self._last = value
        self._due_s = self._lag_s = 0.0
        self._locked = False
        self._early = self._backlog
        self._envelope = Envelope(self._before)
        self._queue_s, self._chunks = self._sure_queue_s, 0
        return 0.0, 0.0, None

    def _heritage(self) -> Before:
        """What is believed where the count begins anew."""
        if self._locked:
            return Before(self.drift, DRIFT_AGAIN, self._envelope.jitter_s, JITTER_AGAIN)
        return self._before if self._silent else Before()
