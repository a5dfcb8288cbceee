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

    Raises
    ------
    LinkError
        Where the address cannot be bound or the group not joined.
    """
    name = f"udp {settings.group or settings.bind}:{settings.port}"
    loop = asyncio.get_running_loop()
    try:
        admits = source_filter(settings.allow)
        sock = await _bound_socket(settings)
    except (OSError, ValueError) as error:
        why = reason(error) if isinstance(error, OSError) else str(error)
        raise LinkError(f"{name}: {why}") from error
    link = Link(name, take, counts)
    loop.add_reader(sock, _reader(sock, link, admits))
    keeper = loop.create_task(_stay_joined(sock, settings, link)) if settings.group else None
    try:
        yield link
    finally:
        if keeper is not None:
            keeper.cancel()
        loop.remove_reader(sock)
        sock.close()


def _reader(
    sock: socket.socket, link: Link, admits: Callable[[str | bytes], bool]
) -> Callable[[], None]:
    counts = link.counts
    stamps = MonotonicStamps()
    dropped = 0

    @lru_cache(maxsize=256)
    def sender(address: tuple[Any, ...]) -> str | None:
        host, port = address[:2]
        if not admits(host):
            return None
        return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

    def read() -> None:
        nonlocal dropped
        for _ in range(DATAGRAMS_A_WAKEUP):
            try:
                data, ancillary, _flags, address = sock.recvmsg(MAX_DATAGRAM, ANCILLARY_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                asyncio.get_running_loop().remove_reader(sock)
                link.lose(reason(error))
                return
            total = dropped_so_far(ancillary)
            if total is not None:
                counts.kernel_dropped += (total - dropped) & 0xFFFF_FFFF
                dropped = total
            source = sender(address)
            if source is None:
                counts.refused += 1
            else:
                link.put(Chunk(data, stamps.of(ancillary), source))

    return read


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


async def _stay_joined(sock: socket.socket, settings: UdpLink, link: Link) -> None:
    """Join again now and then: an adapter that was pulled takes the membership with it, unsaid."""
    while True:
        await asyncio.sleep(REJOIN_S)
        try:
            _join(sock, settings)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:  # that is: joined as ever
                asyncio.get_running_loop().remove_reader(sock)
                link.lose(reason(error))
                return
