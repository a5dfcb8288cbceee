"""Edges of a pulse per second from a file such as the kernel's, on the clocks of this machine."""

import asyncio
import re
import time
from pathlib import Path

import pytest

from drivers.hosttime import now_ns
from drivers.links.base import LinkError
from drivers.links.pps import edges

MS = 1_000_000


def write(file: Path, wall_ns: int, number: int) -> None:
    """As the kernel's attribute reads, whole at once."""
    seconds, nanoseconds = divmod(wall_ns, 1_000_000_000)
    whole = file.with_suffix(".new")
    whole.write_text(f"{seconds}.{nanoseconds:09d}#{number}\n")
    whole.rename(file)


async def test_each_edge_comes_once_at_its_monotonic_time(tmp_path: Path) -> None:
    file = tmp_path / "assert"
    write(file, 0, 0)
    found = edges(str(file))
    try:
        for number in (1, 2, 4):  # one was missed: that is no matter
            pending = asyncio.ensure_future(anext(found))
            await asyncio.sleep(0)  # it has read the file as it was
            before = now_ns()
            write(file, time.time_ns() - 30 * MS, number)
            after = now_ns()
            async with asyncio.timeout(5):
                t_ns = await pending
            assert before - MS <= t_ns + 30 * MS <= after + MS
    finally:
        await found.aclose()


@pytest.mark.parametrize("text", ["", "no pulse", "12.5#3", None])
async def test_what_tells_no_edge_is_a_lost_line(tmp_path: Path, text: str | None) -> None:
    file = tmp_path / "assert"
    if text is not None:
        file.write_text(text)
    why = "no such file or directory" if text is None else "tells no edge of a pulse"
    with pytest.raises(LinkError, match=f"^{re.escape(str(file))}: {why}$"):
        await anext(edges(str(file)))
