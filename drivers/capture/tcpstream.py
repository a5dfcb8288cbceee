"""The bytes of one direction of a TCP connection, in order, from captured segments."""

from bisect import insort
from dataclasses import dataclass

FIN, SYN, RST = 0x01, 0x02, 0x04

HOLE_BYTES = 256 * 1024
HOLE_WAIT_NS = 2_000_000_000
"""A hole older than this was lost by the capture, not on the way: TCP would have filled it."""

_PIECE_OVERHEAD = 128
_RESTART_BYTES = 16 * 1024 * 1024
"""A sequence number further off than any window belongs to another connection."""

Piece = tuple[bytes, int]
"""Bytes and when they could be read (ns)."""


@dataclass(slots=True)
class StreamCounts:
    """What was put right, and what could not be."""

    repeated_bytes: int = 0
    """Sent again though seen already."""
    holes: int = 0
    missing_bytes: int = 0
    """Bytes in holes that nothing filled."""
    restarts: int = 0
    """Jumps to an unrelated sequence number without a handshake."""


class TcpStream:
    """Puts segments in order. A SYN, or a first segment without one, is where the stream begins.

    A piece is stamped with the time of its own packet, but never before the piece in front of it:
    what had to wait for a retransmission is as late as it was for the program that read it, and
    what waited for bytes the capture lost is not late at all.

    Attributes
    ----------
    ended
        Whether the sender has finished (all bytes up to its FIN are out) or reset.
    """

    def __init__(self, counts: StreamCounts) -> None:
        self.ended = False
        self._counts = counts
        self._next: int | None = None
        """Sequence number of the next byte, counted on beyond 2**32."""
        self._first = 0
        self._fin: int | None = None
        self._waiting: list[tuple[int, int, bytes]] = []
        self._waiting_bytes = 0
        self._t_ns = 0

    def add(self, sequence: int, flags: int, payload: bytes, t_ns: int) -> list[Piece]:
        """Take one segment; give what can be read now."""
        if flags & RST:
            self.ended = True
            return self.close()
        pieces: list[Piece] = []
        if flags & SYN:
            sequence = (sequence + 1) & 0xFFFF_FFFF
            if self._next is None or sequence != self._first:
                pieces += self._begin(sequence)
        elif self._next is None:
            self._begin(sequence)
        position = self._position(sequence)
        if abs(position - self._reached) > _RESTART_BYTES:
            self._counts.restarts += 1
            pieces += self._begin(sequence)
            position = sequence
        if payload:
            insort(self._waiting, (position, t_ns, payload))
            self._waiting_bytes += len(payload) + _PIECE_OVERHEAD
            pieces += self._release(t_ns)
        if flags & FIN:
            self._fin = position + len(payload)
        self.ended = self._fin is not None and self._reached >= self._fin
        return pieces

    def close(self) -> list[Piece]:
        """No more segments: give what waits, holes or not."""
        return self._release(None)

    @property
    def _reached(self) -> int:
        return self._next or 0

    def _begin(self, sequence: int) -> list[Piece]:
        pieces = self.close()
        self._next = self._first = sequence
        self._fin = None
        return pieces

    def _position(self, sequence: int) -> int:
        """Sequence number counted on beyond 2**32: the one nearest to where the stream is."""
        ahead = (sequence - self._reached) & 0xFFFF_FFFF
        return self._reached + (ahead if ahead < 0x8000_0000 else ahead - 0x1_0000_0000)

    def _release(self, t_ns: int | None) -> list[Piece]:
        pieces: list[Piece] = []
        done = 0
        for position, t_piece, payload in self._waiting:
            hole = position - self._reached
            if hole > 0:
                if not self._is_lost(t_piece, t_ns):
                    break
                self._counts.holes += 1
                self._counts.missing_bytes += hole
                self._next = position
            seen = self._reached - position
            self._counts.repeated_bytes += min(seen, len(payload))
            if seen < len(payload):
                self._t_ns = max(self._t_ns, t_piece)
                pieces.append((payload[seen:], self._t_ns))
                self._next = position + len(payload)
            self._waiting_bytes -= len(payload) + _PIECE_OVERHEAD
            done += 1
        del self._waiting[:done]
        return pieces

    def _is_lost(self, t_seen: int, t_ns: int | None) -> bool:
        """Whether to give up the hole in front of a piece that came at `t_seen`."""
        if t_ns is None or self._waiting_bytes > HOLE_BYTES:
            return True
        return t_ns - t_seen > HOLE_WAIT_NS
