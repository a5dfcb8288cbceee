"""Where emulated bytes leave: UDP, a TCP server, a pseudo terminal or a real serial port.

No write ever waits: like a real instrument, a port talks whether anybody listens or not, and counts
what nobody took.
"""

import errno
import os
import socket
import termios
import tty
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

from drivers.links.pty import Pty
from gateway.emulator.scenario import AnyPort, PtyPort, SerialPort, TcpServerPort, UdpPort
from gateway.emulator.streams import Emission
from gateway.errors import UsblnavError

_BITS_PER_BYTE = 10
_PIECE_S = 0.002
"""Bytes of a slow line come out in pieces of this length, as from a UART's buffer."""
_CLIENT_BUFFER_BYTES = 256 * 1024


class OutPort(Protocol):
    """An open port."""

    where: str
    dropped_bytes: int

    def send(self, data: bytes) -> None:
        """Send what can be sent at once, count the rest as dropped."""
        ...

    def close(self) -> None:
        """Give everything back."""
        ...


def open_port(port: AnyPort) -> OutPort:
    """Open a port.

    Raises
    ------
    UsblnavError
        If it cannot be opened.
    """
    try:
        match port:
            case UdpPort():
                return _Udp(port)
            case TcpServerPort():
                return _TcpServer(port)
            case PtyPort():
                return _Pty(port)
            case SerialPort():
                return _Serial(port)
    except (OSError, termios.error) as error:
        reason = error.strerror if isinstance(error, OSError) else error.args[-1]
        raise UsblnavError(f"{describe(port)}: {reason}") from error


def paced(stream: Iterable[Emission], port: AnyPort) -> Iterator[Emission]:
    """Spread bytes over the time a line of that rate needs for them.

    A pseudo terminal passes bytes on at once, so each piece comes when its last byte would have
    left a real line; a real serial port does that by itself, a packet keeps its time.
    """
    if not isinstance(port, PtyPort):
        yield from stream
        return
    byte_s = _BITS_PER_BYTE / port.baud
    size = max(1, int(_PIECE_S / byte_s))
    free = 0.0
    for emission in stream:
        free = max(free, emission.t)
        if not emission.data:
            yield replace(emission, t=free)
        for k in range(0, len(emission.data), size):
            piece = emission.data[k : k + size]
            free += len(piece) * byte_s
            last = k + size >= len(emission.data)
            yield replace(emission, t=free, data=piece, last=last)


class Plug:
    """A port whose cable can be pulled and put in again.

    Raises
    ------
    UsblnavError
        If it cannot be opened, also when it is put in again.
    """

    def __init__(self, port: AnyPort) -> None:
        self._block = port
        self._port: OutPort | None = open_port(port)
        self._dropped_before = 0
        self.where = self._port.where

    @property
    def dropped_bytes(self) -> int:
        """Bytes that nobody took."""
        return self._dropped_before + (self._port.dropped_bytes if self._port else 0)

    def send(self, data: bytes) -> None:
        """Send what can be sent at once, count the rest as dropped."""
        if self._port is None:
            self._dropped_before += len(data)
        else:
            self._port.send(data)

    def pull(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._dropped_before += self._port.dropped_bytes
            self._port.close()
            self._port = None

    def put_in(self) -> None:
        """Open it again."""
        if self._port is None:
            self._port = open_port(self._block)
            self.where = self._port.where


class _Udp:
    def __init__(self, port: UdpPort) -> None:
        self.where = describe(port)
        self.dropped_bytes = 0
        self._to = (socket.gethostbyname(port.host), port.port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.setblocking(False)

    def send(self, data: bytes) -> None:
        try:
            self._socket.sendto(data, self._to)
        except OSError:
            self.dropped_bytes += len(data)

    def close(self) -> None:
        self._socket.close()


class _TcpServer:
    def __init__(self, port: TcpServerPort) -> None:
        self.where = describe(port)
        self.dropped_bytes = 0
        self._clients: list[socket.socket] = []
        self._server = socket.create_server((port.bind, port.port))
        self._server.setblocking(False)

    def send(self, data: bytes) -> None:
        with suppress(BlockingIOError):
            while True:
                client, _ = self._server.accept()
                client.setblocking(False)
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _CLIENT_BUFFER_BYTES)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._clients.append(client)
        if not self._clients:
            self.dropped_bytes += len(data)
        self._clients = [client for client in self._clients if self._serve(client, data)]

    def _serve(self, client: socket.socket, data: bytes) -> bool:
        """Send to one client; one that is gone or does not read is let go."""
        try:
            sent = client.send(data)
        except OSError:
            sent = 0
        if sent == len(data):
            return True
        self.dropped_bytes += len(data) - sent
        client.close()
        return False

    def close(self) -> None:
        for client in self._clients:
            client.close()
        self._server.close()


class _Pty:
    """The near end of a pseudo terminal; the far end is found under the symlink."""

    def __init__(self, port: PtyPort) -> None:
        self.dropped_bytes = 0
        self._pty = Pty(port.symlink)
        self.where = f"{describe(port)} -> {self._pty.target}"

    def send(self, data: bytes) -> None:
        self.dropped_bytes += len(data) - self._pty.put(data)

    def close(self) -> None:
        self._pty.close()


class _Serial:
    def __init__(self, port: SerialPort) -> None:
        self.where = describe(port)
        self.dropped_bytes = 0
        speed = getattr(termios, f"B{port.baud}", None)
        if speed is None:
            raise OSError(errno.EINVAL, f"{port.baud} baud is not a rate this system knows")
        self._fd = os.open(port.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(self._fd)
            mode = termios.tcgetattr(self._fd)
            mode[4] = mode[5] = speed
            mode[2] |= termios.CLOCAL
            termios.tcsetattr(self._fd, termios.TCSANOW, mode)
        except termios.error:
            os.close(self._fd)
            raise

    def send(self, data: bytes) -> None:
        sent = 0
        with suppress(OSError):
            sent = os.write(self._fd, data)
        self.dropped_bytes += len(data) - sent

    def close(self) -> None:
        os.close(self._fd)


def describe(port: AnyPort) -> str:
    """One line for a person."""
    match port:
        case UdpPort():
            return f"udp {port.host}:{port.port}"
        case TcpServerPort():
            return f"tcp server {port.bind}:{port.port}"
        case PtyPort():
            return f"pty {port.symlink} ({port.baud} baud)"
        case SerialPort():
            return f"serial {port.port} ({port.baud} baud)"
