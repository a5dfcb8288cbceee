"""Receive stamps of the kernel, turned at once from wall time to CLOCK_MONOTONIC."""

import socket
import struct
import sys
import time
from collections.abc import Iterable

# Linux numbers; Python 3.11 has no names for them. The control messages carry the same numbers.
SO_TIMESTAMPNS = 35
SO_RXQ_OVFL = 40

_TIMESPEC = struct.Struct("@ll")
_UINT32 = struct.Struct("@I")

ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_UINT32.size)

_PLAUSIBLE_AGE_NS = 10_000_000_000
"""A stamp older than this, or of the future, means that wall time was stepped meanwhile."""

Ancillary = Iterable[tuple[int, int, bytes]]


def request_stamps(sock: socket.socket) -> None:
    """Ask the kernel to stamp what arrives and to count what it drops (Linux; else nothing)."""
    if sys.platform == "linux":
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        sock.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)


def receive_stamp(ancillary: Ancillary) -> int:
    """Monotonic receive time (ns) from the control messages of one `recvmsg`; without any, now."""
    now = time.monotonic_ns()
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            age = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
            return now - age if 0 <= age <= _PLAUSIBLE_AGE_NS else now
    return now


def dropped_so_far(ancillary: Ancillary) -> int | None:
    """Datagrams the kernel dropped on this socket (modulo 2**32); None where it says nothing."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_RXQ_OVFL and len(data) == _UINT32.size:
            count: int = _UINT32.unpack(data)[0]
            return count
    return None
