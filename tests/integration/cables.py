"""Wires between emulator and gateway that a test holds in its hand: to pull, to cut, to garble."""

import asyncio
import os
import select
import socket
import struct
import tty
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol, Self


def free_port(kind: socket.SocketKind) -> int:
    """A port of loopback that nobody uses now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class End(Protocol):
    """The gateway's end of a cable."""

    link: dict[str, Any]

    def send(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class Cable:
    """Hands on every datagram of an emulated device, unless it is cut.

    The emulator sends to `port` and never knows; so the true motion goes on while a line is dead.
    """

    def __init__(self, end: End) -> None:
        self.end = end
        self.cut = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]
        asyncio.get_running_loop().add_reader(self._socket, self._carry)

    def _carry(self) -> None:
        with suppress(BlockingIOError):
            while True:
                data = self._socket.recv(65536)
                if not self.cut:
                    self.end.send(data)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()
        self.end.close()


class UdpEnd:
    """Datagrams to the port the gateway listens on."""

    def __init__(self, **settings: Any) -> None:
        self.port = free_port(socket.SOCK_DGRAM)
        self.link = {"type": "udp", "port": self.port, **settings}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, data: bytes) -> None:
        with suppress(OSError):  # nobody listens yet, or any more
            self._socket.sendto(data, ("127.0.0.1", self.port))

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

    def send(self, data: bytes) -> None:
        if self._near is None or any(event & select.POLLHUP for _, event in self._poll.poll(0)):
            return  # nobody has it open
        with suppress(BlockingIOError):
            os.write(self._near, data)

    def close(self) -> None:
        self.unplug()


class TcpEnd:
    """A terminal server: one client at a time, which it can throw out."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self.link = {"type": "tcp", "host": "127.0.0.1", "port": self._server.getsockname()[1]}
        self._client: socket.socket | None = None
        asyncio.get_running_loop().add_reader(self._server, self._accept)

    def _accept(self) -> None:
        self._client, _ = self._server.accept()
        self._client.setblocking(False)
        self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def reset(self) -> None:
        assert self._client is not None
        self._client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._client.close()
        self._client = None

    def send(self, data: bytes) -> None:
        if self._client is not None:
            with suppress(OSError):
                self._client.send(data)

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._server)
        self._server.close()
        if self._client is not None:
            self._client.close()
