"""Serial lines in and out: pyserial opens and configures, the event loop reads and writes."""

import asyncio
import errno
import os
import termios
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

from serial import Serial

from drivers.links.base import Chunk, Link, LinkCounts, LinkError, Take, reason
from drivers.settings import SerialLink

READ_BYTES = 65_536
BITS_A_BYTE = 10
"""Start, eight data bits, stop."""


@asynccontextmanager
async def open_serial(settings: SerialLink, take: Take, counts: LinkCounts) -> AsyncIterator[Link]:
    """Read a serial port, which nobody else may hold; each chunk is stamped as it is read.

    Raises
    ------
    LinkError
        Where the port is absent, held by another program or cannot be set to the line rate.
    """
    port = _open_port(settings)
    loop = asyncio.get_running_loop()
    link = Link(settings.port, take, counts)
    fd = port.fileno()
    loop.add_reader(fd, _reader(fd, link))
    try:
        yield link
    finally:
        loop.remove_reader(fd)
        port.close()


def _reader(fd: int, link: Link) -> Callable[[], None]:
    def read() -> None:
        t_rx_ns = time.monotonic_ns()
        try:
            data = os.read(fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            data, why = b"", reason(error)
        else:
            why = "hung up"
        if data:
            link.put(Chunk(data, t_rx_ns, link.name))
        else:
            asyncio.get_running_loop().remove_reader(fd)
            link.lose(why)

    return read


class SerialWriter:
    """A serial port to write to without ever waiting for it.

    Attributes
    ----------
    sent, dropped
        Messages handed to the line, and messages dropped because the line was full.
    """

    def __init__(self, settings: SerialLink) -> None:
        self.name = settings.port
        self.sent = 0
        self.dropped = 0
        self._port = _open_port(settings)
        self._second = settings.baud // BITS_A_BYTE
        self._rest = b""
        self._loop = asyncio.get_running_loop()

    def write(self, message: bytes) -> bool:
        """Send a whole message, or drop it when the line is more than a second behind.

        Returns
        -------
        bool
            Whether it was sent. A message once begun is ended: no half sentence leaves the port.

        Raises
        ------
        LinkError
            Where the port is gone.
        """
        try:
            if self._rest or self._port.out_waiting > self._second:
                self.dropped += 1
                return False
            self._rest = message
            self._push()
        except OSError as error:
            raise LinkError(f"{self.name}: {reason(error)}") from error
        self.sent += 1
        return True

    def close(self) -> None:
        """Let go of the port at once, with what it has not sent yet."""
        self._loop.remove_writer(self._port.fileno())
        with suppress(OSError, termios.error):
            # A UART's close waits up to 30 s for its output otherwise.
            self._port.reset_output_buffer()
        self._port.close()

    def _push(self) -> None:
        with suppress(BlockingIOError):
            self._rest = self._rest[os.write(self._port.fileno(), self._rest) :]
        if self._rest:
            self._loop.add_writer(self._port.fileno(), self._push_rest)

    def _push_rest(self) -> None:
        self._loop.remove_writer(self._port.fileno())
        with suppress(OSError):  # a lost line is said by the next write
            self._push()


def open_serial_writer(settings: SerialLink) -> SerialWriter:
    """Open a serial port for output; raises `LinkError` where that fails."""
    return SerialWriter(settings)


def _open_port(settings: SerialLink) -> Serial:
    try:
        port = Serial(settings.port, settings.baud, timeout=0, write_timeout=0, exclusive=True)
    except OSError as error:
        held = error.errno in (errno.EAGAIN, errno.EBUSY)
        why = "in use by another program" if held else reason(error)
        raise LinkError(f"{settings.port}: {why}") from error
    except termios.error as error:
        raise LinkError(f"{settings.port}: not a serial line") from error
    except ValueError as error:
        raise LinkError(f"{settings.port}: cannot run at {settings.baud} baud") from error
    # A pty has no such mode (OSError), nor have some adapters (ValueError) and systems.
    with suppress(OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)
    return port
