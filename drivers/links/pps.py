"""Edges of a pulse per second, as the Linux kernel's PPS device tells them.

The kernel stamps each edge in its interrupt, on DCD of a serial port (`ldattach PPS /dev/ttyS0`) or
on a pin, and writes it as ``1790000000.000012345#42`` (wall time and number) into
/sys/class/pps/pps0/assert. A file that only ever holds the last one can be asked in time, not
waited for.
"""

import asyncio
import re
from collections.abc import AsyncIterator
from pathlib import Path

from drivers.links.base import LinkError, reason
from drivers.links.stamps import MonotonicStamps

ASKED_EVERY_S = 0.1

_EDGE = re.compile(r"(\d+)\.(\d{9})#(\d+)\s*")


async def edges(file: str) -> AsyncIterator[int]:
    """Monotonic times (ns) of the edges from now on.

    Raises
    ------
    LinkError
        Where the file cannot be read, or says nothing of the kind.
    """
    stamps = MonotonicStamps()
    _, last = _newest(file)
    while True:
        await asyncio.sleep(ASKED_EVERY_S)
        stamp_ns, number = _newest(file)
        if number != last:
            last = number
            yield stamps.of_wall(stamp_ns)


def _newest(file: str) -> tuple[int, int]:
    """Wall time (Unix ns) and number of the last edge; sysfs reads do not block."""
    try:
        text = Path(file).read_text("ascii", errors="replace")
    except OSError as error:
        raise LinkError(f"{file}: {reason(error)}") from error
    match = _EDGE.fullmatch(text)
    if match is None:
        raise LinkError(f"{file}: tells no edge of a pulse")
    seconds, nanoseconds, number = map(int, match.groups())
    return seconds * 1_000_000_000 + nanoseconds, number
