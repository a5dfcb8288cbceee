"""A page of memory that says what a worker is at, so that its host knows what it died of."""

import mmap
import os
from dataclasses import dataclass

_CELLS = 3
_BYTES = 8 * _CELLS
_IDLE = -1


@dataclass(frozen=True)
class At:
    """The inputs that a worker is working in.

    How many it had `taken` and answers `said` before, from its start on; and how many these are.
    """

    taken: int
    said: int
    count: int


class Progress:
    """One end of the page; the worker's is made of the file descriptor of the host's."""

    def __init__(self, fd: int) -> None:
        self._cells = memoryview(mmap.mmap(fd, _BYTES)).cast("q")

    def begin(self, taken: int, said: int, count: int) -> None:
        """Note the inputs that come next."""
        self._cells[2] = count
        self._cells[1] = said
        self._cells[0] = taken

    def idle(self) -> None:
        """Note that there is none."""
        self._cells[0] = _IDLE

    @property
    def at(self) -> At | None:
        """What the worker is, or was, at; None while it waits."""
        taken = self._cells[0]
        return None if taken == _IDLE else At(taken, self._cells[1], self._cells[2])


def shared() -> tuple[Progress, int]:
    """The host's end of a page, and a file descriptor to give to the worker and to close."""
    fd = os.memfd_create("usblnav-progress")
    os.ftruncate(fd, _BYTES)
    progress = Progress(fd)
    progress.idle()
    return progress, fd
