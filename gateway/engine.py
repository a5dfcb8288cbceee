"""What a timeline drives, and what that may ask of the past."""

from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Verdict = TypeVar("Verdict", covariant=True)


class Track(Protocol):
    """What the engine may ask about the past."""

    def at(self, t_ns: int) -> Array:
        """Interpolated (12,) track at a time in the past."""
        ...


class Engine(Protocol[Verdict]):
    """What the timeline drives: the filter, or a test's own arithmetic."""

    def advance(self, rows: Array, track: Array) -> None:
        """Carry the state over whole samples (k, 8), writing the (k, 12) track after each."""
        ...

    def advance_part(self, row: Array, begin: float, end: float) -> None:
        """Carry the state over a share of one sample."""
        ...

    def mark(self, track: Array) -> None:
        """Write the (12,) track of the present state."""
        ...

    def apply(self, measurement: Any, track: Track) -> Verdict:
        """Use a measurement at its own time."""
        ...

    def save(self) -> Any:
        """Copy the state."""
        ...

    def restore(self, saved: Any) -> None:
        """Take a copied state as the present one."""
        ...
