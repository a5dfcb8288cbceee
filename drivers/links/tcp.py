"""A TCP client: bytes from an instrument that serves them."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from drivers.links.base import Chunk, Link, LinkCounts, LinkError, Take, reason
from drivers.links.stamps import ANCILLARY_BYTES, MonotonicStamps, request_stamps
from drivers.settings import TcpLink

CONNECT_TIMEOUT_S = 5.0
READ_BYTES = 65_536

PROBES = 3
"""A server that is heard of no more is asked so often before it is given up."""


@asynccontextmanager
async def open_tcp(
    settings: TcpLink,
    take: Take,
    counts: LinkCounts,
    connect_timeout_s: float = CONNECT_TIMEOUT_S,
) -> AsyncIterator[Link]:
    """Connect to ``host:port`` and read.

    Raises
    ------
    LinkError
        Where nobody answers in `connect_timeout_s`, or the peer refuses.
    """
    name = f"tcp {settings.host}:{settings.port}"
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(connect_timeout_s):
            sock = await _connected_socket(settings)
    except TimeoutError as error:
        raise LinkError(f"{name}: no answer in {connect_timeout_s:g} s") from error
    except OSError as error:
        raise LinkError(f"{name}: {reason(error)}") from error
    link = Link(name, take, counts)
    loop.add_reader(sock, _reader(sock, link, f"{settings.host}:{settings.port}"))
    try:
        yield link
    finally:
        loop.remove_reader(sock)
        sock.close()


def _reader(sock: socket.socket, link: Link, source: str) -> Callable[[], None]:
    stamps = MonotonicStamps()

    def read() -> None:
        try:
            data, ancillary, _flags, _address = sock.recvmsg(READ_BYTES, ANCILLARY_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            data, why = b"", reason(error)
        else:
            why = "closed by the peer"
        if data:
            link.put(Chunk(data, stamps.of(ancillary), source))
        else:
            asyncio.get_running_loop().remove_reader(sock)
            link.lose(why)

    return read


def _keep_alive(dead_after_s: int) -> dict[str, int]:
    """Options with which a peer that vanished without a word is noticed after so many seconds.

    Linux names; macOS lacks some. The last one does the same for bytes that it never acknowledges.
    """
    every_s = max(1, dead_after_s // (PROBES + 2))
    return {
        "TCP_KEEPIDLE": dead_after_s - PROBES * every_s,
        "TCP_KEEPINTVL": every_s,
        "TCP_KEEPCNT": PROBES,
        "TCP_USER_TIMEOUT": 1000 * dead_after_s,
        "TCP_NODELAY": 1,
    }


async def _connected_socket(settings: TcpLink) -> socket.socket:
    """Connect to the first address of the host that answers; else raise the last complaint."""
    loop = asyncio.get_running_loop()
    infos = await loop.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)
    refusal = OSError("no address")
    for family, kind, protocol, _canonical, address in infos:
        sock = socket.socket(family, kind, protocol)
        try:
            sock.setblocking(False)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in _keep_alive(settings.dead_after_s).items():
                if hasattr(socket, option):
                    sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
            request_stamps(sock)
            await loop.sock_connect(sock, address)
        except OSError as error:
            sock.close()
            refusal = error
        except BaseException:
            sock.close()
            raise
        else:
            return sock
    raise refusal
