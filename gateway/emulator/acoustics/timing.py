"""When an instrument speaks, and what its own clock shows."""

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.faults.clocks import ahead
from gateway.emulator.scenario import LblModel, Scenario, ToldTime, UsblModel
from gateway.emulator.streams import Draws

Array = NDArray[np.float64]


def shown(
    scenario: Scenario, name: str, clock: ToldTime, t: Array, start_unix_s: float
) -> list[float]:
    """What a device's clock shows at times (n,) s after the scenario's start, faults and all."""
    begun_s = start_unix_s if clock.since == "unix" else 0.0
    gained = clock.offset_s + 1e-6 * clock.drift_ppm * t + ahead(scenario, name, t)
    told = begun_s + t + gained
    whole: list[float] = (told if clock.wraps_s is None else told % clock.wraps_s).tolist()
    return whole


def latencies(draws: Draws, model: UsblModel | LblModel, n: int, error_s: float) -> Array:
    """From each of the next ``n`` moments of measurement to the first byte, (n,) s.

    Parameters
    ----------
    error_s
        True less stated latency.
    """
    jitter = draws("jitter").standard_exponential(n)
    late: Array = 1e-3 * (model.clock.latency_ms + model.jitter_ms * jitter) + error_s
    return np.maximum(late, 0.0)


def timeout_s(model: UsblModel | LblModel, sound_speed: float) -> float:
    """How long a reply is waited for."""
    return model.timeout_s or 2.0 * model.max_range_m / sound_speed
