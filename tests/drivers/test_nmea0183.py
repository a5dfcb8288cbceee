"""NMEA 0183 against pynmeagps and by hand: checksums, addresses, latitudes and longitudes."""

import pynmeagps
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.framing import UnreadableError
from drivers.nmea0183 import (
    NMEA0183,
    NmeaOptions,
    degrees,
    latitude,
    longitude,
    parse,
    sentence,
)
from drivers.records import NmeaSentence, Rejected

GLL = "$GPGLL,4916.45,N,12311.12,W,225444,A"


def test_reads_what_another_library_wrote() -> None:
    line = (
        pynmeagps.NMEAMessage("GN", "HDT", 0, payload=["123.4", "T"]).serialize().decode().strip()
    )
    assert parse(line) == ("GN", "HDT", ("123.4", "T"))


def test_another_library_reads_what_is_written() -> None:
    line = sentence("GPGLL", ("4916.45", "N", "12311.12", "W", "225444", "A"))
    read = pynmeagps.NMEAReader.parse(line)
    assert read.identity == "GPGLL"
    assert (read.lat, read.lon) == (49.2741666667, -123.1853333333)


def test_proprietary_address() -> None:
    line = sentence("PUNAV", ("1.0", ""))
    assert line.endswith(b"\r\n")
    assert parse(line.decode().strip()) == ("P", "UNAV", ("1.0", ""))


@pytest.mark.parametrize(
    ("line", "checksum", "reason"),
    [
        (GLL, "required", "syntax"),
        (GLL + "*31", "forbidden", "syntax"),
        (GLL + "*32", "optional", "checksum"),
        (GLL + "*32", "required", "checksum"),
        (GLL + "*3", "optional", "syntax"),
        (GLL + "*", "required", "syntax"),
        ("GPGLL,1*31", "optional", "syntax"),
        ("$GPGL,1", "optional", "syntax"),
        ("$GP$GLL,1", "optional", "syntax"),
        ("", "optional", "syntax"),
    ],
)
def test_bad_sentences(line: str, checksum: str, reason: str) -> None:
    with pytest.raises(UnreadableError) as caught:
        parse(line, checksum)
    assert caught.value.reason == reason


@pytest.mark.parametrize(
    ("line", "checksum"),
    [(GLL, "optional"), (GLL, "forbidden"), (GLL + "*", "optional"), (GLL + "*31", "required")],
)
def test_good_sentences(line: str, checksum: str) -> None:
    assert parse(line, checksum)[:2] == ("GP", "GLL")


@pytest.mark.parametrize("field", ["1*2", "a,b", "$", "a\r\n", "é"])
def test_reserved_characters_are_not_written(field: str) -> None:
    with pytest.raises(ValueError, match="reserved"):
        sentence("GPTXT", (field,))


def test_length_limit() -> None:
    room = 82 - len("$GPTXT,*hh\r\n")
    assert len(sentence("GPTXT", ("x" * room,))) == 82
    with pytest.raises(ValueError, match="longer than 82"):
        sentence("GPTXT", ("x" * (room + 1),))


@pytest.mark.parametrize(
    ("text", "hemisphere", "value"),
    [
        ("4916.45", "N", 49.274166666666666),
        ("3322.50", "S", -33.375),
        ("12311.12", "W", -123.18533333333333),
        ("00000.0", "E", 0.0),
        ("9000.00", "N", 90.0),
        ("18000", "W", -180.0),
    ],
)
def test_degrees(text: str, hemisphere: str, value: float) -> None:
    assert degrees(text, hemisphere) == pytest.approx(value, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "hemisphere", "reason"),
    [
        ("4960.00", "N", "range"),
        ("9000.01", "N", "range"),
        ("18000.01", "E", "range"),
        ("4916.45", "X", "syntax"),
        ("4916.45", "", "syntax"),
        ("", "N", "syntax"),
        ("nan", "N", "syntax"),
        ("-4916.45", "N", "syntax"),
    ],
)
def test_no_degrees(text: str, hemisphere: str, reason: str) -> None:
    with pytest.raises(UnreadableError) as caught:
        degrees(text, hemisphere)
    assert caught.value.reason == reason


def test_minutes_carry_into_degrees() -> None:
    assert latitude(-33.99999999) == ("3400.0000", "S")
    assert longitude(200.5) == ("15930.0000", "W")
    assert longitude(-0.5, 0) == ("00030", "W")
    assert latitude(0.0, 5) == ("0000.00000", "N")


@given(st.floats(-90, 90), st.floats(-180, 180), st.integers(0, 7))
def test_latitude_and_longitude_round_trip(lat: float, lon: float, decimals: int) -> None:
    half_step = 0.5 * 10.0**-decimals / 60 + 1e-12
    assert degrees(*latitude(lat, decimals)) == pytest.approx(lat, abs=half_step)
    assert degrees(*longitude(lon, decimals)) == pytest.approx(lon, abs=half_step)


def test_codec_gives_sentences_and_reasons() -> None:
    reader = NMEA0183.decoder(NmeaOptions())
    found = list(reader.feed(sentence("GPHDT", ("1.0", "T")) + b"$GPHDT,1.0,T*00\n\r\n", 3))
    assert found[0] == NmeaSentence(
        t_rx_ns=3, line_bytes=35, talker="GP", formatter="HDT", fields=("1.0", "T")
    )
    assert [(r.reason, r.data) for r in found[1:] if isinstance(r, Rejected)] == [
        ("checksum", b"$GPHDT,1.0,T*00\n"),
        ("syntax", b"\r\n"),
    ]


def test_codec_without_checksums() -> None:
    options = NmeaOptions(checksum="forbidden")
    (record,) = NMEA0183.decoder(options).feed(GLL.encode() + b"\n", 0)
    assert NMEA0183.encode(record, options) == GLL.encode() + b"\r\n"
