"""Who is connected to an output that another library serves, and who of them has gone silent.

Zenoh drops what a subscriber does not take and tells nobody. Its connections say something every
2.5 s in either direction; so one from which nothing has come for longer is of a process that is
stopped or hangs, or of a machine that is gone. How long that is the kernel knows, asked for one
socket at a time. Source: sock_diag(7), ``struct tcp_info`` (Linux; elsewhere nobody is silent).
"""

import logging
import socket
import struct
from collections.abc import Iterable
from contextlib import suppress

SILENT_S = 6.0
"""Two signs of life that have not come."""

_HEADER = struct.Struct("=IHHII")
"""Length, type, flags, sequence, port of a netlink message."""
_REQUEST = struct.Struct("=BBBxI")
"""Family, protocol, extensions, states."""
_ANSWER_BYTES = 72
"""``struct inet_diag_msg``; attributes follow."""
_ATTRIBUTE = struct.Struct("=HH")
"""Length, type."""
_LAST_DATA_RECEIVED = struct.Struct("=52xI")
"""In ``struct tcp_info`` (ms ago)."""
_NETLINK_SOCK_DIAG = 4
_SOCK_DIAG_BY_FAMILY = 20
_INET_DIAG_INFO = 2
_NLM_F_REQUEST = 1
_ALL_STATES = 0xFFFF_FFFF
_ANY_INTERFACE = bytes(4)
_NO_COOKIE = b"\xff" * 8

log = logging.getLogger(__name__)


class Readers:
    """Keeps count of them, and says of each once that it does not read, or reads again.

    Parameters
    ----------
    name
        Of the output, for what is said.
    """

    def __init__(self, name: str, silent_s: float = SILENT_S) -> None:
        self._name, self._silent_s = name, silent_s
        self._connections: dict[tuple[str, str], bool] = {}
        self.given_up = 0
        """Those that were silent to the end of their connection."""

    @property
    def connected(self) -> int:
        """How many there are."""
        return len(self._connections)

    @property
    def stalled(self) -> int:
        """How many of them do not read."""
        return sum(self._connections.values())

    def look(self, connections: Iterable[tuple[str, str]]) -> None:
        """Look at all connections, each by both its ends (local, remote) as ``address:port``."""
        before, self._connections = self._connections, {}
        for ends in connections:
            was_silent = before.pop(ends, False)
            is_silent = self._connections[ends] = (silence_s(*ends) or 0.0) > self._silent_s
            if is_silent and not was_silent:
                what = "does not read; what it misses is lost"
                log.warning("output %s: %s %s", self._name, ends[1], what)
            elif was_silent and not is_silent:
                log.info("output %s: %s reads again", self._name, ends[1])
        for (_, remote), was_silent in before.items():
            if was_silent:
                self.given_up += 1
                log.warning("output %s: %s is given up", self._name, remote)


def silence_s(local: str, remote: str) -> float | None:
    """Seconds since the far end of a TCP connection of this machine last sent something.

    Parameters
    ----------
    local, remote
        Both ends as ``address:port``, IPv6 addresses in brackets.

    Returns
    -------
    None where the system does not know the connection, or does not say.
    """
    with suppress(OSError, ValueError, AttributeError):
        family, near, near_port = _end(local)
        _, far, far_port = _end(remote)
        wanted = 1 << _INET_DIAG_INFO - 1
        request = _REQUEST.pack(family, socket.IPPROTO_TCP, wanted, _ALL_STATES)
        request += near_port + far_port + near + far + _ANY_INTERFACE + _NO_COOKIE
        length = _HEADER.size + len(request)
        header = _HEADER.pack(length, _SOCK_DIAG_BY_FAMILY, _NLM_F_REQUEST, 0, 0)
        with socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM, _NETLINK_SOCK_DIAG) as kernel:
            kernel.setblocking(False)
            kernel.send(header + request)
            return _last_data_s(kernel.recv(4096))
    return None


def _last_data_s(answer: bytes) -> float | None:
    """The one number, if the answer is one and holds it."""
    if _HEADER.unpack_from(answer)[1] != _SOCK_DIAG_BY_FAMILY:
        return None
    at = _HEADER.size + _ANSWER_BYTES
    while at + _ATTRIBUTE.size <= len(answer):
        length, kind = _ATTRIBUTE.unpack_from(answer, at)
        if kind == _INET_DIAG_INFO and length >= _ATTRIBUTE.size + _LAST_DATA_RECEIVED.size:
            milliseconds: int = _LAST_DATA_RECEIVED.unpack_from(answer, at + _ATTRIBUTE.size)[0]
            return milliseconds * 1e-3
        at += max(_ATTRIBUTE.size, -(-length // 4) * 4)
    return None


def _end(place: str) -> tuple[int, bytes, bytes]:
    """Family, address in 16 bytes and port in 2."""
    address, _, port = place.rpartition(":")
    family = socket.AF_INET6 if address.startswith("[") else socket.AF_INET
    packed = socket.inet_pton(family, address.strip("[]"))
    return family, packed.ljust(16, b"\0"), int(port).to_bytes(2, "big")
