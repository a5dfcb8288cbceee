"""From one timeline to another: moments of the past, until nothing can change them any more."""

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.order import Order, OrderCounts


@dataclass
class Note:
    """A moment at which another timeline can take over, given all that came after it.

    Attributes
    ----------
    count, t_ns
        Samples consumed, and the time of the last.
    began_ns
        Moment before the first sample of all.
    known
        Measurements that had come by then and may still come again or wait: time, key, itself.
    order
        The counts of then.
    told
        Verdicts given since on measurements that lie before it: their effect is in `state`, so
        that the other timeline takes them in silence.
    state
        The engine's, once nothing can change it; None before.
    past
        Track before ``t_ns`` as far as measurements after it asked for it.
    """

    count: int
    t_ns: int
    began_ns: int
    known: tuple[tuple[int, str, Any], ...]
    order: OrderCounts
    told: int = 0
    state: Any = None
    past: dict[int, NDArray[np.float64]] = field(default_factory=dict)


class Notes:
    """The notes of one timeline that are not settled yet, in the order of time."""

    def __init__(self) -> None:
        self._notes: list[Note] = []

    @property
    def oldest_ns(self) -> int | None:
        """Time of the first; None where there is none."""
        return self._notes[0].t_ns if self._notes else None

    def add(self, note: Note) -> None:
        """Take a note of the present."""
        self._notes.append(note)

    def next_after(self, count: int) -> int | None:
        """Count of the first note after a count."""
        if not self._notes or self._notes[-1].count <= count:
            return None
        return self._notes[bisect_right(self._notes, count, key=lambda note: note.count)].count

    def tell(self, t_ns: int) -> None:
        """Count the verdict on a measurement of this time, given now."""
        for note in self._notes:
            note.told += t_ns <= note.t_ns

    def conclude(self, count: int, state: Any) -> None:
        """Take the engine's state at a count as final."""
        for note in self._notes:
            if note.count == count:
                note.state = state

    def settled(self, final_ns: int, look_back_ns: int, order: Order) -> Note | None:
        """Take the newest note that is settled, and forget those before; None where there is none.

        Parameters
        ----------
        final_ns
            No measurement up to this time may still come, or be used again.
        look_back_ns
            How far a measurement may ask for the time before it.
        order
            The measurements, with what they asked for.
        """
        found = None
        while self._notes:
            note = self._notes[0]
            asked_until = note.t_ns + look_back_ns
            if note.state is None or final_ns < asked_until:
                break
            for entry in order:
                if note.t_ns < entry.t_ns <= asked_until:
                    note.past |= {t: row for t, row in entry.asked.items() if t < note.t_ns}
            found = self._notes.pop(0)
        return found
