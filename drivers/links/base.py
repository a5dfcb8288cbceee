"""What every link shares: stamped chunks, counts, and a bounded queue between line and reader."""

import asyncio
import os
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Self

QUEUE_BYTES = 4 * 1024 * 1024
"""What may wait for a slow reader: minutes of an instrument, yet little memory."""

CHUNK_OVERHEAD = 256
"""What a waiting chunk costs beside its bytes, so that many tiny ones are bounded too."""


class Chunk(NamedTuple):
    """Bytes as they arrived.

    Attributes
    ----------
    data
        One datagram, or whatever a stream had ready.
    t_rx_ns
        Receive stamp on the host's CLOCK_MONOTONIC (ns).
    source
        Who sent it: ``address:port`` or the device path.
    """

    data: bytes
    t_rx_ns: int
    source: str


class LinkError(OSError):
    """The line is gone or could not be opened: one line that names it and says why."""


@dataclass(slots=True)
class LinkCounts:
    """Running totals of one line; hand the same object to every reopening of it."""

    bytes: int = 0
    """Bytes that arrived, those dropped later included."""
    chunks: int = 0
    refused: int = 0
    """Datagrams from senders that the `allow` list does not name."""
    kernel_dropped: int = 0
    """Datagrams the kernel had no room for."""
    dropped_chunks: int = 0
    """Chunks, oldest first, that a slow reader let run over the queue's bound."""
    dropped_bytes: int = 0


class Link:
    """An open line: ``async for chunk in link``. What is queued still comes before `LinkError`.

    Parameters
    ----------
    name
        What its messages call it.
    counts
        Where it counts.
    limit
        Bound of the queue (bytes). Beyond it the oldest chunk goes: fresh data is worth more.
    """

    def __init__(self, name: str, counts: LinkCounts, limit: int = QUEUE_BYTES) -> None:
        self.name = name
        self.counts = counts
        self._limit = limit
        self._queue: deque[Chunk] = deque()
        self._queued = 0
        self._lost: LinkError | None = None
        self._wake = asyncio.Event()

    def put(self, chunk: Chunk) -> None:
        """Queue a chunk for the reader."""
        size = len(chunk.data)
        self.counts.chunks += 1
        self.counts.bytes += size
        self._queue.append(chunk)
        self._queued += size + CHUNK_OVERHEAD
        while self._queued > self._limit and len(self._queue) > 1:
            dropped = self._take()
            self.counts.dropped_chunks += 1
            self.counts.dropped_bytes += len(dropped.data)
        self._wake.set()

    def lose(self, why: str) -> None:
        """Say that nothing more will come; the reader learns it after what is queued."""
        self._lost = LinkError(f"{self.name}: {why}")
        self._wake.set()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Chunk:
        while not self._queue:
            if self._lost is not None:
                raise self._lost
            self._wake.clear()
            await self._wake.wait()
        return self._take()

    def _take(self) -> Chunk:
        chunk = self._queue.popleft()
        self._queued -= len(chunk.data) + CHUNK_OVERHEAD
        return chunk


def reason(error: OSError) -> str:
    """Say in a few lower-case words what the system complains of."""
    text = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
    return text[:1].lower() + text[1:]
