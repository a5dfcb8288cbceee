"""Sinks on real sockets: nobody who does not listen holds up the rest."""

import asyncio
import os
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path

import pytest

from drivers.settings import TcpLink, UdpLink
from gateway.outputs.sinks import CLIENT_BUFFER_BYTES, MAX_CLIENTS, Sink, open_sink
from tests.loopback import free_port, until

LINE = b"$GPZDA,120000.00,15,11,2023,00,00*64\r\n"
EPOCH = LINE * 8


@asynccontextmanager
async def joined(
    port: int,
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """A client of a TCP sink."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        yield reader, writer
    finally:
        writer.close()
        with suppress(OSError):
            await writer.wait_closed()


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
        here.bind(("127.0.0.1", 0))
        here.settimeout(5)
        yield here


async def test_udp_delivers_each_payload_as_a_datagram(receiver: socket.socket) -> None:
    port = receiver.getsockname()[1]
    async with open_sink(UdpLink(port=port)) as sink:
        sink.send(LINE)
        sink.send(LINE * 2)
        assert (receiver.recv(4096), receiver.recv(4096)) == (LINE, LINE * 2)
        status = sink.status()
    assert (status.name, status.up, status.sent, status.dropped) == (
        f"udp 127.0.0.1:{port}",
        True,
        2,
        0,
    )


async def test_udp_broadcasts() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
        here.bind(("127.255.255.255", 0))
        here.settimeout(5)
        async with open_sink(UdpLink(host="127.255.255.255", port=here.getsockname()[1])) as sink:
            sink.send(LINE)
            assert here.recv(4096) == LINE


async def test_udp_to_nobody_is_no_error() -> None:
    async with open_sink(UdpLink(port=free_port(socket.SOCK_DGRAM))) as sink:
        for _ in range(10):
            sink.send(LINE)
        assert (sink.status().sent, sink.status().up) == (10, True)


def test_an_unreachable_network_is_counted_and_comes_back(tmp_path: Path) -> None:
    """In a network namespace of its own, whose loopback is down at first."""
    script = tmp_path / "unreachable.py"
    script.write_text(UNREACHABLE)
    done = subprocess.run(
        ["unshare", "--user", "--map-root-user", "--net", sys.executable, str(script)],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    if "unshare" in done.stderr and "failed" in done.stderr:
        pytest.skip("no network namespaces here")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("network is unreachable; trying again") == 1
    assert done.stderr.count("back") == 1


UNREACHABLE = """
import asyncio, fcntl, logging, socket, struct
from drivers.settings import UdpLink
from gateway.outputs.sinks import open_sink

def loopback_up():
    up = struct.pack("16sh14x", b"lo", 0x1 | 0x40)  # IFF_UP, IFF_RUNNING
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        fcntl.ioctl(s, 0x8914, up)  # SIOCSIFFLAGS

async def main():
    async with open_sink(UdpLink(port=10110)) as sink:
        for _ in range(3):
            sink.send(b"lost")
        down = sink.status()
        assert (down.up, down.sent, down.dropped) == (False, 0, 3), down
        assert down.error == "network is unreachable", down
        loopback_up()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
            here.bind(("127.0.0.1", 10110))
            here.settimeout(5)
            sink.send(b"again")
            assert here.recv(100) == b"again"
        assert (sink.status().up, sink.status().sent) == (True, 1)

logging.basicConfig(level=logging.INFO)
asyncio.run(main())
"""


async def test_an_unknown_host_is_said_once_and_tried_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with open_sink(UdpLink(host="no-such-host.invalid", port=10110)) as sink:
        sink.send(LINE)
        assert (sink.status().up, sink.status().dropped) == (False, 1)
        await until(lambda: sink._failures >= 2)
    assert len(caplog.records) == 1
    assert "no-such-host.invalid" in caplog.text


async def read_epochs(port: int, count: int) -> bytes:
    async with joined(port) as (reader, writer):
        writer.write(b"?WATCH={}\r\n")  # as gpsd probes: read and forgotten
        return await reader.readexactly(count * len(EPOCH))


async def test_every_tcp_client_gets_everything_and_the_deaf_one_is_cut_off(
    caplog: pytest.LogCaptureFixture,
) -> None:
    port, clients, count = free_port(), 20, 4_000
    with socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        async with open_sink(TcpLink(port=port)) as sink:
            deaf.connect(("127.0.0.1", port))
            readers = [asyncio.create_task(read_epochs(port, count)) for _ in range(clients)]
            await until(lambda: sink.status().clients == clients + 1)
            slowest = await feed(sink, count)
            for data in await asyncio.gather(*readers):
                assert data == EPOCH * count
            status = sink.status()
    assert (status.clients_cut_off, status.sent, status.dropped) == (1, count, 0)
    assert slowest < 0.05
    assert [r for r in caplog.messages if "does not read" in r]


async def feed(sink: Sink, count: int) -> float:
    """Send `count` epochs, at the readers' pace; the longest a single send took (s)."""
    loop, slowest, block = asyncio.get_running_loop(), 0.0, 20
    for start in range(0, count, block):
        for _ in range(min(block, count - start)):
            before = loop.time()
            sink.send(EPOCH)
            slowest = max(slowest, loop.time() - before)
        await asyncio.sleep(0)
    return slowest


async def test_what_waits_for_a_deaf_client_is_bounded() -> None:
    port = free_port()
    with socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        async with open_sink(TcpLink(port=port)) as sink:
            deaf.connect(("127.0.0.1", port))
            await until(lambda: sink.status().clients == 1)
            payload = bytes(CLIENT_BUFFER_BYTES // 4)
            sent = 0
            while sink.status().clients:
                sink.send(payload)
                sent += len(payload)
                assert sent < 1024 * 1024
                await asyncio.sleep(0)
            assert sink.status().clients_cut_off == 1


async def test_a_client_that_only_listens_stays() -> None:
    port = free_port()
    async with open_sink(TcpLink(port=port)) as sink, joined(port) as (reader, writer):
        writer.write_eof()  # like `nc host port </dev/null`
        await until(lambda: sink.status().clients == 1)
        sink.send(LINE)
        assert await reader.readexactly(len(LINE)) == LINE


async def test_a_client_that_leaves_is_forgotten() -> None:
    port = free_port()
    async with open_sink(TcpLink(port=port)) as sink:
        async with joined(port):
            await until(lambda: sink.status().clients == 1)
        await until(lambda: (sink.send(LINE), sink.status().clients == 0)[1])
        assert (sink.status().clients_cut_off, sink.status().up) == (0, True)


async def test_clients_too_many_are_turned_away_and_that_is_said_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    port = free_port()
    async with open_sink(TcpLink(port=port)) as sink, AsyncExitStack() as clients:
        for _ in range(MAX_CLIENTS - 1):
            await clients.enter_async_context(joined(port))
        for times in (1, 2):  # the last one leaves, and one comes in its place
            async with joined(port):
                await until(lambda: sink.status().clients == MAX_CLIENTS)
                for _ in range(5):
                    reader, _ = await clients.enter_async_context(joined(port))
                    assert await reader.read() == b""
                assert sink.status().clients_cut_off == 5 * times
                full = f"output tcp 127.0.0.1:{port}: {MAX_CLIENTS} clients; more are refused"
                assert caplog.messages == [full] * times
            while sink.status().clients == MAX_CLIENTS:  # a leave shows when it is spoken to
                sink.send(LINE)
                await asyncio.sleep(0.001)


async def test_a_port_in_use_is_taken_once_it_is_free(caplog: pytest.LogCaptureFixture) -> None:
    port = free_port()
    with socket.create_server(("127.0.0.1", port)) as other:
        async with open_sink(TcpLink(port=port)) as sink:
            sink.send(LINE)
            assert (sink.status().up, sink.status().dropped) == (False, 1)
            assert sink.status().error == "address already in use"
            other.close()
            await until(lambda: sink.status().up)
            data = asyncio.create_task(read_epochs(port, 1))
            await until(lambda: sink.status().clients == 1)
            sink.send(EPOCH)
            assert await data == EPOCH
    assert len([r for r in caplog.messages if "in use" in r]) == 1


async def test_closing_leaves_no_stuck_port() -> None:
    port = free_port()
    for _ in range(2):
        async with open_sink(TcpLink(port=port)) as sink, joined(port) as (reader, _):
            assert sink.status().up
            await until(lambda sink=sink: sink.status().clients == 1)
        with suppress(ConnectionResetError):
            assert await reader.read() == b""
