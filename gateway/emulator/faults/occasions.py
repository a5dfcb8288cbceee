"""When a fault comes: as the file says, or at random by the scenario's seed."""

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.scenario import Scenario
from gateway.emulator.streams import generator

Array = NDArray[np.float64]


def begins(scenario: Scenario, k: int) -> Array:
    """Times (n,) s at which fault `k` of a scenario comes, in order.

    Where it is ``per_hour`` they are a Poisson process, its place in the file part of the seed.
    """
    fault = scenario.faults[k]
    if fault.at_s is not None:
        return np.array([fault.at_s])
    rng = generator(scenario.seed, "faults", str(k), "times")
    expected = (fault.per_hour or 0.0) * scenario.duration_s / 3600.0
    return np.sort(rng.uniform(0.0, scenario.duration_s, rng.poisson(expected)))


class Occasions:
    """Whether a fault strikes, asked of frames in the order of their times."""

    def __init__(self, begins: Array, for_s: float) -> None:
        self._begins = begins.tolist()
        self._for_s = for_s
        self._until = -np.inf

    def strike(self, t: float) -> bool:
        """Whether a frame at ``t`` is struck."""
        came = False
        while self._begins and self._begins[0] <= t:
            self._until = self._begins.pop(0) + self._for_s
            came = True
        return t < self._until or (came and not self._for_s)

    @property
    def until(self) -> float:
        """When the last one that came is over."""
        return self._until
