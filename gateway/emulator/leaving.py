"""When what an instrument measured leaves it: after its latency and some jitter, in order."""

from collections.abc import Iterable

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from drivers.codec import Decoder
from gateway.emulator.streams import generator

Array = NDArray[np.float64]


class Leaving:
    """Delays of one instrument; remembers when its last frame left.

    Parameters
    ----------
    latency_ms
        From a measurement to the first byte of its frame.
    jitter_ms
        Mean of an exponential delay on top of it.
    """

    def __init__(self, latency_ms: float, jitter_ms: float, seed: int, name: str) -> None:
        self._latency_ms = latency_ms
        self._jitter_ms = jitter_ms
        self._rng = generator(seed, name, "jitter")
        self._left = 0.0

    def at(self, t: Array) -> Array:
        """When the first bytes of frames leave that hold for ``t``, both (n,) s."""
        delay = 1e-3 * (self._latency_ms + self._jitter_ms * self._rng.exponential(size=t.size))
        leaves = np.maximum.accumulate(np.maximum(t + delay, self._left))
        self._left = float(leaves[-1])
        return np.asarray(leaves)


def tells_age(decoder: Decoder, frames: Iterable[bytes]) -> bool:
    """Whether frames say themselves how long before them their measurement was."""
    records = (record for frame in frames for record in decoder.feed(frame, 0))
    return any(getattr(record, "age_s", UNSET) for record in records)
