"""All of the filter that time changes."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.state import State

Array = NDArray[np.float64]


@dataclass
class Memory:
    """All of the filter that time changes; a copy of it is a snapshot."""

    state: State
    used: int = 0
    gated: int = 0
    refused_in_a_row: int = 0
    """In a lock-out used fixes count it down before it is forgotten, see `gateway.fusion.doubt`."""
    t_used_ns: int | None = None
    velocity_refused: dict[str, tuple[int, float, int]] = field(default_factory=dict)
    """By device: since when its velocities are refused, and nothing locates; how far off the first
    was (m/s); how many were used in a row since."""
    quality: dict[str, tuple[int, float]] = field(default_factory=dict)
    """By beacon, see `gateway.fusion.robust`."""
    noise: dict[str, float] = field(default_factory=dict)
    """By device and row, see `gateway.fusion.robust`."""
    origin_e: Array | None = None
    """(3,) local origin of the invariant errors; None is where the filter starts."""
    aided: bool = False
    """Whether anything was used since the filter began, were it a depth."""

    def copy(self) -> Self:
        """Independent copy."""
        return replace(
            self,
            state=self.state.copy(),
            velocity_refused=self.velocity_refused.copy(),
            quality=self.quality.copy(),
            noise=self.noise.copy(),
        )
