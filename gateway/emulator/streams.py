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
