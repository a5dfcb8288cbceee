"""The inputs kept for a worker: those that wait, and those it got since its last checkpoint."""

from collections import deque
from collections.abc import Callable
from itertools import islice


class Backlog:
    """Inputs in the order of sending, numbered from 0 as the worker's checkpoints count them.

    Parameters
    ----------
    limit
        Most that are kept. Beyond it go the oldest: first those already sent, which only the next
        worker would want, then those that wait.
    at_first
        Most that wait for the first worker, which may have to be compiled: of these none may be
        lost, for the configured state is that of the first.

    Attributes
    ----------
    dropped
        Inputs that no worker has worked in, or will.
    forgotten
        Inputs sent that a next worker would have needed, but which were too many to keep.
    """

    def __init__(self, limit: int, at_first: int = 0) -> None:
        self.dropped = 0
        self.forgotten = 0
        self._limit = limit
        self._most = max(limit, at_first)
        self._begun = False
        self._sent: deque[bytes] = deque()
        self._waiting: deque[bytes] = deque()
        self._first = 0  # number of the oldest kept
        self._covered = 0  # inputs that the last checkpoint includes

    @property
    def waiting(self) -> int:
        """How many wait to be sent."""
        return len(self._waiting)

    @property
    def kept(self) -> int:
        """How many were sent since the last checkpoint."""
        return len(self._sent)

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing between the last checkpoint and the oldest kept."""
        return self._first == self._covered

    def add(self, data: bytes) -> None:
        """Take an input."""
        self._waiting.append(data)
        kept = len(self._sent) + len(self._waiting)
        if self._begun and kept <= self._limit:
            self._most = self._limit  # what came at first is worked in
        if kept <= self._most:
            return
        if self._sent:
            self._sent.popleft()
            self._first += 1
            self.forgotten += 1
        else:
            self._waiting.popleft()
            self.dropped += 1

    def next(self, most: int, most_bytes: int) -> list[bytes]:
        """The inputs to send, one at least if any wait."""
        data: list[bytes] = []
        size = 0
        for waiting in islice(self._waiting, most):
            size += len(waiting)
            if data and size > most_bytes:
                break
            data.append(waiting)
        return data

    def sent(self, count: int) -> None:
        """Note that the next inputs were sent."""
        self._begun = True
        for _ in range(count):
            self._sent.append(self._waiting.popleft())

    def cover(self, received: int) -> None:
        """Forget what a checkpoint includes that has `received` so many inputs."""
        self._covered = max(received, self._covered)
        while self._sent and self._first < self._covered:
            self._sent.popleft()
            self._first += 1

    def again(self) -> None:
        """Let what was sent wait again, for a new worker that goes on from the checkpoint."""
        self._waiting.extendleft(reversed(self._sent))
        self._sent.clear()

    def drop(self, number: int) -> None:
        """Throw away one that waits."""
        del self._waiting[number - self._first]
        self.dropped += 1

    def anew(self, is_after: Callable[[bytes], bool], give_up: bool) -> None:
        """Number anew from a later state: of what was sent, what is after it waits again.

        With `give_up` it is thrown away instead, and counted.
        """
        after = [data for data in self._sent if is_after(data)]
        self._sent.clear()
        if give_up:
            self.dropped += len(after)
        else:
            self._waiting.extendleft(reversed(after))
        self._first = self._covered = 0
