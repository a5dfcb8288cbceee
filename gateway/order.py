"""Measurements in the order of their times, whatever the order in which they came."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass
class Entry:
    """A measurement in its place: by time, then by `key`, so that ties do not depend on arrival.

    Attributes
    ----------
    reported
        Whether its verdict has been given.
    asked
        (12,) track by time in ns that its model asked for when it was last applied.
    """

    t_ns: int
    key: str
    measurement: Any
    reported: bool = False
    asked: dict[int, NDArray[np.float64]] = field(default_factory=dict)


class Refusal(StrEnum):
    """Why a measurement gets no place."""

    TOO_LATE = "too_late"
    """Older than the lag, or than the first sample."""
    TOO_EARLY = "too_early"
    """Further ahead of the samples than they may fall silent, or one of too many that wait."""
    DUPLICATE = "duplicate"


@dataclass
class OrderCounts:
    """Counts of what arrived out of order."""

    late: int = 0
    too_late: int = 0
    too_early: int = 0
    duplicate: int = 0

    def refuse(self, why: Refusal) -> Refusal:
        """Count a measurement that was not taken."""
        setattr(self, why, getattr(self, why) + 1)
        return why


class Order:
    """The measurements of a span of time, used or waiting."""

    def __init__(self) -> None:
        self._entries: list[Entry] = []

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, i: int) -> Entry:
        return self._entries[i]

    def __iter__(self) -> Iterator[Entry]:
        return iter(self._entries)

    def add(self, entry: Entry) -> bool:
        """Give an entry its place; say whether it is the first of its time and key."""
        at = bisect_left(self._entries, _identity(entry), key=_identity)
        if at < len(self._entries) and _identity(self._entries[at]) == _identity(entry):
            return False
        self._entries.insert(at, entry)
        return True

    def after(self, t_ns: int) -> int:
        """Index of the first entry after a time."""
        return bisect_right(self._entries, t_ns, key=_time)

    def forget(self, before: int) -> list[Entry]:
        """Take out the entries before an index."""
        forgotten = self._entries[:before]
        del self._entries[:before]
        return forgotten


def _identity(entry: Entry) -> tuple[int, str]:
    """What orders entries and tells duplicates."""
    return entry.t_ns, entry.key


def _time(entry: Entry) -> int:
    return entry.t_ns
