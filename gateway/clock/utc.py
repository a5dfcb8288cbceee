"""Unix time of monotonic moments, from samples of the difference, the same live and in a replay.

The difference drifts as the host's clock is disciplined and leaps when it is set. It is sampled
about once a second; of a moment holds the last sample in force then, however late it is asked, so
that a recording of the samples gives every solution the stamp it had.
"""

from bisect import bisect_right

import msgspec

DELAY_NS = 100_000_000
"""A sample is in force from so long after it was taken: who reads samples and measurements in the
order in which they came knows it in time, though a measurement be stamped a little ahead."""
KEPT = 3600
"""Samples kept while they are taken: an hour."""


class UtcSample(msgspec.Struct, frozen=True, tag="utc"):
    """What Unix time minus monotonic time is (ns), from a monotonic moment on."""

    t_ns: int
    offset_ns: int


class UtcHistory:
    """The samples of one run. Without any, times are taken to be Unix times already."""

    def __init__(self) -> None:
        self._samples: list[UtcSample] = []
        self._asked_ns = 0

    def sample(self, now_ns: int, offset_ns: int) -> UtcSample:
        """Take a sample; it is in force only for moments that nobody has asked for yet."""
        taken = UtcSample(max(now_ns + DELAY_NS, self._asked_ns + 1), offset_ns)
        self.note(taken)
        if len(self._samples) >= 2 * KEPT:
            del self._samples[:KEPT]
        return taken

    def note(self, sample: UtcSample) -> None:
        """Note a sample of a recording; one that is noted already, or late, changes nothing."""
        if self._samples and sample.t_ns <= self._samples[-1].t_ns:
            return
        self._samples.append(sample)

    def at(self, t_ns: int) -> int:
        """Unix time minus monotonic time (ns) at a moment."""
        self._asked_ns = max(self._asked_ns, t_ns)
        if not self._samples:
            return 0
        k = bisect_right(self._samples, t_ns, key=lambda sample: sample.t_ns)
        return self._samples[max(k - 1, 0)].offset_ns
