"""A bus gives what the codec of each instrument gives: the same lines, each read by its own."""

import pytest

from drivers import registry
from drivers.nmea_bus import BusOptions
from drivers.records import (
    DepthRecord,
    GnssRecord,
    HeadingRecord,
    ImuRecord,
    NmeaSentence,
    Record,
    Rejected,
    TimeRecord,
)
from tests.drivers.aiding_frames import AIDING
from tests.shared_data import shared

BUS = registry.lookup("nmea-bus")
KINDS: dict[str, tuple[type, ...]] = {
    "nmea-gnss": (GnssRecord, TimeRecord),
    "nmea-heading": (HeadingRecord,),
    "nmea-depth": (DepthRecord,),
}


def read(codec: str, data: bytes, **options: object) -> list[Record | Rejected]:
    made = registry.lookup(codec)
    decoder = made.decoder(made.options(**options))
    return [*decoder.feed(data, 0), *decoder.close()]


def phins() -> bytes:
    """Lines of a real PHINS, as a multiplexer would pass them on."""
    lines = shared("vectors", "imu", "phins_nmea_standard.hex").read_text().split()
    return b"".join(bytes.fromhex(line).rstrip() + b"\r\n" for line in lines)


@pytest.mark.parametrize("codec", KINDS)
def test_each_instrument_is_read_as_by_its_own_codec(codec: str) -> None:
    data = phins() + b"".join(frame for name in KINDS for frame in AIDING[name])
    own = [r for r in read(codec, data) if isinstance(r, KINDS[codec])]
    assert [r for r in read("nmea-bus", data) if isinstance(r, KINDS[codec])] == own
    assert len(own) > 2


def test_what_none_of_them_reads_comes_out_as_it_is() -> None:
    found = read("nmea-bus", phins())
    others = [r for r in found if isinstance(r, NmeaSentence)]
    assert len(others) == len(found) - 2  # two headings
    assert not any(isinstance(r, Rejected) for r in found)


def test_options_reach_whom_they_concern() -> None:
    options = {"measures": "depth", "variation_deg": 3.0, "geoid_m": 40.0}
    lines = (
        b"$SDDPT,12.5,0.0\r\n$HCHDM,100.0,M\r\n"
        b"$GPGGA,120000.00,3300.0,S,07200.0,W,1,08,1.0,5.0,M,,M,,\r\n"
    )
    depth, heading, place = read("nmea-bus", lines, checksum="forbidden", **options)
    assert depth.depth_m == 12.5
    assert (heading.heading_deg, heading.reference) == (103.0, "true")
    assert place.height_m == 45.0


def test_what_no_instrument_of_a_bus_says_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot say a ImuRecord"):
        BUS.encode(ImuRecord(t_rx_ns=0), BusOptions())
