"""Frames of every codec, and what must hold for whatever a decoder makes of a stream of them."""

from bisect import bisect_right
from collections.abc import Iterable
from itertools import accumulate, groupby, pairwise
from operator import itemgetter

import msgspec

from drivers import registry
from drivers.codec import Decoder
from drivers.records import (
    NmeaSentence,
    Record,
    Rejected,
    UsblRecord,
)
from tests.drivers.aiding_frames import AIDING, AIDING_STRONG
from tests.drivers.imu_frames import IMU
from tests.drivers.usbl_frames import USBL, USBL_STRONG


def _usbl(codec: str) -> list[bytes]:
    made = registry.lookup(codec)
    records = (
        UsblRecord(
            t_rx_ns=0,
            beacon=beacon,
            bearing_deg=53.1,
            elevation_deg=-45.0,
            slant_range_m=70.7,
            xyz_m=(30.0, 40.0, 50.0),
            t_device_s=t_s,
            lat_deg=-33.375,
            lon_deg=151.25,
            depth_m=50.0,
        )
        for beacon, t_s in (("1", 10.0), ("2", 11.0), ("3", 12.0), ("4", 13.0))
    )
    return [made.encode(record, made.options()) for record in records]


def _nmea() -> list[bytes]:
    made = registry.lookup("nmea0183")
    sentences = (("GP", "HDT", ("123.4", "T")), ("HE", "ROT", ("-0.1", "A")), ("P", "UNAV", ("",)))
    return [
        made.encode(NmeaSentence(t_rx_ns=0, talker=t, formatter=f, fields=x), made.options())
        for t, f, x in sentences
    ] + [b"$GPZDA,160012.71,11,03,2004,-1,00*7D\r\n"]


def _gnss() -> list[bytes]:
    return [
        b"$GPGGA,092725.00,4717.11399,N,00833.91590,E,1,08,1.01,499.6,M,48.0,M,,*5B\r\n",
        b"$GPRMC,083559.00,A,4717.11437,N,00833.91522,E,0.004,77.52,091202,,,A*57\r\n",
        b"$GPGGA,,,,,,0,00,99.99,,,,,,*48\r\n",
        b"$GNGNS,103600.01,5114.51176,N,00012.29380,W,ANNN,07,1.18,111.5,45.6,,,V*00\r\n",
        b"$GPVTG,77.52,T,,M,0.004,N,0.008,K,A*06\r\n",
        b"$GPZDA,082710.00,16,09,2002,00,00*64\r\n",
        b"$GPRMC,225446,A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E*68\r\n",
    ]


def _phins() -> list[bytes]:
    return [
        b"$HEHDT,116.581,T*25\r\n",
        b"$PIXSE,SPEED_,0.972,1.082,0.412*61\r\n",
        b"$PIXSE,ATITUD,-1.641,-0.490*6D\r\n",
        b"$PIXSE,DEPIN_,732.811,085832.643253*7D\r\n",
        b"$PIXSE,ALGSTS,00000045,00004000*60\r\n",
    ]


STRONG = frozenset(IMU) | AIDING_STRONG | USBL_STRONG | {"phins", "nmea0183", "nmea-gnss"}
"""Codecs whose check finds every single flipped bit."""

FRAMES: dict[str, list[bytes]] = {
    **IMU,
    **AIDING,
    **USBL,
    "phins": _phins(),
    "nmea0183": _nmea(),
    "nmea-gnss": _gnss(),
    **{
        name: _usbl(name)
        for name in ("tracklink-lxt", "tracklink-tp2", "tracklink-gll", "tracklink-log")
    },
}


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
