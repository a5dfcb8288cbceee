"""Serial links on a real pty: data, hang-up, exclusive use, a full output line."""

import asyncio
import os
import pty
import time
import tty
from collections.abc import Iterator
from contextlib import suppress

import pytest

from drivers.links import LinkCounts, LinkError
from drivers.links.serial import SerialWriter, open_serial_writer
from drivers.settings import SerialLink
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
        before = time.monotonic_ns()
        os.write(cable.far, b"\x00\x11\x13\xff$GPGLL\r\n")
        async with asyncio.timeout(5):
            chunk = await anext(link)
        after = time.monotonic_ns()
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
    assert str(lost.value) == f"{cable.settings.port}: in use by another program"
    async with hearing(cable.settings):
        pass


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
