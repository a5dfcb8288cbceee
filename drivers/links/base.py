"""What every link shares: stamped chunks, counts, and how its loss is learnt."""

import asyncio
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple


class Chunk(NamedTuple):
    """Bytes as they arrived.

    Attributes
    ----------
    data
        One datagram, or whatever a stream had ready.
    t_rx_ns
        Receive stamp, the host's own time (ns, see `drivers.hosttime`).
    source
        Who sent it: ``address:port`` or the device path.
    """

    data: bytes
    t_rx_ns: int
    source: str


Take = Callable[[Chunk], None]
"""Gets each chunk on the event loop, in the very callback that read it; it must not wait."""


class LinkError(OSError):
    """The line is gone or could not be opened: one line that names it and says why."""


@dataclass(slots=True)
class LinkCounts:
    """Running totals of one line; hand the same object to every reopening of it."""

    bytes: int = 0
    chunks: int = 0
    refused: int = 0
    """Datagrams from senders that the `allow` list does not name."""
    kernel_dropped: int = 0
    """Datagrams the kernel had no room for; of a shared port, counted at its first link."""


class Link:
    """An open line, which hands over what arrives until it is lost.

    Nothing is queued here: what the program is too slow for waits in the kernel, which counts what
    it drops.

    Parameters
    ----------
    name
        What its messages call it.
    take
        Gets the chunks.
    counts
        Where it counts.
    """

    def __init__(self, name: str, take: Take, counts: LinkCounts) -> None:
        self.name = name
        self.counts = counts
        self._take = take
        self._end: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def put(self, chunk: Chunk) -> None:
        """Hand over a chunk; what fails there is raised by `lost` and ends the line."""
        self.counts.chunks += 1
        self.counts.bytes += len(chunk.data)
        try:
            self._take(chunk)
        except Exception as error:
            self._fail(error)
            raise

    def lose(self, why: str) -> None:
        """Say that nothing more will come."""
        self._fail(LinkError(f"{self.name}: {why}"))

    async def lost(self) -> None:
        """Wait for the end of the line, which is an error.

        Raises
        ------
        LinkError
            When the line is lost.
        """
        await asyncio.shield(self._end)

    def _fail(self, error: Exception) -> None:
        if not self._end.done():
            self._end.set_exception(error)
            self._end.exception()  # whoever cares asks `lost`


def reason(error: OSError) -> str:
    """Say in a few lower-case words what the system complains of."""
    told = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
    text = told or str(error)
    return text[:1].lower() + text[1:]
