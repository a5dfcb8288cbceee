"""Datagrams in: unicast, broadcast or a multicast group, stamped by the kernel."""

import asyncio
import errno
import socket
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import lru_cache
from ipaddress import ip_address
from typing import Any
from weakref import WeakKeyDictionary

from drivers.links.base import Chunk, Link, LinkCounts, LinkError, Take, reason
from drivers.links.stamps import ANCILLARY_BYTES, MonotonicStamps, dropped_so_far, request_stamps
from drivers.settings import UdpLink
from drivers.sources import source_filter

MAX_DATAGRAM = 65_535
RECEIVE_BUFFER = 4 * 1024 * 1024
DATAGRAMS_A_WAKEUP = 16
"""So that a flood on one socket leaves the rest of the loop its turn."""
REJOIN_S = 5.0


@asynccontextmanager
async def open_udp(settings: UdpLink, take: Take, counts: LinkCounts) -> AsyncIterator[Link]:
    """Listen on ``bind:port``; with ``group``, to that group on the interface of ``bind``.

    Links of one event loop share a port where each names its senders (``allow``).

    Raises
    ------
    LinkError
        Where the address cannot be bound or the group not joined.
    """
    link = Link(f"udp {settings.group or settings.bind}:{settings.port}", take, counts)
    try:
        admits = source_filter(settings.allow)
        listener = _listening(settings) or await _listen(settings)
    except (OSError, ValueError) as error:
        why = reason(error) if isinstance(error, OSError) else str(error)
        raise LinkError(f"{link.name}: {why}") from error
    listener.add(link, admits)
    try:
        yield link
    finally:
        listener.remove(link)


_Place = tuple[str, int, str | None]
_listeners: WeakKeyDictionary[asyncio.AbstractEventLoop, dict[_Place, "_Listener"]] = (
    WeakKeyDictionary()
)
"""Those that may be shared."""


def _place(settings: UdpLink) -> _Place:
    return settings.bind, settings.port, settings.group


def _listening(settings: UdpLink) -> "_Listener | None":
    """Who listens there already, for senders that it is told."""
    if not settings.allow:
        return None
    return _listeners.get(asyncio.get_running_loop(), {}).get(_place(settings))


async def _listen(settings: UdpLink) -> "_Listener":
    listener = _Listener(await _bound_socket(settings), settings)
    if settings.allow:
        _listeners.setdefault(asyncio.get_running_loop(), {})[_place(settings)] = listener
    return listener


class _Listener:
    """One socket and the links that take what comes, each of the senders it admits."""

    def __init__(self, sock: socket.socket, settings: UdpLink) -> None:
        self._socket = sock
        self._settings = settings
        self._loop = asyncio.get_running_loop()
        self._links: list[tuple[Link, Callable[[str | bytes], bool]]] = []
        self._stamps = MonotonicStamps()
        self._dropped = 0
        self._takers = lru_cache(maxsize=256)(self._admitting)
        self._loop.add_reader(sock, self._read)
        joining = self._stay_joined() if settings.group else None
        self._keeper = self._loop.create_task(joining) if joining else None

    def add(self, link: Link, admits: Callable[[str | bytes], bool]) -> None:
        """Have another link take its part."""
        self._links.append((link, admits))
        self._takers.cache_clear()

    def remove(self, link: Link) -> None:
        """Let a link go; with the last one, the socket."""
        self._links = [(other, admits) for other, admits in self._links if other is not link]
        self._takers.cache_clear()
        if not self._links:
            self._close()

    def _close(self) -> None:
        self._share_no_more()
        if self._keeper is not None:
            self._keeper.cancel()
        self._loop.remove_reader(self._socket)
        self._socket.close()

    def _admitting(self, address: tuple[Any, ...]) -> tuple[str, list[Link]]:
        """Name of a sender, and who listens to it."""
        host, port = address[:2]
        name = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        return name, [link for link, admits in self._links if admits(host)]

    def _read(self) -> None:
        for _ in range(DATAGRAMS_A_WAKEUP):
            try:
                data, ancillary, _flags, address = self._socket.recvmsg(
                    MAX_DATAGRAM, ANCILLARY_BYTES
                )
            except BlockingIOError:
                self._stamps.emptied()
                return
            except OSError as error:
                self._lose(error)
                return
            self._count_dropped(dropped_so_far(ancillary))
            source, takers = self._takers(address)
            if not takers:
                for link, _admits in self._links:
                    link.counts.refused += 1
                continue
            chunk = Chunk(data, self._stamps.of(ancillary), source)
            for link in takers:
                link.put(chunk)

    def _count_dropped(self, total: int | None) -> None:
        """Count what the kernel had no room for; whose it was nobody knows."""
        if total is not None and total != self._dropped:
            self._links[0][0].counts.kernel_dropped += (total - self._dropped) & 0xFFFF_FFFF
            self._dropped = total

    def _share_no_more(self) -> None:
        shared = _listeners.get(self._loop, {})
        if shared.get(_place(self._settings)) is self:
            del shared[_place(self._settings)]

    def _lose(self, error: OSError) -> None:
        self._share_no_more()
        self._loop.remove_reader(self._socket)
        for link, _admits in self._links:
            link.lose(reason(error))

    async def _stay_joined(self) -> None:
        """Join again now and then: an adapter that is pulled takes the membership along, unsaid."""
        while True:
            await asyncio.sleep(REJOIN_S)
            try:
                _join(self._socket, self._settings)
            except OSError as error:
                if error.errno != errno.EADDRINUSE:  # that is: joined as ever
                    self._lose(error)
                    return


async def _bound_socket(settings: UdpLink) -> socket.socket:
    loop = asyncio.get_running_loop()
    if settings.group and not ip_address(settings.group).is_multicast:
        raise ValueError("not a multicast group")
    where = settings.group or settings.bind
    infos = await loop.getaddrinfo(where, settings.port, type=socket.SOCK_DGRAM)
    family, kind, protocol, _canonical, address = infos[0]
    sock = socket.socket(family, kind, protocol)
    try:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        request_stamps(sock)
        if _is_shared(str(address[0])):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # Bound to the group, not to the wildcard, no other traffic of that port gets in.
        sock.bind(address)
        if settings.group:
            _join(sock, settings)
    except BaseException:
        sock.close()
        raise
    return sock


def _is_shared(host: str) -> bool:
    """Whether several programs may listen: not on a unicast address, where one steals from all."""
    address = ip_address(host)
    return address.is_multicast or address.is_unspecified or host.endswith(".255")


def _join(sock: socket.socket, settings: UdpLink) -> None:
    group, interface = ip_address(settings.group or ""), ip_address(settings.bind)
    if group.version == 4:
        local = interface.packed if interface.version == 4 else bytes(4)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group.packed + local)
    else:
        scope = getattr(group, "scope_id", None) or getattr(interface, "scope_id", None)
        index = socket.if_nametoindex(scope) if scope else 0
        request = group.packed + struct.pack("@I", index)
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, request)
