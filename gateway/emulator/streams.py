"""Bytes on their way: what leaves which device when, in order."""

import hashlib
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Emission:
    """Bytes to send at ``t`` (s after the scenario's start); ``last``: they complete a frame.

    Without bytes: what the instrument measured cannot be said in its format.
    """

    t: float
    device: str
    data: bytes
    last: bool = True


def generator(seed: int, *purpose: str) -> np.random.Generator:
    """A random stream of its own for each purpose, the same for the same seed."""
    digest = hashlib.sha256("/".join(purpose).encode()).digest()
    return np.random.default_rng([seed, int.from_bytes(digest[:8], "big")])
