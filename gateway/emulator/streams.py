"""Bytes on their way: what leaves which device when, in order."""

import hashlib
from dataclasses import dataclass
from typing import Literal

import numpy as np

Fate = Literal["whole", "damaged", "repeated", "junk", "dropped", "unplugged", "plugged"]
"""What became of a frame on its way to the port, if it is one; ``repeated`` came before. The last
three carry no bytes: a frame that was lost, a port that goes, one that is back."""


@dataclass(frozen=True, slots=True)
class Emission:
    """Bytes to send at ``t`` (s after the scenario's start); ``last``: they complete a frame.

    A ``whole`` one without bytes: what the instrument measured cannot be said in its format.
    """

    t: float
    device: str
    data: bytes
    last: bool = True
    fate: Fate = "whole"


def generator(seed: int, *purpose: str) -> np.random.Generator:
    """A random stream of its own for each purpose, the same for the same seed."""
    digest = hashlib.sha256("/".join(purpose).encode()).digest()
    return np.random.default_rng([seed, int.from_bytes(digest[:8], "big")])


class Draws:
    """Random streams of a device, one for each purpose, that go on from call to call."""

    def __init__(self, seed: int, name: str) -> None:
        self._seed, self._name = seed, name
        self._streams: dict[str, np.random.Generator] = {}

    def __call__(self, purpose: str) -> np.random.Generator:
        """Give the stream of a purpose, where the last call left it."""
        if purpose not in self._streams:
            self._streams[purpose] = generator(self._seed, self._name, purpose)
        return self._streams[purpose]
