"""Open lines: each hands over stamped chunks of bytes as they arrive."""

from contextlib import AbstractAsyncContextManager

from drivers.links.base import Chunk, Link, LinkCounts, LinkError, Take
from drivers.settings import Link as LinkSettings
from drivers.settings import SerialLink, UdpLink

__all__ = ["Chunk", "Link", "LinkCounts", "LinkError", "Take", "open_link"]


def open_link(
    settings: LinkSettings, take: Take, counts: LinkCounts | None = None
) -> AbstractAsyncContextManager[Link]:
    """Open what a `link:` block of the configuration describes, for reading.

    ``async with open_link(settings, take) as link: await link.lost()``

    Parameters
    ----------
    settings
        Serial line, UDP socket or TCP client.
    take
        Gets each chunk on the event loop, in the very callback that read it.
    counts
        Totals to go on from; pass the same object again after a loss.

    Raises
    ------
    LinkError
        On entering, where the line cannot be opened; from `Link.lost`, when it is lost.
    """
    counts = LinkCounts() if counts is None else counts
    # Imported on use: a capture is replayed without pyserial, and where there are no ttys.
    if isinstance(settings, SerialLink):
        from drivers.links.serial import open_serial

        return open_serial(settings, take, counts)
    if isinstance(settings, UdpLink):
        from drivers.links.udp import open_udp

        return open_udp(settings, take, counts)
    from drivers.links.tcp import open_tcp

    return open_tcp(settings, take, counts)
