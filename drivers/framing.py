"""Finding frames in a stream: one bounded buffer, and on it frames of bytes and lines of text.

Every byte ends in exactly one record, and the records do not depend on how the stream was cut into
chunks. A candidate that fails its check costs one byte: its declared length is not believed, so
good frames behind it are found.
"""

import re
from collections import deque
from collections.abc import Callable, Iterable, Sequence

from drivers.records import OtherFrame, Reason, Record, Rejected

JUNK_MAX = 1024
"""Longest run of junk held back to become one `Rejected` (bytes)."""

Found = list[Record | Rejected]


class UnreadableError(ValueError):
    """Text that is no record; `reason` is what its `Rejected` says."""

    def __init__(self, reason: Reason, message: str) -> None:
        super().__init__(message)
        self.reason: Reason = reason


class FrameBuffer:
    """Bytes that wait, when each of them arrived, and the run of junk at their front."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._start = 0
        self._judged = 0
        self._chunks: deque[tuple[int, int]] = deque()
        self._junk = 0
        self._reason: Reason = "unknown"
        self._found: Found = []

    def __len__(self) -> int:
        return len(self._data) - self._judged

    def push(self, data: bytes, t_rx_ns: int) -> None:
        """Append one chunk with its receive stamp."""
        if data:
            self._data += data
            self._chunks.append((self._start + len(self._data), t_rx_ns))

    def ahead(self) -> bytes:
        """Give the bytes not judged yet: those behind the run of junk."""
        return bytes(self._data[self._judged + self._junk :])

    def arrival(self, offset: int = 0) -> tuple[int, int]:
        """``t_rx_ns`` and ``line_bytes`` of the byte at `offset` of `ahead`."""
        at = self._start + self._judged + self._junk + offset
        for end, t_rx_ns in self._chunks:
            if end > at:
                return t_rx_ns, end - at
        raise IndexError(offset)

    def accept(self, length: int, records: Iterable[Record | Rejected]) -> None:
        """The next `length` bytes are `records`."""
        if self._junk:
            self.flush()
        self._reason = "unknown"
        self._drop(length)
        self._found += records

    def begin(self, length: int, reason: Reason) -> None:
        """The next `length` bytes are junk of a run of their own."""
        self.flush()
        self._reason = reason
        self.extend(length)

    def extend(self, length: int) -> None:
        """The next `length` bytes are junk and join the run; alone their reason is unknown.

        A long run becomes several records of one reason.
        """
        while length:
            step = min(length, JUNK_MAX - self._junk)
            self._junk += step
            length -= step
            if self._junk == JUNK_MAX:
                reason = self._reason
                self.flush()
                self._reason = reason

    def flush(self) -> None:
        """End the run of junk."""
        if not self._junk:
            return
        length, self._junk = self._junk, 0
        t_rx_ns, line_bytes = self.arrival()
        self._found.append(
            Rejected(
                t_rx_ns=t_rx_ns,
                line_bytes=line_bytes,
                reason=self._reason,
                data=bytes(self._data[self._judged : self._judged + length]),
            )
        )
        self._reason = "unknown"
        self._drop(length)

    def take(self) -> Found:
        """Hand over what was found since the last call, in the order of its bytes; forget these."""
        found, self._found = self._found, []
        del self._data[: self._judged]
        self._start += self._judged
        self._judged = 0
        return found

    def _drop(self, length: int) -> None:
        self._judged += length
        while self._chunks and self._chunks[0][0] <= self._start + self._judged:
            self._chunks.popleft()


class SyncDecoder:
    """Frames that begin in a way to be known again and tell their length early.

    Parameters
    ----------
    prefixes
        The bytes a frame of the format may begin with; an empty one where any byte will do.
    measure
        ``(data, at) -> length`` of the frame that begins at `at`; 0 if that is no frame, None if
        more bytes must come before it can be told.
    decode
        ``(frame, t_rx_ns, line_bytes)`` -> what the frame holds (or why it is rejected, if its
        check does hold), at least one record; None if its check failed.
    """

    def __init__(
        self,
        prefixes: Sequence[bytes],
        measure: Callable[[bytes, int], int | None],
        decode: Callable[[bytes, int, int], Sequence[Record | Rejected] | None],
    ) -> None:
        pattern = re.compile(b"|".join(map(_prefix_pattern, prefixes)))
        self._begins, self._candidate = pattern.match, pattern.search
        self._measure = measure
        self._decode = decode
        self._buffer = FrameBuffer()

    def feed(self, data: bytes, t_rx_ns: int) -> Iterable[Record | Rejected]:
        """Take one chunk; give the records it completes."""
        # The usual datagram is one whole frame: no copy, no bookkeeping.
        if not self._buffer and self._begins(data) and self._measure(data, 0) == len(data):
            records = self._decode(data, t_rx_ns, len(data))
            if records is not None:
                return records
        self._buffer.push(data, t_rx_ns)
        return self._drain(final=False)

    def close(self) -> Iterable[Record | Rejected]:
        """End of the stream: look through what waits and reject the rest."""
        found = self._drain(final=True)
        self._buffer.flush()
        return found + self._buffer.take()

    def _drain(self, *, final: bool) -> Found:
        data, at = self._buffer.ahead(), 0
        while at < len(data):
            step = self._step(data, at, final=final)
            if not step:
                break
            at += step
        return self._buffer.take()

    def _step(self, data: bytes, at: int, *, final: bool) -> int:
        """Judge the bytes at `at`; give how many, 0 if more must come first."""
        candidate = self._candidate(data, at)
        start = candidate.start() if candidate else len(data)
        if start > at:
            self._buffer.extend(start - at)
            return start - at
        length = self._measure(data, at)
        if length is None or at + length > len(data):
            if not final:
                return 0
            self._buffer.begin(1, "length")
            return 1
        if not length:
            self._buffer.extend(1)
            return 1
        records = self._decode(data[at : at + length], *self._buffer.arrival())
        if records is None:
            self._buffer.begin(1, "checksum")
            return 1
        self._buffer.accept(length, records)
        return length


def _prefix_pattern(prefix: bytes) -> bytes:
    """Pattern of a prefix, or of its first bytes where the data end in them."""
    pattern = b""
    for place in reversed(range(len(prefix))):
        more = b"(?:" + pattern + rb"|\Z)" if pattern else b""
        pattern = re.escape(prefix[place : place + 1]) + more
    return pattern


def other_line(name: str, line: str, t_rx_ns: int, line_bytes: int) -> OtherFrame:
    """A whole line of which nothing here makes use, its end included."""
    data = f"{line}\r\n".encode()
    return OtherFrame(t_rx_ns=t_rx_ns, line_bytes=line_bytes, name=name, data=data)


class LineDecoder:
    """Lines of printable ASCII that end in CR LF or LF.

    Parameters
    ----------
    decode
        ``(text, t_rx_ns, line_bytes)`` -> the record of a line; raises `UnreadableError`.
    starts
        Where a record may begin in what stands between two line ends, likeliest first: not always
        at 0, because junk or a damaged line end may stand before it.
    longest
        Bytes of the longest line with its end; what is longer is rejected as it comes.
    shortest
        Characters below which a last line without its end is taken for a truncated one.
    """

    def __init__(
        self,
        decode: Callable[[str, int, int], Record],
        starts: Callable[[bytes], Iterable[int]],
        *,
        longest: int = JUNK_MAX,
        shortest: int = 0,
    ) -> None:
        self._decode = decode
        self._starts = starts
        self._longest = longest
        self._shortest = shortest
        self._torn = False
        self._buffer = FrameBuffer()

    def feed(self, data: bytes, t_rx_ns: int) -> Iterable[Record | Rejected]:
        """Take one chunk; give the records it completes."""
        self._buffer.push(data, t_rx_ns)
        *lines, rest = self._buffer.ahead().split(b"\n")
        for line in lines:
            self._judge(self._shorten(line + b"\n"))
        self._shorten(rest)
        return self._buffer.take()

    def close(self) -> Iterable[Record | Rejected]:
        """End of the stream: a last line without its end counts if it is whole."""
        rest = self._buffer.ahead()
        if len(rest) >= max(1, self._shortest):
            self._judge(rest)
        else:
            self._reject(len(rest), "length")
        self._torn = False
        return self._buffer.take()

    def _shorten(self, line: bytes) -> bytes:
        """Reject the front of a line that is too long; give what may still hold a good one."""
        excess = len(line) - self._longest
        if excess <= 0:
            return line
        if self._torn:
            self._buffer.extend(excess)
        else:
            self._buffer.begin(excess, "length")
        self._torn = True
        return line[excess:]

    def _judge(self, line: bytes) -> None:
        """Turn one whole line into a record and into rejected bytes before it."""
        content = line.rstrip(b"\r\n")
        reason: Reason | None = "length" if self._torn else None
        for start in self._starts(content):
            if start >= len(line) or (self._torn and start == 0):
                continue
            result = self._read(content[start:], start)
            if not isinstance(result, str):
                self._reject(start, reason or "unknown")
                self._buffer.accept(len(line) - start, (result,))
                break
            reason = reason or result
        else:
            self._reject(len(line), reason or "unknown")
        self._torn = False

    def _read(self, content: bytes, start: int) -> Record | Reason:
        text = content.decode("latin-1").replace("\t", " ")
        if not (text.isascii() and text.isprintable()):
            return "syntax"
        try:
            return self._decode(text, *self._buffer.arrival(start))
        except UnreadableError as error:
            return error.reason

    def _reject(self, length: int, reason: Reason) -> None:
        if length and self._torn:
            self._buffer.extend(length)
        elif length:
            self._buffer.begin(length, reason)
        self._buffer.flush()
