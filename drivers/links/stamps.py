"""Receive stamps of the kernel, turned from wall time to the host's own, whatever steps the former.

The kernel stamps by the wall clock, which NTP or a person may set in between. The offset between
the two clocks is read with every stamp; for a while after it leapt, a stamp may be of either side.
"""

import socket
import struct
import sys
import time
from collections.abc import Iterable

from drivers.hosttime import now_ns

# Linux numbers; Python 3.11 has no names for them. The control messages carry the same numbers.
SO_TIMESTAMPNS = 35
SO_RXQ_OVFL = 40

_TIMESPEC = struct.Struct("@ll")
_UINT32 = struct.Struct("@I")

ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_UINT32.size)

LONGEST_WAIT_NS = 10_000_000_000
"""Nothing waits longer in a socket that is read: an older stamp means a step that nobody saw."""
STEP_NS = 1_000_000
FASTEST_SLEW = 1e-3
"""Offsets that change by more than STEP_NS and this fraction of the time between leapt."""
QUICK_NS = 50_000
"""Two readings of a clock farther apart were interrupted."""

Ancillary = Iterable[tuple[int, int, bytes]]


def request_stamps(sock: socket.socket) -> None:
    """Ask the kernel to stamp what arrives and to count what it drops (Linux; else nothing)."""
    if sys.platform == "linux":
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        sock.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)


class MonotonicStamps:
    """Monotonic times (ns) of the stamps of one socket, in the order in which it is read."""

    def __init__(self) -> None:
        self._now, self._offset = _read_clocks()
        self._earlier = self._offset
        self._stepped_at = self._now - LONGEST_WAIT_NS
        self._empty_at: int | None = None

    def emptied(self) -> None:
        """Note that nothing waits in the socket: what comes next is no older than this."""
        self._empty_at = now_ns()

    def of(self, ancillary: Ancillary) -> int:
        """Receive time by the control messages of one `recvmsg`; without a stamp, now."""
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack(data)
                return self.of_wall(seconds * 1_000_000_000 + nanoseconds)
        return now_ns()

    def of_wall(self, stamp_ns: int) -> int:
        """The same for a stamp of the wall clock (Unix ns).

        Of what it may mean, the youngest is right: a stamp is of the past, and seldom waited long.
        """
        now, offset = _read_clocks()
        if abs(offset - self._offset) > STEP_NS + FASTEST_SLEW * (now - self._now):
            self._earlier, self._stepped_at = self._offset, now
        self._now, self._offset = now, offset
        ages = [now + offset - stamp_ns]
        if now - self._stepped_at < LONGEST_WAIT_NS:
            ages.append(now + self._earlier - stamp_ns)
        longest = LONGEST_WAIT_NS
        if self._empty_at is not None:  # the process may have stood still
            longest = max(longest, now - self._empty_at)
        possible = [age for age in ages if -STEP_NS <= age <= longest]
        return now - max(min(possible, default=0), 0)


def dropped_so_far(ancillary: Ancillary) -> int | None:
    """Datagrams the kernel dropped on this socket (modulo 2**32); None where it says nothing."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_RXQ_OVFL and len(data) == _UINT32.size:
            count: int = _UINT32.unpack(data)[0]
            return count
    return None


def _read_clocks() -> tuple[int, int]:
    """Monotonic time and what wall time is ahead of it (ns), read at one moment."""
    for _ in range(3):
        before = now_ns()
        wall = time.time_ns()
        after = now_ns()
        if after - before < QUICK_NS:
            break
    return after, wall - (before + after) // 2
