"""What an inertial unit felt over a while: the mean force and turn in body axes."""

import math
from array import array

Vector = tuple[float, float, float]

_ROW = 8


class Felt:
    """Sums of increments since they were last looked at."""

    def __init__(self) -> None:
        self._begin()

    def add(self, rows: "array[float]") -> None:
        """Add samples: interval, angle and velocity increments (rad, m/s), missing time, each."""
        self._span_s += sum(rows[0::_ROW])
        for k in range(3):
            self._turned[k] += sum(rows[1 + k :: _ROW])
            self._gained[k] += sum(rows[4 + k :: _ROW])

    def look(self) -> tuple[Vector, float] | None:
        """Mean specific force (m/s², forward, starboard, down) and how fast it turned (rad/s).

        None if there were no samples since the last look.
        """
        span_s, turned, gained = self._span_s, self._turned, self._gained
        self._begin()
        if span_s <= 0.0:
            return None
        force = gained[0] / span_s, gained[1] / span_s, gained[2] / span_s
        return force, math.hypot(*turned) / span_s

    def _begin(self) -> None:
        self._span_s = 0.0
        self._turned = [0.0, 0.0, 0.0]
        self._gained = [0.0, 0.0, 0.0]
