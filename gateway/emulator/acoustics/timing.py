"""When an instrument speaks, and what its own clock shows."""

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.scenario import LblModel, ToldTime, UsblModel
from gateway.emulator.streams import generator

Array = NDArray[np.float64]


def shown(clock: ToldTime, t: float, start_unix_s: float) -> float:
    """What the clock shows at ``t`` (s after the scenario's start), s."""
    begun_s = start_unix_s if clock.since == "unix" else 0.0
    told_s = begun_s + clock.offset_s + t * (1.0 + 1e-6 * clock.drift_ppm)
    return told_s if clock.wraps_s is None else told_s % clock.wraps_s


def latencies(seed: int, name: str, model: UsblModel | LblModel, n: int, error_s: float) -> Array:
    """From each of ``n`` moments of measurement to the first byte, (n,) s.

    Parameters
    ----------
    error_s
        True less stated latency.
    """
    jitter = generator(seed, name, "jitter").standard_exponential(n)
    late: Array = 1e-3 * (model.clock.latency_ms + model.jitter_ms * jitter) + error_s
    return np.maximum(late, 0.0)
