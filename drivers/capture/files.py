"""A capture file as blocks of bytes, gunzipped on the way, with errors that name the place."""

import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, Self

BLOCK_BYTES = 1024 * 1024
MAX_PACKET = 16 * 1024 * 1024
"""A longer packet than any tool writes is a damaged length."""

_GZIP_MAGIC = b"\x1f\x8b"
_GZIP_WBITS = 31


class CaptureError(Exception):
    """A capture that cannot be read, or no further: one line with its name and the place."""


class Packet(NamedTuple):
    """One captured packet.

    Attributes
    ----------
    t_ns
        Arrival, nanoseconds since the Unix epoch.
    linktype
        Number of the outermost header, as in the registry of tcpdump.org.
    data
        Bytes from that header on.
    """

    t_ns: int
    linktype: int
    data: bytes


class Source:
    """The bytes of one file, read ahead in large blocks.

    Parameters
    ----------
    told
        Is told how many bytes of the file, as it is stored, each of its reads gave.

    Attributes
    ----------
    good
        Packets that were read whole; the reader keeps it for the error message.
    """

    def __init__(self, path: Path, told: Callable[[int], object] | None = None) -> None:
        self.good = 0
        self._told = told
        self._path = path
        self._read = 0
        try:
            self._file = path.open("rb", buffering=0)
            magic = self._take(len(_GZIP_MAGIC))
        except OSError as error:
            raise CaptureError(f"{path}: {(error.strerror or str(error)).lower()}") from error
        self._packed = magic == _GZIP_MAGIC
        self._blocks = (_gunzip if self._packed else _plain)(self._take, magic)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def _take(self, count: int = BLOCK_BYTES) -> bytes:
        """Next bytes of the file as it is stored; none at its end."""
        block = self._file.read(count) or b""
        if self._told is not None:
            self._told(len(block))
        return block

    def more(self, rest: bytes) -> bytes | None:
        """`rest` with new bytes behind it; None at the end of the file.

        Raises
        ------
        CaptureError
            Where the file cannot be read or unpacked further.
        """
        try:
            block = next(self._blocks, None)
        except EOFError:
            raise self.cut() from None
        except zlib.error:
            raise self.damaged(0, "gzip data") from None
        except OSError as error:
            raise self.damaged(0, error.strerror or str(error)) from error
        if block is None:
            return None
        self._read += len(block)
        return rest + block if rest else block

    def further(self, rest: bytes) -> bytes:
        """`rest` with new bytes behind it; nothing at the end of a file of which nothing is left.

        Raises
        ------
        CaptureError
            As `more`, and where the file ends within a packet: with a `rest`.
        """
        longer = self.more(rest)
        if longer is None and rest:
            raise self.cut()
        return longer or b""

    def refused(self, why: str) -> CaptureError:
        """Error of a file that is no capture."""
        return CaptureError(f"{self._path}: {why}")

    def cut(self) -> CaptureError:
        """Error of a file that ends too soon."""
        return self._broken("cut off", 0)

    def damaged(self, left: int, what: str) -> CaptureError:
        """Error of a file whose structure is lost where the last `left` bytes read so far begin."""
        return self._broken(f"damaged ({what})", left)

    def _broken(self, how: str, left: int) -> CaptureError:
        place = f"byte {self._read - left}" + (" of the unpacked data" if self._packed else "")
        packets = "1 good packet" if self.good == 1 else f"{self.good} good packets"
        return CaptureError(f"{self._path}: {how} at {place}, after {packets}")


def _plain(take: Callable[[], bytes], start: bytes) -> Iterator[bytes]:
    if start:
        yield start
    while block := take():
        yield block


def _gunzip(take: Callable[[], bytes], packed: bytes) -> Iterator[bytes]:
    """Unpack one gzip member after the other; raises EOFError inside one that ends too soon."""
    while packed:
        inflate = zlib.decompressobj(wbits=_GZIP_WBITS)
        while not inflate.eof:
            packed = packed or take()
            if not packed:
                raise EOFError
            block = inflate.decompress(packed, BLOCK_BYTES)
            packed = inflate.unconsumed_tail
            if block:
                yield block
        packed = (inflate.unused_data or take()).lstrip(b"\0")
