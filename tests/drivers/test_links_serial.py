"""Serial links on a real pty: data, hang-up, exclusive use, a full output line."""

import asyncio
import os
import pty
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest

from drivers.hosttime import now_ns
from drivers.links import Chunk, LinkCounts, LinkError, open_link
from drivers.links.holder import process_name
from drivers.links.serial import SerialWriter, open_serial_writer
from drivers.settings import Rs485, SerialLink
from gateway.supervise import Alive, Backoff, Notice, keep_running
from tests.drivers.hearing import hearing


class Cable:
    """A pty: ``far`` is the instrument's end, ``settings`` name the end the gateway opens."""

    def __init__(self) -> None:
        self.far, self._near = pty.openpty()
        tty.setraw(self.far)
        self.settings = SerialLink(port=os.ttyname(self._near), baud=115_200)
        os.close(self._near)

    def pull(self) -> None:
        with suppress(OSError):
            os.close(self.far)


@pytest.fixture
def cable() -> Iterator[Cable]:
    line = Cable()
    yield line
    line.pull()


async def test_bytes_are_stamped_as_they_are_read(cable: Cable) -> None:
    counts = LinkCounts()
    async with hearing(cable.settings, counts) as link:
        before = now_ns()
        os.write(cable.far, b"\x00\x11\x13\xff$GPGLL\r\n")
        async with asyncio.timeout(5):
            chunk = await anext(link)
        after = now_ns()
    assert chunk.data == b"\x00\x11\x13\xff$GPGLL\r\n"
    assert before <= chunk.t_rx_ns <= after
    assert chunk.source == cable.settings.port
    assert counts.bytes == 12


async def test_a_pulled_cable_is_a_loss_after_the_last_bytes(cable: Cable) -> None:
    async with hearing(cable.settings) as link:
        os.write(cable.far, b"last words")
        async with asyncio.timeout(5):
            assert (await anext(link)).data == b"last words"
            cable.pull()
            with pytest.raises(LinkError) as lost:
                await anext(link)
    line = str(lost.value)
    assert line.startswith(f"{cable.settings.port}: ")
    assert "\n" not in line


async def test_nobody_else_may_hold_the_port(cable: Cable) -> None:
    async with hearing(cable.settings):
        with pytest.raises(LinkError) as lost:
            async with hearing(cable.settings):
                pass
        with pytest.raises(LinkError):
            open_serial_writer(cable.settings)
    held = f"{cable.settings.port}: in use by another program"
    assert str(lost.value) == f"{held} ({process_name(os.getpid())})"
    async with hearing(cable.settings):
        pass


async def test_a_port_that_moves_under_its_stable_name_is_found_again(tmp_path: Path) -> None:
    """An adapter pulled and plugged in elsewhere: another device, the same link to it."""
    first, second = Cable(), Cable()
    name = tmp_path / "usb-FTDI_FT4ABCDE-if00-port0"
    name.symlink_to(first.settings.port)
    link = SerialLink(port=str(name), baud=115_200)
    news: asyncio.Queue[bytes | bool] = asyncio.Queue()

    async def read(alive: Alive) -> None:
        def take(chunk: Chunk) -> None:
            alive()
            news.put_nowait(chunk.data)

        async with open_link(link, take) as line:
            news.put_nowait(b"open")
            await line.lost()

    def report(notice: Notice) -> None:
        news.put_nowait(notice.up)

    backoff = Backoff(first_s=0.01, longest_s=0.02)
    reader = asyncio.create_task(keep_running("usbl0", read, report=report, backoff=backoff))
    async with asyncio.timeout(5):
        assert await news.get() == b"open"
        os.write(first.far, b"here")
        assert await news.get() == b"here"
        name.unlink()
        first.pull()
        assert await news.get() is False
        name.symlink_to(second.settings.port)
        assert await news.get() == b"open"
        os.write(second.far, b"there")
        assert await news.get() is True
        assert await news.get() == b"there"
    reader.cancel()
    second.pull()


def line_mode(port: str) -> tuple[bool, bool, bool]:
    """Two stop bits, RTS/CTS, XON/XOFF, as the kernel has them."""
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    mode = termios.tcgetattr(fd)
    os.close(fd)
    ixon = mode[0] & (termios.IXON | termios.IXOFF) == termios.IXON | termios.IXOFF
    return bool(mode[2] & termios.CSTOPB), bool(mode[2] & termios.CRTSCTS), ixon


@pytest.mark.parametrize(
    ("settings", "mode"),
    [
        ({}, (False, False, False)),
        ({"stop_bits": 2, "flow": "rts_cts"}, (True, True, False)),
        ({"flow": "xon_xoff"}, (False, False, True)),
    ],
)
async def test_the_line_is_set_up_as_asked(
    cable: Cable, settings: dict[str, Any], mode: tuple[bool, bool, bool]
) -> None:
    async with hearing(msgspec.structs.replace(cable.settings, **settings)):
        assert line_mode(cable.settings.port) == mode


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"parity": "even"}, "does not take 8 data bits, parity even"),
        ({"data_bits": 7}, "does not take 7 data bits, parity none"),
        ({"dtr": False}, "has no lines DTR and RTS to be set"),
        ({"rts": False}, "has no lines DTR and RTS to be set"),
        ({"rs485": Rs485()}, "has no RS-485 mode"),
    ],
)
async def test_what_a_port_cannot_do_is_one_clear_line(
    cable: Cable, settings: dict[str, Any], why: str
) -> None:
    with pytest.raises(LinkError) as lost:
        async with hearing(msgspec.structs.replace(cable.settings, **settings)):
            pass
    assert str(lost.value) == f"{cable.settings.port}: {why}"
    async with hearing(cable.settings):  # and it is let go of
        pass


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to open it as somebody else")
async def test_a_pty_is_not_left_closed_to_the_next_run(cable: Cable) -> None:
    async with hearing(cable.settings):
        pass
    code = """import os, sys
os.chmod(sys.argv[1], 0o666)
os.setuid(65534)
os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)"""
    opened = await asyncio.create_subprocess_exec(sys.executable, "-c", code, cable.settings.port)
    assert await opened.wait() == 0


async def test_an_absent_port_is_one_clear_line() -> None:
    with pytest.raises(LinkError) as lost:
        async with hearing(SerialLink(port="/dev/no-such-port")):
            pass
    assert str(lost.value) == "/dev/no-such-port: no such file or directory"


@pytest.mark.parametrize("path", [__file__, "/dev/null"])
async def test_what_is_no_serial_port_is_one_clear_line(path: str) -> None:
    with pytest.raises(LinkError) as lost:
        async with hearing(SerialLink(port=path)):
            pass
    assert str(lost.value).startswith(f"{path}: ")
    assert "\n" not in str(lost.value)


async def received(far: int, size: int) -> bytes:
    os.set_blocking(far, False)
    data = b""
    async with asyncio.timeout(5):
        while len(data) < size:
            with suppress(BlockingIOError):
                data += os.read(far, 65_536)
            await asyncio.sleep(0)
    return data


@pytest.fixture
async def writer(cable: Cable) -> Iterator[SerialWriter]:
    port = open_serial_writer(cable.settings)
    yield port
    port.close()


async def test_output_arrives(cable: Cable, writer: SerialWriter) -> None:
    assert writer.write(b"$GPGGA*00\r\n")
    assert await received(cable.far, 11) == b"$GPGGA*00\r\n"
    assert (writer.sent, writer.dropped) == (1, 0)


async def test_a_full_line_drops_whole_messages_and_counts_them(
    cable: Cable, writer: SerialWriter
) -> None:
    message = b"x" * 998 + b"\r\n"
    while writer.write(message):
        pass
    assert not writer.write(message)
    assert writer.dropped == 2
    sent = writer.sent
    data = await received(cable.far, sent * len(message))
    assert data == message * sent
    assert writer.write(b"again\r\n")
    assert await received(cable.far, 7) == b"again\r\n"


async def test_output_to_a_pulled_cable_is_a_loss(cable: Cable, writer: SerialWriter) -> None:
    cable.pull()
    with pytest.raises(LinkError, match=f"^{cable.settings.port}: "):
        writer.write(b"x")
