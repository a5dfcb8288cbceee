"""Sinks on serial lines, ptys and standard output: readers that come, go or do not read."""

import asyncio
import os
import pty
import subprocess
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from drivers.settings import PtyLink, SerialLink
from gateway.outputs.sinks import open_sink
from tests.gateway.test_outputs_sinks import EPOCH, LINE
from tests.loopback import until


async def test_serial_comes_back_after_it_was_unplugged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    port = tmp_path / "ttyUSB0"
    link = SerialLink(port=str(port), baud=38400)
    async with open_sink(link) as sink:
        sink.send(LINE)
        assert (sink.status().up, sink.status().dropped) == (False, 1)
        for _ in range(2):
            instrument, device = pty.openpty()
            tty.setraw(device)
            port.unlink(missing_ok=True)
            port.symlink_to(os.ttyname(device))
            os.close(device)
            await until(lambda: sink.status().up)
            sink.send(LINE)
            assert os.read(instrument, 4096) == LINE
            os.close(instrument)
            await until(lambda: (sink.send(LINE), not sink.status().up)[1])
    assert "ttyUSB0" in caplog.messages[0]
    assert caplog.messages[0].count("ttyUSB0") == 1


async def test_a_serial_line_that_is_too_slow_drops_whole_payloads() -> None:
    instrument, device = pty.openpty()
    tty.setraw(device)
    async with open_sink(SerialLink(port=os.ttyname(device), baud=4800)) as sink:
        for _ in range(5000):
            sink.send(LINE)
        status = sink.status()
    assert status.sent > 0
    assert status.dropped > 0
    assert status.sent + status.dropped == 5000
    os.close(instrument)
    os.close(device)


@contextmanager
def reading(port: Path) -> Iterator[int]:
    """A program that has a serial line open."""
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        yield fd
    finally:
        os.close(fd)


async def test_a_pty_gives_each_reader_what_is_said_while_it_reads(tmp_path: Path) -> None:
    port = tmp_path / "run" / "nmea"
    async with open_sink(PtyLink(symlink=str(port))) as sink:
        sink.send(LINE)
        assert (sink.status().clients, sink.status().dropped) == (0, 0)
        for n in range(2):
            with reading(port) as fd:
                sink.send(LINE)
                os.write(fd, b"?probe")
                sink.send(LINE * (n + 2))
                expected = LINE * (n + 3)
                data = b""
                while len(data) < len(expected):
                    data += os.read(fd, 4096)
                assert data == expected
                assert sink.status().clients == 1
                sink.send(EPOCH)
                termios.tcsetattr(fd, termios.TCSANOW, cooked(fd))  # as a terminal program may
            sink.send(EPOCH)
        assert (sink.status().sent, sink.status().dropped) == (9, 0)
    assert not port.is_symlink()


def cooked(fd: int) -> list[Any]:
    """Settings that echo, wait for lines and change their ends."""
    mode = termios.tcgetattr(fd)
    mode[0] |= termios.ICRNL
    mode[1] |= termios.OPOST | termios.ONLCR
    mode[3] |= termios.ICANON | termios.ECHO
    return mode


async def test_a_pty_that_is_not_read_drops_whole_payloads(tmp_path: Path) -> None:
    async with open_sink(PtyLink(symlink=str(tmp_path / "nmea"))) as sink:
        with reading(tmp_path / "nmea") as fd:
            for n in range(20_000):
                sink.send(b"%06d\n" % n)
            status = sink.status()
            assert 0 < status.sent < 20_000
            assert status.sent + status.dropped == 20_000
            said = [*range(status.sent), 20_000]
            data = b""
            while not data.endswith(b"020000\n"):
                data += os.read(fd, 65536)
                sink.send(b"020000\n")
    assert list(dict.fromkeys(map(int, data.split()))) == said


async def test_a_file_under_the_name_of_a_pty_is_left_alone(tmp_path: Path) -> None:
    port = tmp_path / "nmea"
    port.write_bytes(b"mine")
    async with open_sink(PtyLink(symlink=str(port))) as sink:
        assert sink.status().error == "file exists"
        assert port.read_bytes() == b"mine"
        port.unlink()
        port.symlink_to("/dev/pts/left-behind")
        await until(lambda: sink.status().up)
        assert port.is_char_device()


STDOUT = """
import asyncio, sys
from drivers.settings import StdioLink
from gateway.outputs.sinks import open_sink

async def main():
    async with open_sink(StdioLink()) as sink:
        n = 0
        while not sink.ended.is_set() and n < int(sys.argv[1]):
            sink.send(b"%06d\\n" % n)
            n += 1
            await asyncio.sleep(0.001)
        status = sink.status()
        print(status.sent, status.dropped, sink.ended.is_set(), file=sys.stderr)

asyncio.run(main())
"""


def stdout_program(count: int, **pipes: object) -> "subprocess.Popen[bytes]":
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", STDOUT, str(count)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, env=env, **pipes)


def test_stdout_goes_to_a_pipe_and_to_a_file(tmp_path: Path) -> None:
    expected = b"".join(b"%06d\n" % n for n in range(50))
    out, err = stdout_program(50, stdout=subprocess.PIPE).communicate(timeout=30)
    assert (out, err) == (expected, b"50 0 False\n")
    with (tmp_path / "out").open("wb") as file:
        stdout_program(50, stdout=file).communicate(timeout=30)
    assert (tmp_path / "out").read_bytes() == expected


def test_a_reader_of_stdout_that_leaves_ends_the_sink_politely() -> None:
    program = stdout_program(1_000_000, stdout=subprocess.PIPE)
    assert program.stdout is not None
    assert program.stdout.readline() == b"000000\n"
    program.stdout.close()
    assert program.stderr is not None
    with program.stderr as log:
        assert log.read().split()[-1] == b"True"
    assert program.wait(timeout=30) == 0


async def test_a_reader_of_stdout_that_leaves_is_noticed_without_a_send() -> None:
    """And one that does not read costs payloads, not time."""
    from gateway.outputs import sinks

    reading, writing = os.pipe()
    sink = sinks._StdoutSink(writing)
    await sink.open()
    sink._open = True
    for _ in range(5000):
        sink.send(LINE)
    assert 0 < sink.status().sent < 5000
    assert sink.status().sent + sink.status().dropped == 5000
    os.close(reading)
    await asyncio.wait_for(sink.ended.wait(), 5)
    sink.close()
    os.close(writing)
