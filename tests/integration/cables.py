"""Wires between emulator and gateway that a test holds in its hand: to pull, to cut, to garble."""

import asyncio
import os
import select
import socket
import struct
import tty
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from gateway.emulator.ports import open_port
from gateway.emulator.scenario import SerialPort
from tests.loopback import free_port


class End(Protocol):
    """The gateway's end of a cable, which is plugged in or not."""

    link: dict[str, Any]

    def plug(self) -> None: ...

    def unplug(self) -> None: ...

    def send(self, data: bytes) -> int:
        """Send what somebody takes; give how many bytes that was."""
        ...

    def close(self) -> None: ...


@dataclass(slots=True)
class Carried:
    """What became of the bytes of an emulated device.

    ``bytes`` = ``cut`` + ``untaken`` (nobody was at the other end) + those that arrived there.
    """

    frames: int = 0
    bytes: int = 0
    cut: int = 0
    untaken: int = 0

    @property
    def arrived(self) -> int:
        return self.bytes - self.cut - self.untaken


class Cable:
    """Hands on every datagram of an emulated device, unless it is cut.

    The emulator sends to `port` and never knows; so the true motion goes on while a line is dead.
    """

    def __init__(self, end: End) -> None:
        self.end = end
        self.cut = False
        self.counts = Carried()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]
        asyncio.get_running_loop().add_reader(self._socket, self._carry)

    def _carry(self) -> None:
        with suppress(BlockingIOError):
            while True:
                data = self._socket.recv(65536)
                self.counts.frames += 1
                self.counts.bytes += len(data)
                if self.cut:
                    self.counts.cut += len(data)
                else:
                    self.counts.untaken += len(data) - self.end.send(data)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()
        self.end.close()


class _Loose:
    """An end whose cable nobody's hand pulls: unplugged, it carries nothing."""

    _plugged = True

    def plug(self) -> None:
        self._plugged = True

    def unplug(self) -> None:
        self._plugged = False


class UdpEnd(_Loose):
    """Datagrams to the port the gateway listens on."""

    def __init__(self, **settings: Any) -> None:
        self.port = free_port(socket.SOCK_DGRAM)
        self.link = {"type": "udp", "port": self.port, **settings}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", self.port))

    def send(self, data: bytes) -> int:
        if not self._plugged:
            return 0
        with suppress(OSError):
            self._socket.send(data)
            # Loopback says at once that nobody listens (yet, or any more).
            refused = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            return 0 if refused else len(data)
        return 0

    def close(self) -> None:
        self._socket.close()


class PtyEnd:
    """A serial adapter: plugged in, its port is there; pulled out, the line hangs up."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.link = {"type": "serial", "port": str(path), "baud": 115200}
        self._near: int | None = None
        self._poll = select.poll()

    def plug(self) -> None:
        if self._near is not None:
            return
        self._near, far = os.openpty()
        os.set_blocking(self._near, False)
        tty.setraw(far)
        self.path.symlink_to(os.ttyname(far))
        os.close(far)
        self._poll.register(self._near, 0)

    def unplug(self) -> None:
        if self._near is not None:
            self.path.unlink()
            self._poll.unregister(self._near)
            os.close(self._near)
            self._near = None

    def send(self, data: bytes) -> int:
        if self._near is None or any(event & select.POLLHUP for _, event in self._poll.poll(0)):
            return 0  # nobody has it open
        with suppress(BlockingIOError):
            return os.write(self._near, data)
        return 0

    def close(self) -> None:
        self.unplug()


class TcpEnd:
    """A terminal server: one client at a time, which it can throw out."""

    def __init__(self) -> None:
        self.link: dict[str, Any] = {"type": "tcp", "host": "127.0.0.1"}
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None
        self.plug()

    def plug(self) -> None:
        if self._server is None:
            self._server = socket.create_server(("127.0.0.1", self.link.get("port", 0)))
            self._server.setblocking(False)
            self.link["port"] = self._server.getsockname()[1]
            asyncio.get_running_loop().add_reader(self._server, self._accept)

    def unplug(self) -> None:
        """Power off: no more answer at its port."""
        if self._server is not None:
            asyncio.get_running_loop().remove_reader(self._server)
            self._server.close()
            self._server = None
        if self._client is not None:
            self._client.close()
            self._client = None

    def _accept(self) -> None:
        assert self._server is not None
        if self._client is not None:
            self._client.close()
        self._client, _ = self._server.accept()
        self._client.setblocking(False)
        self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def reset(self) -> None:
        assert self._client is not None
        self._client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._client.close()
        self._client = None

    def send(self, data: bytes) -> int:
        if self._client is not None:
            with suppress(OSError):
                return self._client.send(data)
        return 0

    def close(self) -> None:
        self.unplug()


class SerialEnd(_Loose):
    """A real port that is wired to the gateway's, or is the same one with a loopback plug."""

    def __init__(self, near: str, far: str, baud: int) -> None:
        self.link = {"type": "serial", "port": far, "baud": baud}
        self._port = open_port(SerialPort(port=near, baud=baud))

    def send(self, data: bytes) -> int:
        if not self._plugged:
            return 0
        before = self._port.dropped_bytes
        self._port.send(data)
        return len(data) - (self._port.dropped_bytes - before)

    def close(self) -> None:
        self._port.close()


class PtyWire:
    """What stands for a serial cable: ptys whose bytes come out of one another.

    Parameters
    ----------
    ends
        Two for a cable between two ports, one for a port with a loopback plug.
    """

    def __init__(self, ends: int = 2) -> None:
        pairs = [os.openpty() for _ in range(ends)]
        self.ports = [os.ttyname(far) for _, far in pairs]
        self._ends = [end for pair in pairs for end in pair]
        near = [end for end, _ in pairs]
        loop = asyncio.get_running_loop()
        for here, there in zip(near, near[::-1], strict=True):
            os.set_blocking(here, False)
            loop.add_reader(here, self._carry, here, there)

    def _carry(self, here: int, there: int) -> None:
        with suppress(BlockingIOError):
            os.write(there, os.read(here, 65536))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for end in self._ends:
            asyncio.get_running_loop().remove_reader(end)
            os.close(end)
