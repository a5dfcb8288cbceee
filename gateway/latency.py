"""How long each stage takes, as histograms that cost a microsecond an event and never grow."""

import math
from array import array
from collections import deque

import msgspec
import numpy as np
from numpy.typing import NDArray

Counts = NDArray[np.uint64]

FINE_BITS = 4
"""Buckets an octave, as a power of two: a value is known to 6 %."""
BUCKETS = 37 << FINE_BITS
"""Up to 18 minutes; what takes longer falls into the last one."""
SLICE_S = 10.0
SLICES = 6
"""Closed slices that make up "recently": the last minute, and the slice under way."""
QUANTILES = (0.5, 0.99, 0.999)
REMEMBERED = 4096
"""Blocks under way whose arrival is remembered; it is for the figures only."""


class Spread(msgspec.Struct, frozen=True):
    """Quantiles of one stage (µs), at most 6 % too high; None of nothing."""

    count: int
    p50_us: float | None
    p99_us: float | None
    p99_9_us: float | None
    max_us: float | None


class StageReport(msgspec.Struct, frozen=True):
    """One stage of one device or output: over the last minute and since the start."""

    stage: str
    of: str
    recent: Spread
    since_start: Spread


class Histogram:
    """Durations in buckets of equal ratio."""

    def __init__(self) -> None:
        self._now = array("Q", bytes(8 * BUCKETS))
        self._view: Counts = np.frombuffer(self._now, dtype=np.uint64)
        self._past: deque[tuple[Counts, int]] = deque(maxlen=SLICES)
        self._all: Counts = np.zeros(BUCKETS, dtype=np.uint64)
        self._longest = self._longest_ever = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration (ns); a clock that stepped back makes it 0."""
        if duration_ns > self._longest:
            self._longest = duration_ns
        octave = duration_ns.bit_length() - FINE_BITS - 1
        if duration_ns < 0:
            bucket = 0
        elif octave <= 0:
            bucket = duration_ns
        else:
            bucket = (octave << FINE_BITS) + (duration_ns >> octave)
            if bucket >= BUCKETS:
                bucket = BUCKETS - 1
        self._now[bucket] += 1

    def close_slice(self) -> None:
        """Begin a new slice; the oldest one is no longer recent."""
        self._past.append((self._view.copy(), self._longest))
        self._all += self._view
        self._longest_ever = max(self._longest_ever, self._longest)
        self._view[:] = 0
        self._longest = 0

    def recent(self) -> Spread:
        """Spread over the last minute."""
        counts, longest = self._view.copy(), self._longest
        for past, longest_then in self._past:
            counts += past
            longest = max(longest, longest_then)
        return _spread(counts, longest)

    def since_start(self) -> Spread:
        """Spread over all."""
        return _spread(self._all + self._view, max(self._longest, self._longest_ever))


class Stages:
    """The histograms of one run, by stage and by device or output."""

    def __init__(self) -> None:
        self._histograms: dict[tuple[str, str], Histogram] = {}
        self._slice_end: float | None = None

    def add(self, stage: str, of: str, duration_ns: int) -> None:
        """Count one duration (ns) of a stage."""
        histogram = self._histograms.get((stage, of))
        if histogram is None:
            histogram = self._histograms[stage, of] = Histogram()
        histogram.add(duration_ns)

    def turn(self, now: float) -> None:
        """Let time go on (s)."""
        if self._slice_end is None:
            self._slice_end = now + SLICE_S
        if now >= self._slice_end:
            self._slice_end = now + SLICE_S
            for histogram in self._histograms.values():
                histogram.close_slice()

    def report(self) -> list[StageReport]:
        """All spreads, in the order of first use."""
        return [
            StageReport(stage, of, histogram.recent(), histogram.since_start())
            for (stage, of), histogram in self._histograms.items()
        ]


class Passage:
    """Times bytes on their way to the outputs; all times are host monotonic ns.

    ======== ========= ==========================================================
    stage    of        from, to
    ======== ========= ==========================================================
    decode   a device  arrival of its bytes (stamp of the kernel), decoded
    hand on  a device  decoded, given to the filter process
    filter   filter    inertial data given to it, their solution is back
    publish  an output solution is back, handed to the output
    total    an output arrival of the inertial data, their solution is handed on
    ======== ========= ==========================================================
    """

    def __init__(self, stages: Stages) -> None:
        self._stages = stages
        self._under_way: deque[tuple[int, int, int]] = deque(maxlen=REMEMBERED)
        self._t_rx_ns: int | None = None
        self._back_ns = 0

    def decoded(self, device: str, t_rx_ns: int, now_ns: int) -> None:
        """Note that bytes which arrived at `t_rx_ns` are decoded."""
        self._stages.add("decode", device, now_ns - t_rx_ns)

    def handed_on(self, device: str, decoded_ns: int, now_ns: int) -> None:
        """Note that what was decoded at `decoded_ns` is given to the filter."""
        self._stages.add("hand on", device, now_ns - decoded_ns)

    def entered(self, t_ns: int, t_rx_ns: int, now_ns: int) -> None:
        """Note that samples up to `t_ns`, which arrived at `t_rx_ns`, are given to the filter."""
        self._under_way.append((t_ns, t_rx_ns, now_ns))

    def solved(self, t_ns: int, now_ns: int) -> None:
        """Note that the solution at a sample is back."""
        under_way = self._under_way
        while under_way and under_way[0][0] < t_ns:
            under_way.popleft()
        self._t_rx_ns, self._back_ns = None, now_ns
        if under_way:
            _, self._t_rx_ns, entered_ns = under_way[0]
            self._stages.add("filter", "filter", now_ns - entered_ns)

    def published(self, output: str, now_ns: int) -> None:
        """Note that the last solution is handed to an output."""
        self._stages.add("publish", output, now_ns - self._back_ns)
        if self._t_rx_ns is not None:
            self._stages.add("total", output, now_ns - self._t_rx_ns)


def _spread(counts: Counts, longest_ns: int) -> Spread:
    """Quantiles as the upper edges of their buckets, none above the longest."""
    upto = counts.cumsum()
    count = int(upto[-1])
    if count == 0:
        return Spread(0, None, None, None, None)
    ranks = [math.ceil(q * count) for q in QUANTILES]
    edges = [min(_upper_edge(int(b)), longest_ns) / 1e3 for b in np.searchsorted(upto, ranks)]
    p50, p99, p99_9 = edges
    return Spread(count, p50, p99, p99_9, longest_ns / 1e3)


def _upper_edge(bucket: int) -> int:
    octave = max(0, (bucket >> FINE_BITS) - 1)
    return (bucket - (octave << FINE_BITS) + 1) << octave
