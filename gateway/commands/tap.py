"""A live line listened to until the user has seen enough."""

import asyncio
import signal
from collections.abc import Callable

from drivers.links import Chunk, LinkCounts, LinkError, open_link
from drivers.settings import Link
from gateway.errors import UsblnavError

Say = Callable[[str], None]


def listen(settings: Link, take: Callable[[Chunk], None], say: Say) -> LinkCounts:
    """Hand over what comes on a line, until SIGINT or SIGTERM.

    Parameters
    ----------
    take
        Gets each chunk. An OSError or UsblnavError of it ends the listening and is raised here.
    say
        Told once that the line is open.

    Raises
    ------
    UsblnavError
        Where the line cannot be opened, or is lost.
    """
    return asyncio.run(_listen(settings, take, say))


async def _listen(settings: Link, take: Callable[[Chunk], None], say: Say) -> LinkCounts:
    loop, stop = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    counts = LinkCounts()
    failure: list[OSError | UsblnavError] = []

    def guarded(chunk: Chunk) -> None:
        if failure:
            return
        try:
            take(chunk)
        except (OSError, UsblnavError) as error:
            failure.append(error)
            stop.set()

    try:
        async with open_link(settings, guarded, counts) as link:
            say(f"listening on {link.name}; Ctrl-C ends")
            ends = [asyncio.ensure_future(stop.wait()), asyncio.ensure_future(link.lost())]
            done, _ = await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            for end in ends:
                end.cancel()
            if ends[1] in done:
                ends[1].result()
    except LinkError as error:
        raise UsblnavError(f"{error}{_whose(error)}") from error
    if failure:
        raise failure[0]
    return counts


def _whose(error: LinkError) -> str:
    """Who usually has a line that is taken."""
    taken = "already in use" in str(error) or "in use by another" in str(error)
    return "; a gateway that runs has its lines to itself: stop it first" if taken else ""
