"""Draws of a mission: plain numbers that a person can read in its scenario."""

from typing import Any

from gateway.emulator.streams import generator

Data = dict[str, Any]


class Dice:
    """Draws of one mission."""

    def __init__(self, seed: int, number: int, *purpose: str) -> None:
        self._rng = generator(seed, "campaign", str(number), *purpose)

    def between(self, low: float, high: float) -> float:
        """A number, to three digits: a scenario is read by people."""
        return float(f"{self._rng.uniform(low, high):.3g}")

    def whole(self, low: int, high: int) -> int:
        """A whole number, both ends among them."""
        return int(self._rng.integers(low, high + 1))

    def one(self, *values: Any) -> Any:
        return values[self._rng.integers(len(values))]

    def chance(self, probability: float) -> bool:
        return bool(self._rng.random() < probability)
