"""The TCP client against a real server: data, end of file, reset, refusal, coming back."""

import asyncio
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.hosttime import now_ns
from drivers.links import Chunk, LinkCounts, LinkError
from drivers.links.tcp import open_tcp
from drivers.settings import TcpLink
from gateway.supervise import Alive, Backoff, Notice, keep_running
from tests.drivers.hearing import Heard, hearing
from tests.shared_data import ROOT

TCP_TABLE = Path("/proc/net/tcp")


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as sock:
        sock.setblocking(False)
        yield sock


def settings_of(server: socket.socket) -> TcpLink:
    return TcpLink(port=server.getsockname()[1])


async def accept(server: socket.socket) -> socket.socket:
    connection, _address = await asyncio.get_running_loop().sock_accept(server)
    return connection


def reset(connection: socket.socket) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    connection.close()


async def read_until_lost(link: Heard) -> tuple[bytes, str]:
    received = b""
    try:
        async with asyncio.timeout(5):
            async for chunk in link:
                received += chunk.data
    except LinkError as lost:
        return received, str(lost)
    raise AssertionError("the link ended without a loss")


async def test_bytes_then_end_of_file(server: socket.socket) -> None:
    settings = settings_of(server)
    counts = LinkCounts()
    async with hearing(settings, counts) as link:
        connection = await accept(server)
        connection.sendall(b"abc" * 1000)
        connection.close()
        received, line = await read_until_lost(link)
    assert received == b"abc" * 1000
    assert line == f"tcp 127.0.0.1:{settings.port}: closed by the peer"
    assert counts.bytes == 3000


async def test_a_reset_is_a_loss(server: socket.socket) -> None:
    settings = settings_of(server)
    async with hearing(settings) as link:
        reset(await accept(server))
        _, line = await read_until_lost(link)
    assert line == f"tcp 127.0.0.1:{settings.port}: connection reset by peer"


async def test_a_refusal_is_a_loss(server: socket.socket) -> None:
    settings = settings_of(server)
    server.close()
    with pytest.raises(LinkError, match=rf"^tcp 127\.0\.0\.1:{settings.port}: connection refused$"):
        async with hearing(settings):
            pass


async def test_a_silent_host_is_given_up(server: socket.socket) -> None:
    # A full backlog makes the kernel ignore further connection requests.
    server.listen(0)
    settings = settings_of(server)
    fillers = []
    try:
        with pytest.raises(LinkError, match=r"no answer in 0\.2 s"):
            for _ in range(20):
                opening = open_tcp(settings, print, LinkCounts(), connect_timeout_s=0.2)
                await opening.__aenter__()
                fillers.append(opening)
    finally:
        for opening in fillers:
            await opening.__aexit__(None, None, None)


def timer_of_connection_to(port: int) -> list[str]:
    """Kind of the running timer and its rest in 1/100 s, both hexadecimal."""
    lines = [line.split() for line in TCP_TABLE.read_text().splitlines()[1:]]
    return next(line[5].split(":") for line in lines if line[2].endswith(f":{port:04X}"))


@pytest.mark.skipif(not TCP_TABLE.exists(), reason="no /proc")
async def test_an_idle_line_is_kept_alive(server: socket.socket) -> None:
    settings = settings_of(server)
    async with hearing(settings):
        connection = await accept(server)
        timer, left = timer_of_connection_to(settings.port)
        connection.close()
    assert timer == "02"  # the keep-alive timer
    assert int(left, 16) <= 4 * 100


VANISHED = """
import asyncio, socket, subprocess, sys, time
from drivers.links import LinkCounts, LinkError, open_link
from drivers.settings import TcpLink

async def main():
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    server = socket.create_server(("127.0.0.1", 0))
    link = TcpLink(port=server.getsockname()[1], dead_after_s=int(sys.argv[1]))
    async with open_link(link, print) as line:
        subprocess.run(["ip", "addr", "flush", "dev", "lo"], check=True)
        begun = time.monotonic()
        try:
            await asyncio.wait_for(line.lost(), 30)
        except LinkError as lost:
            print(time.monotonic() - begun, lost)

asyncio.run(main())
"""


@pytest.mark.slow
@pytest.mark.parametrize("dead_after_s", [4, 10])
def test_a_server_that_vanishes_is_dead_in_the_stated_time(dead_after_s: int) -> None:
    """``pytest -m slow tests/drivers/test_links_tcp.py``: in a network that goes away."""
    done = subprocess.run(
        ["unshare", "-rn", sys.executable, "-c", VANISHED, str(dead_after_s)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    took_s, _, why = done.stdout.strip().partition(" ")
    assert dead_after_s - 1 < float(took_s) < dead_after_s + 2, done.stdout
    assert why.startswith("tcp 127.0.0.1:"), done.stdout


async def test_stamp_and_source(server: socket.socket) -> None:
    settings = settings_of(server)
    async with hearing(settings) as link:
        connection = await accept(server)
        before = now_ns()
        connection.sendall(b"x")
        chunk: Chunk = await anext(link)
        after = now_ns()
        connection.close()
    assert chunk.source == f"127.0.0.1:{settings.port}"
    assert before - 100_000 <= chunk.t_rx_ns <= after


async def test_supervised_it_comes_back_by_itself(server: socket.socket) -> None:
    settings = settings_of(server)
    counts = LinkCounts()
    received: list[bytes] = []
    notices: list[Notice] = []
    heard, enough = asyncio.Event(), asyncio.Event()

    async def read(alive: Alive) -> None:
        async with hearing(settings, counts) as link:
            async for chunk in link:
                alive()
                received.append(chunk.data)
                (heard if len(received) == 1 else enough).set()

    backoff = Backoff(first_s=0.01, longest_s=0.02)
    reader = asyncio.create_task(keep_running("imu0", read, report=notices.append, backoff=backoff))
    async with asyncio.timeout(5):
        first = await accept(server)
        first.sendall(b"before")
        await heard.wait()
        reset(first)
        second = await accept(server)
        second.sendall(b"after")
        await enough.wait()
    reader.cancel()
    second.close()
    assert received == [b"before", b"after"]
    assert [notice.up for notice in notices] == [False, True]
    assert counts.bytes == len(b"beforeafter")
