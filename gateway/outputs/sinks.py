"""Where bytes leave: UDP, TCP, serial lines, ptys, stdout; none of them may hold up the rest.

Every sink takes its data in `Sink.send`, which returns at once and never raises. What could not be
handed on is counted in its status; that a line is down, or back, is logged once.
"""

import asyncio
import logging
import os
import select
import socket
import stat
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import Any, Protocol

import msgspec

from drivers.links.base import LinkError, reason
from drivers.links.pty import PtyWriter
from drivers.links.serial import SerialWriter, open_serial_writer
from drivers.settings import OutputLink, PtyLink, SerialLink, TcpLink, UdpLink
from gateway.outputs.background import in_thread

log = logging.getLogger(__name__)

MAX_CLIENTS = 64
CLIENT_BUFFER_BYTES = 65_536
"""What may wait for one TCP client, here and as much in the kernel, before it is cut off."""
RETRY_S = (0.2, 0.5, 1.0, 2.0, 5.0)
"""Pauses between attempts to open; the last one repeats."""
PATIENCE_S = 1.0
"""How long a start waits for a first attempt, before it goes on without."""


class SinkStatus(msgspec.Struct, frozen=True):
    """How an output fares; totals count payloads, one for each `Sink.send`."""

    name: str
    up: bool
    sent: int
    dropped: int
    error: str = ""
    clients: int | None = None
    clients_cut_off: int | None = None
    clients_stalled: int | None = None


class Sink(Protocol):
    """Something that takes bytes."""

    name: str
    """Kind and place, as in the status."""
    ended: asyncio.Event
    """Set when nobody can ever read again: the reader of stdout is gone."""

    def send(self, data: bytes) -> None:
        """Hand on one payload, or count it as dropped; never blocks, never raises."""
        ...

    def status(self) -> SinkStatus:
        """Counts and health, now."""
        ...


@asynccontextmanager
async def open_sink(settings: OutputLink) -> AsyncIterator[Sink]:
    """Open the sink that a `link:` block describes, keep it open, and close it on leaving.

    What cannot be opened now (no such device, port in use, unknown host) is no error here: the sink
    counts what it drops and keeps trying. As a rule the first attempt is over when the body starts.
    """
    sink = _make(settings)
    keeper = asyncio.create_task(sink.keep_open(), name=sink.name)
    try:
        with suppress(TimeoutError):
            await asyncio.wait_for(sink.tried.wait(), PATIENCE_S)
        yield sink
    finally:
        keeper.cancel()
        await asyncio.wait([keeper])
        sink.close()
        await asyncio.sleep(0)  # an aborted connection closes its socket on the loop's next turn


class _Sink(ABC):
    """The counts, the health and the opening again that all sinks share."""

    def __init__(self, kind: str, place: str = "") -> None:
        self.name = f"{kind} {place}".rstrip()
        self._place = place
        self.ended = asyncio.Event()
        self.tried = asyncio.Event()
        self._lost = asyncio.Event()
        self._open = False
        self._sent = self._dropped = self._failures = 0
        self._error = ""
        self._slow = False

    @abstractmethod
    async def open(self) -> None:
        """Make the line ready for `write`; OSError when that cannot be done now."""

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Hand the payload to the operating system without waiting; OSError when it will not go."""

    @abstractmethod
    def close(self) -> None:
        """Give the line back; harmless when it is not open."""

    def send(self, data: bytes) -> None:
        if self._open:
            try:
                self.write(data)
            except BlockingIOError:
                self._note_slow()
            except OSError as error:
                self._note_down(error)
            else:
                self._sent += 1
                self._failures = 0
                self._note_up()
                return
        self._dropped += 1

    def status(self) -> SinkStatus:
        up = self._open and not self._error
        return SinkStatus(self.name, up, self._sent, self._dropped, self._error)

    async def keep_open(self) -> None:
        """Open, wait until the line is lost, and begin again after a pause."""
        while True:
            try:
                await self.open()
            except OSError as error:
                self._note_down(error)
            else:
                self._open = True
                self._note_up()
            self.tried.set()
            if self._open:
                await self._lost.wait()
                self._open = False
                self._lost.clear()
                self.close()
            await asyncio.sleep(RETRY_S[min(self._failures, len(RETRY_S) - 1)])
            self._failures += 1

    def _note_up(self) -> None:
        if self._error:
            log.info("output %s: back", self.name)
        self._error = ""

    def _note_down(self, error: OSError) -> None:
        why = reason(error).removeprefix(f"{self._place}: ")
        if not self._error:
            log.warning("output %s: %s; trying again", self.name, why)
        self._error = why

    def _note_slow(self) -> None:
        if not self._slow:
            log.warning("output %s: does not keep up, data is dropped and counted", self.name)
        self._slow = True


class _UdpSink(_Sink):
    """Datagrams to one host or broadcast address; an unreachable network is waited out."""

    def __init__(self, settings: UdpLink) -> None:
        super().__init__("udp", f"{settings.host}:{settings.port}")
        self._host, self._port = settings.host, settings.port
        self._socket: socket.socket | None = None
        self._address: tuple[Any, ...] = ()

    async def open(self) -> None:
        resolve = partial(socket.getaddrinfo, self._host, self._port, type=socket.SOCK_DGRAM)
        family, _, _, _, self._address = (await in_thread(resolve, OSError))[0]
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)

    def write(self, data: bytes) -> None:
        assert self._socket is not None
        self._socket.sendto(data, self._address)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class _Client(asyncio.Protocol):
    """One reader of the TCP server; what it sends (gpsd probes) is read and forgotten."""

    def __init__(self, server: "_TcpSink") -> None:
        self._server = server

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        # Left to itself the kernel keeps megabytes, hours of sentences, for a client gone deaf.
        line = transport.get_extra_info("socket")
        line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, CLIENT_BUFFER_BYTES)
        self._server.joined(self)

    def eof_received(self) -> bool:
        """Stay: a client that closes only its sending half still listens."""
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        self._server.left(self)


class _TcpSink(_Sink):
    """A server whose every client gets all data from the moment it joins, or is cut off."""

    def __init__(self, settings: TcpLink) -> None:
        super().__init__("tcp", f"{settings.bind}:{settings.port}")
        self._bind, self._port = settings.bind, settings.port
        self._server: asyncio.Server | None = None
        self._clients: set[_Client] = set()
        self._cut_off = 0
        self._said_full = False

    async def open(self) -> None:
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Client(self), self._bind, self._port)

    def write(self, data: bytes) -> None:
        for client in tuple(self._clients):
            if client.transport.get_write_buffer_size() + len(data) > CLIENT_BUFFER_BYTES:
                host, port = client.transport.get_extra_info("peername")[:2]
                said = "output %s: client %s port %d does not read, cut off"
                log.warning(said, self.name, host, port)
                self._cut(client)
            else:
                client.transport.write(data)

    def close(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        for client in tuple(self._clients):
            client.transport.abort()

    def status(self) -> SinkStatus:
        counts = {"clients": len(self._clients), "clients_cut_off": self._cut_off}
        return msgspec.structs.replace(super().status(), **counts)

    def joined(self, client: _Client) -> None:
        """Serve a new client, unless there are too many."""
        if len(self._clients) < MAX_CLIENTS:
            self._clients.add(client)
            return
        if not self._said_full:
            log.warning("output %s: %d clients; more are refused", self.name, MAX_CLIENTS)
        self._said_full = True
        self._cut(client)

    def left(self, client: _Client) -> None:
        """Forget a client."""
        if client in self._clients:
            self._clients.remove(client)
            self._said_full = False

    def _cut(self, client: _Client) -> None:
        self._cut_off += 1
        self.left(client)
        client.transport.abort()


class _SerialSink(_Sink):
    """A serial line; unplugged, it is opened again when it comes back."""

    def __init__(self, settings: SerialLink) -> None:
        super().__init__("serial", settings.port)
        self._settings = settings
        self._writer: SerialWriter | None = None

    async def open(self) -> None:
        self._writer = open_serial_writer(self._settings)

    def write(self, data: bytes) -> None:
        assert self._writer is not None
        try:
            if not self._writer.write(data):
                raise BlockingIOError
        except LinkError:
            self._lost.set()
            raise

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None


class _PtySink(_Sink):
    """A pseudo terminal: with nobody at its far end data go nowhere, as on a TCP port."""

    def __init__(self, settings: PtyLink) -> None:
        super().__init__("pty", settings.symlink)
        self._symlink = settings.symlink
        self._writer: PtyWriter | None = None

    async def open(self) -> None:
        self._writer = PtyWriter(self._symlink)

    def write(self, data: bytes) -> None:
        assert self._writer is not None
        if not self._writer.write(data):
            raise BlockingIOError

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def status(self) -> SinkStatus:
        clients = int(self._writer is not None and self._writer.has_reader)
        return msgspec.structs.replace(super().status(), clients=clients)


class _StdoutSink(_Sink):
    """Standard output as a pipe, file or terminal, left in blocking mode: others share it.

    A ready pipe takes ``PIPE_BUF`` bytes without waiting, so asking `poll` first is enough.
    """

    def __init__(self, fd: int = 1) -> None:
        super().__init__("stdout")
        self._fd = fd
        self._poll = select.poll()
        self._poll.register(fd, select.POLLOUT)
        self._watched = False

    async def open(self) -> None:
        if stat.S_ISFIFO(os.fstat(self._fd).st_mode):
            # The write end of a pipe becomes "readable" when its last reader leaves.
            asyncio.get_running_loop().add_reader(self._fd, self._end)
            self._watched = True

    def write(self, data: bytes) -> None:
        try:
            while data:
                if not self._poll.poll(0):
                    raise BlockingIOError
                data = data[os.write(self._fd, data[: select.PIPE_BUF]) :]
        except BrokenPipeError:
            self._end()
            raise

    def close(self) -> None:
        if self._watched:
            asyncio.get_running_loop().remove_reader(self._fd)
            self._watched = False

    def _end(self) -> None:
        self.close()
        self.ended.set()


def _make(settings: OutputLink) -> _Sink:
    match settings:
        case UdpLink():
            return _UdpSink(settings)
        case TcpLink():
            return _TcpSink(settings)
        case SerialLink():
            return _SerialSink(settings)
        case PtyLink():
            return _PtySink(settings)
        case _:
            return _StdoutSink()
