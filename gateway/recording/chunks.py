"""The records of an MCAP file, past the chunks that are damaged."""

import re
import struct
from collections.abc import Callable, Iterator
from io import SEEK_END, BytesIO
from typing import BinaryIO, NamedTuple, cast

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

MAX_RECORD = 64 * 1024 * 1024
"""A longer record than any recording holds is a damaged length."""
DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,  # a wrong sum is one
    MemoryError,  # these two for a damaged length
    OverflowError,
)
"""What the library raises for it."""

_HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""
_BEFORE_NAME = struct.Struct("<BQQQQI")
"""Of a chunk, before the name of its compression: head, times, size and sum of what it holds."""
_NAME = re.compile(rb"\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4")
_CHUNK_HEAD = _BEFORE_NAME.size + 8
_FOOTER = struct.Struct("<QQI")
"""Its first number is where the summary begins."""
_BLOCK = 1 << 20


class Loss(NamedTuple):
    """A stretch of a file that cannot be read: its first byte, and how many."""

    at_byte: int
    bytes: int


class _Step(NamedTuple):
    """A record: where the next one begins, and the channels and messages that it is or holds."""

    end: int
    is_chunk: bool
    records: list[McapRecord]


class _Whole:
    """A file as the library wants it, of which a read is whole or the end."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, size: int) -> bytes:
        data = self._file.read(size)
        if len(data) < size:
            raise EndOfFile
        return data


def strict(file: BinaryIO) -> StreamReader:
    """The library's reader from the first byte on, which raises one of `DAMAGE` at the first."""
    whole = cast("BinaryIO", _Whole(file))
    return StreamReader(whole, validate_crcs=True, record_size_limit=MAX_RECORD)


class Records:
    """All channels and messages of a file that can be trusted, in their order.

    What is damaged is passed over up to the next chunk. The channels that may have been in it are
    given again, where the file's summary has them.

    Parameters
    ----------
    lost
        Is told of each stretch that is passed over, when its end is found.

    Attributes
    ----------
    is_closed
        Whether the file has an end.
    """

    def __init__(self, file: BinaryIO, lost: Callable[[Loss], None]) -> None:
        self._file, self._lost = file, lost
        self._size = file.seek(0, SEEK_END)
        end = _end_of_data(file, self._size)
        self.is_closed = end is not None
        self._end = self._size if end is None else end

    def __iter__(self) -> Iterator[McapRecord]:
        """Raises `UnsupportedCompressionError` where nothing here unpacks its chunks."""
        at = sure = len(MCAP0_MAGIC)
        lost_at: int | None = None
        while at < self._end:
            try:
                step = self._step(at, self._end)
            except DAMAGE as error:
                is_chunk = self._is_chunk(at)
                if is_chunk and isinstance(error, UnsupportedCompressionError):
                    raise
                # If it is none, a length before it may have misled us: look again from there.
                found = self._next_chunk(at + 1 if is_chunk else sure)
                if found > at:
                    lost_at = at if lost_at is None else lost_at
                at = found
                yield from self._channels()
                continue
            if step.is_chunk:
                sure = step.end
                if lost_at is not None:
                    self._lost(Loss(lost_at, at - lost_at))
                    lost_at = None
            yield from step.records
            at = step.end
        if lost_at is not None and not self._is_cut_index(lost_at):
            self._lost(Loss(lost_at, self._end - lost_at))

    def _step(self, at: int, end: int) -> "_Step":
        """Read the record at a byte; raises one of `DAMAGE` for what is none."""
        self._file.seek(at)
        opcode, length = _HEAD.unpack(self._file.read(_HEAD.size))
        known = Opcode.HEADER <= opcode <= Opcode.DATA_END
        if not known or length > min(MAX_RECORD, end - at - _HEAD.size):
            raise McapError
        records: list[McapRecord] = []
        if opcode in (Opcode.CHUNK, Opcode.CHANNEL, Opcode.MESSAGE):
            stream = ReadDataStream(BytesIO(self._file.read(length)))
            if opcode == Opcode.CHUNK:
                records = breakup_chunk(Chunk.read(stream), validate_crc=True)
                length = stream.count  # its sum is right: this is its length, whatever was said
            elif opcode == Opcode.CHANNEL:
                records = [Channel.read(stream)]
            else:
                records = [Message.read(stream, length)]
        return _Step(at + _HEAD.size + length, opcode == Opcode.CHUNK, records)

    def _next_chunk(self, begin: int) -> int:
        """Where the next chunk begins, by the name of its compression; else the end."""
        at = begin
        while at < self._end:
            self._file.seek(at)
            data = self._file.read(_BLOCK + _CHUNK_HEAD)
            for name in _NAME.finditer(data, _BEFORE_NAME.size):
                head = name.start() - _BEFORE_NAME.size
                if data[head] == Opcode.CHUNK:
                    return min(at + head, self._end)
            at += _BLOCK
        return self._end

    def _is_chunk(self, at: int) -> bool:
        """Whether a chunk's head is there."""
        self._file.seek(at)
        head = self._file.read(_CHUNK_HEAD)
        return head[:1] == bytes([Opcode.CHUNK]) and bool(_NAME.match(head, _BEFORE_NAME.size))

    def _is_cut_index(self, at: int) -> bool:
        """Whether a file was cut off in what stands behind a whole chunk, and holds no event."""
        self._file.seek(at)
        return not self.is_closed and self._file.read(1) == bytes([Opcode.MESSAGE_INDEX])

    def _channels(self) -> Iterator[McapRecord]:
        """The channels that the summary repeats, as far as it can be read."""
        at = self._end
        while at < self._size:
            try:
                step = self._step(at, self._size)
            except DAMAGE:
                return
            yield from step.records
            at = step.end


def _end_of_data(file: BinaryIO, size: int) -> int | None:
    """Where the summary, or the footer, of a file begins; None without them."""
    tail = _FOOTER.size + len(MCAP0_MAGIC)
    if size < tail:
        return None
    file.seek(-tail, SEEK_END)
    data = file.read(tail)
    if not data.endswith(MCAP0_MAGIC):
        return None
    summary, *_ = _FOOTER.unpack_from(data)
    return summary if 0 < summary < size else size - tail - _HEAD.size
