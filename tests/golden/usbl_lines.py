"""Lines of the shared vectors of acoustic systems, without the comments between them."""

from typing import Any

from drivers import registry
from drivers.records import Record, Rejected
from tests.shared_data import shared


def lines(file: str) -> list[bytes]:
    """Each with CR LF."""
    raw = shared("vectors", "usbl", f"{file}.txt").read_bytes().splitlines()
    return [line + b"\r\n" for line in raw if line and not line.startswith(b"#")]


def read(name: str, *stream: bytes, **options: Any) -> list[Record | Rejected]:
    """What a codec makes of a stream."""
    codec = registry.lookup(name)
    reader = codec.decoder(codec.options(**options))
    return [*reader.feed(b"".join(stream), 0), *reader.close()]
