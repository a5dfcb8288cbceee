"""Serial lines in and out: pyserial opens and configures, the event loop reads and writes."""

import asyncio
import errno
import fcntl
import os
import termios
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

from serial import Serial
from serial.rs485 import RS485Settings

from drivers.hosttime import now_ns
from drivers.links.base import Chunk, Link, LinkCounts, LinkError, Take, reason
from drivers.links.holder import holder, process_name
from drivers.settings import Rs485, SerialLink

READ_BYTES = 65_536
PSEUDO_TERMINALS = range(136, 144)
"""Major device numbers of the far ends of ptys on Linux."""

_PARITY = {"none": "N", "even": "E", "odd": "O", "mark": "M", "space": "S"}


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
        t_rx_ns = now_ns()
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
        self._second = settings.baud // settings.bits_per_byte
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
    """Open and set up a port for nobody else; raises `LinkError` with one line that says why not.

    A program that opens it nevertheless would take some of the bytes: the lock keeps out those that
    ask for one as well (pyserial, minicom), TIOCEXCL all but root's.
    """
    port = Serial(
        baudrate=settings.baud,
        bytesize=settings.data_bits,
        parity=_PARITY[settings.parity],
        stopbits=settings.stop_bits,
        rtscts=settings.flow == "rts_cts",
        xonxoff=settings.flow == "xon_xoff",
        timeout=0,
        write_timeout=0,
        exclusive=True,
    )
    port.port, port.dtr, port.rts = settings.port, settings.dtr, settings.rts
    try:
        port.open()
    except OSError as error:
        raise LinkError(f"{settings.port}: {_why_not(settings.port, error)}") from error
    except termios.error as error:
        raise LinkError(f"{settings.port}: not a serial line") from error
    except ValueError as error:
        raise LinkError(f"{settings.port}: cannot run at {settings.baud} baud") from error
    try:
        _set_up(port, settings)
    except BaseException:
        port.close()
        raise
    return port


def _set_up(port: Serial, settings: SerialLink) -> None:
    """What pyserial does not do, or not insist on, when it opens a port."""
    asked = termios.CS7 if settings.data_bits == 7 else termios.CS8
    asked |= termios.PARENB if settings.parity != "none" else 0
    if termios.tcgetattr(port.fileno())[2] & (termios.CSIZE | termios.PARENB) != asked:
        raise LinkError(
            f"{port.port}: does not take {settings.data_bits} data bits, parity {settings.parity}"
        )
    if not settings.dtr or not settings.rts:
        try:
            port.dtr, port.rts = settings.dtr, settings.rts
        except OSError as error:
            raise LinkError(f"{port.port}: has no lines DTR and RTS to be set") from error
    if settings.rs485 is not None:
        try:
            port.rs485_mode = _rs485(settings.rs485)
        except ValueError as error:
            raise LinkError(f"{port.port}: has no RS-485 mode") from error
    # The mark goes with the last close of a port, but with a pty only when both ends are closed,
    # and so would keep out the next run.
    if os.major(os.fstat(port.fileno()).st_rdev) not in PSEUDO_TERMINALS:
        fcntl.ioctl(port.fileno(), termios.TIOCEXCL)
    # A pty has no such mode (OSError), nor have some adapters (ValueError) and systems.
    with suppress(OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)


def _rs485(settings: Rs485) -> RS485Settings:
    return RS485Settings(
        rts_level_for_tx=settings.rts_on_send,
        rts_level_for_rx=not settings.rts_on_send,
        loopback=settings.hears_itself,
        delay_before_tx=settings.delay_before_ms / 1000,
        delay_before_rx=settings.delay_after_ms / 1000,
    )


def _why_not(port: str, error: OSError) -> str:
    """Say why a port does not open; of one that is held, by whom."""
    if error.errno not in (errno.EAGAIN, errno.EBUSY):
        return reason(error)
    pid = holder(port)
    return "in use by another program" + ("" if pid is None else f" ({process_name(pid)})")
