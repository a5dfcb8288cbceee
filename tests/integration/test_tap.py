"""`usblnav decode --link`: a live line looked at, as a user does."""

import asyncio
import json
import os
import pty
import signal
import socket
import tty
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from drivers.links import open_link
from drivers.settings import SerialLink
from tests.gateway.command_line import FRAMES
from tests.integration.rig import USBLNAV
from tests.loopback import free_port
from tests.shared_data import ROOT

pytestmark = pytest.mark.live
FIX = b"1   87.3  15.2 34.9\r\n"


@asynccontextmanager
async def tapping(codec: str, link: str, *options: str | Path) -> AsyncIterator[Process]:
    """A tap that listens."""
    process = await started(codec, link, *options)
    try:
        assert process.stderr is not None
        said = await asyncio.wait_for(process.stderr.readline(), 30)
        assert said.endswith(b"; Ctrl-C ends\n"), said
        yield process
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def started(codec: str, link: str, *options: str | Path) -> Process:
    arguments = (*USBLNAV, "decode", "--codec", codec, "--link", link, *options)
    return await asyncio.create_subprocess_exec(
        *arguments, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, cwd=ROOT
    )


async def record(process: Process) -> dict[str, Any]:
    assert process.stdout is not None
    return json.loads(await asyncio.wait_for(process.stdout.readline(), 10))


async def interrupted(process: Process, code: int = 0) -> Sequence[str]:
    """What it says in the end."""
    process.send_signal(signal.SIGINT)
    _, said = await asyncio.wait_for(process.communicate(), 10)
    assert process.returncode == code, said
    assert b"Traceback" not in said
    return said.decode().splitlines()


async def test_two_senders_are_told_apart(tmp_path: Path) -> None:
    port, raw = free_port(socket.SOCK_DGRAM), tmp_path / "cable.bin"
    async with tapping("kvh1750", f"udp:127.0.0.1:{port}", "--raw", raw) as process:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
        ):
            pieces = [(one, FRAMES[0][:10]), (two, FRAMES[1][:20]), (one, FRAMES[0][10:])]
            pieces += [(two, FRAMES[1][20:]), (one, b"junk")]
            for sender, data in pieces:
                sender.sendto(data, ("127.0.0.1", port))
            names = [f"127.0.0.1:{sender.getsockname()[1]}" for sender in (one, two)]
            found = [await record(process) for _ in names]
        assert [(r["sequence"], r["source"]) for r in found] == [(0, names[0]), (1, names[1])]
        said = await interrupted(process)
    size = len(FRAMES[0])
    assert raw.read_bytes() == b"".join(data for _, data in pieces)
    assert said == [
        "2 imu, 1 rejected (unknown)",
        f"{2 * size + 4} bytes in 5 chunks",
        f"{names[1]}: {size} bytes, of which 0 rejected; 1 records",
        f"{names[0]}: {size + 4} bytes, of which 4 rejected; 1 records",
    ]


async def test_a_serial_line_until_it_is_pulled() -> None:
    far, near = pty.openpty()
    tty.setraw(far)
    name = os.ttyname(near)
    os.close(near)
    async with tapping("tracklink-lxt", f"serial:{name}:9600") as process:
        os.write(far, FIX)
        first = await record(process)
        assert (first["record"], "source" in first) == ("usbl", False)
        os.close(far)
        _, said = await asyncio.wait_for(process.communicate(), 10)
    assert process.returncode == 1
    assert said.decode().splitlines()[-1].startswith(f"usblnav: {name}: ")
    assert b"Traceback" not in said


async def test_a_line_that_is_held_says_by_whom() -> None:
    far, near = pty.openpty()
    name = os.ttyname(near)
    async with open_link(SerialLink(name), print):
        process = await started("tracklink-lxt", f"serial:{name}:9600")
        _, said = await asyncio.wait_for(process.communicate(), 30)
    os.close(far)
    os.close(near)
    assert process.returncode == 1
    last = said.decode().splitlines()[-1]
    assert last.startswith(f"usblnav: {name}: in use by another program (")
    assert last.endswith(
        f", process {os.getpid()}); a gateway that runs has its lines to itself: stop it first"
    )


async def test_a_reader_of_a_tap_may_leave(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        place = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        command = '"$@" | head -n 2; exit "${PIPESTATUS[0]}"'
        shell = await asyncio.create_subprocess_exec(
            *("bash", "-c", command, "bash", *USBLNAV),
            *("decode", "--codec", "tracklink-lxt", "--link", place),
            stdout=PIPE,
            stderr=PIPE,
            cwd=ROOT,
        )
        loop = asyncio.get_running_loop()
        client, _ = await asyncio.wait_for(loop.sock_accept(server), 30)
        with client:
            reading = asyncio.create_task(shell.communicate())
            while not reading.done():
                with suppress(OSError):  # it has left
                    await loop.sock_sendall(client, 100 * FIX)
                await asyncio.sleep(0.01)
            out, err = await reading
    assert shell.returncode == 0, err.decode()
    assert len(out.splitlines()) == 2
    assert b"Traceback" not in err
