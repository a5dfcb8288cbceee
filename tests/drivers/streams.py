"""Frames of every codec, and what must hold for whatever a decoder makes of a stream of them."""

from bisect import bisect_right
from collections.abc import Iterable
from itertools import accumulate, groupby, pairwise
from operator import itemgetter
from typing import Any

import msgspec

from drivers import registry
from drivers.codec import Decoder
from drivers.records import Record, Rejected
from tests.drivers.aiding_frames import AIDING, AIDING_STRONG
from tests.drivers.imu_frames import IMU, IMU_STRONG
from tests.drivers.usbl_frames import USBL, USBL_STRONG

FRAMES: dict[str, list[bytes]] = {**IMU, **AIDING, **USBL}
"""Of each codec four frames or so, each of which gives one record."""

STRONG = IMU_STRONG | AIDING_STRONG | USBL_STRONG
"""Codecs whose check finds every single flipped bit."""


def decoder(name: str, options: msgspec.Struct | None = None) -> Decoder:
    codec = registry.lookup(name)
    return codec.decoder(codec.options() if options is None else options)


def bare(records: Iterable[Record | Rejected]) -> list[Record | Rejected]:
    """Without arrival: what must not depend on how the stream was cut."""
    return [msgspec.structs.replace(record, t_rx_ns=0, line_bytes=0) for record in records]


def good(records: Iterable[Record | Rejected]) -> list[Record | Rejected]:
    return [record for record in bare(records) if not isinstance(record, Rejected)]


def run(
    name: str, chunks: Iterable[bytes], options: msgspec.Struct | None = None
) -> list[Record | Rejected]:
    """Feed chunk i with the stamp i, close, and give all records."""
    reader = decoder(name, options)
    records = [record for i, chunk in enumerate(chunks) for record in reader.feed(chunk, i)]
    return records + list(reader.close())


def check_tiling(
    name: str,
    chunks: list[bytes],
    records: list[Record | Rejected],
    options: msgspec.Struct | None = None,
    *,
    alone: bool = True,
) -> None:
    """Every byte is in exactly one frame, and each record says rightly when its first one came.

    With `alone` a frame says the same to a decoder that has heard no other.
    """
    stream = b"".join(chunks)
    ends = list(accumulate(map(len, chunks)))
    starts = [ends[record.t_rx_ns] - record.line_bytes for record in records]
    assert [bisect_right(ends, start) for start in starts] == [r.t_rx_ns for r in records]
    frames = groupby(zip(starts, records, strict=True), itemgetter(0))
    contents = {start: [record for _, record in held] for start, held in frames}
    bounds = [*contents, len(stream)]
    assert bounds[0] == 0 or not records
    for held, (start, end) in zip(contents.values(), pairwise(bounds), strict=True):
        assert start < end
        if isinstance(held[0], Rejected):
            assert [record.data for record in held] == [stream[start:end]]
        elif alone:
            assert bare(held) == good(run(name, [stream[start:end]], options))


def read(name: str, data: bytes, **options: Any) -> Record | Rejected:
    """The one record that some bytes make."""
    codec = registry.lookup(name)
    (record,) = codec.decoder(codec.options(**options)).feed(data, 7)
    return record
