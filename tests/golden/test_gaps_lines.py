"""GAPS lines that drivers quote, one of a ship's log, and the guide's example."""

import math
from datetime import UTC, datetime

import pytest

from drivers import registry
from drivers.nmea0183 import sentence
from drivers.records import GnssRecord, NmeaSentence, Record, Rejected, UsblRecord
from tests.golden.usbl_lines import lines, read


def told() -> list[Record | Rejected]:
    return read("gaps", *lines("ixblue_gaps_posidonia"))


def test_every_line_is_read() -> None:
    kinds = [GnssRecord, NmeaSentence, UsblRecord, UsblRecord, NmeaSentence, UsblRecord]
    assert [type(record) for record in told()] == kinds


def test_the_ship() -> None:
    ship = told()[0]
    assert ship.lat_deg == pytest.approx(27 + 18.19917 / 60)
    assert ship.lon_deg == pytest.approx(-(17 + 47.61373 / 60))
    assert (ship.valid, ship.t_device_s) == (True, pytest.approx(5 * 3600 + 56 * 60 + 48.831))


def test_one_beacon_by_the_bow_and_by_north() -> None:
    bow, north = (r for r in told() if isinstance(r, UsblRecord) and r.beacon == "4")
    assert (bow.axes, north.axes) == ("level", "north")
    assert bow.xyz_m == (-412.45, 526.85, 631.8)
    # Two sentences of one moment agree: the same range, turned by the heading alone.
    assert bow.slant_range_m == pytest.approx(north.slant_range_m, abs=0.02)
    assert bow.elevation_deg == pytest.approx(north.elevation_deg, abs=0.01)
    assert (north.bearing_deg - bow.bearing_deg) % 360 == pytest.approx(38.96, abs=0.01)
    moment = datetime(2018, 4, 5, 7, 12, 16, 870_000, UTC).timestamp()
    assert bow.t_device_s == pytest.approx(moment, abs=1e-3)


def test_the_older_form() -> None:
    old = told()[-1]
    assert (old.beacon, old.t_device_s, old.xyz_m) == ("1", None, (100, 199, 301))
    assert old.bearing_deg == pytest.approx(math.degrees(math.atan2(199, 100)))


def ptsa(address: str, *fields: str) -> bytes:
    return sentence(address, ["#1", "120000.000", "05", "04", "2018", *fields], 120)


def test_depth_below_the_array() -> None:
    line = ptsa("PTSAX", "2", "30", "40", "F", "55", "2", "9999")
    assert read("gaps", line, array_depth_m=5)[0].xyz_m == (30, 40, 50)
    (flat,) = read("gaps", ptsa("PTSAX", "2", "30", "40", "F", "0", "0", "9999"))
    assert (flat.xyz_m, flat.elevation_deg, flat.slant_range_m) == (None, None, None)
    assert flat.bearing_deg == pytest.approx(53.13, abs=0.01)


def test_three_hydrophones_are_no_fix() -> None:
    (fix,) = read("gaps", ptsa("PTSAX", "2", "30", "40", "7", "55", "1", "9999"))
    assert (fix.valid, fix.error_code) == (False, "hydrophones_7")
    codec = registry.lookup("gaps")
    assert read("gaps", codec.encode(fix, codec.options()))[0].error_code == "hydrophones_7"


@pytest.mark.parametrize("axes", ["level", "north"])
def test_a_beacon_is_written_as_it_is_read(axes: str) -> None:
    codec = registry.lookup("gaps")
    options = codec.options(array_depth_m=3.5)
    fix = UsblRecord(
        t_rx_ns=0, beacon="7", xyz_m=(1.25, -2.5, 30.5), axes=axes, t_device_s=86_399.9996
    )
    (again,) = read("gaps", codec.encode(fix, options), array_depth_m=3.5)
    assert (again.axes, again.xyz_m, again.t_device_s) == (axes, fix.xyz_m, 86_400.0)
    where = UsblRecord(t_rx_ns=0, beacon="7", lat_deg=-33.375, lon_deg=151.25, depth_m=12.5)
    (there,) = read("gaps", codec.encode(where, options))
    assert (there.lat_deg, there.lon_deg, there.depth_m) == (-33.375, 151.25, 12.5)
    with pytest.raises(ValueError, match="no sentence of gaps"):
        codec.encode(UsblRecord(t_rx_ns=0, beacon="7", xyz_m=(1.0, 2.0, 3.0)), options)


def dated(frame: str, day: str, year: str = "2018") -> bytes:
    """In February."""
    seen = ("2", "1", "1", "F", "1", "1", "9999")
    return sentence("PTSAY", [frame, "120000", day, "02", year, *seen], 120)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (ptsa("PTSAX", "2", "30", "40", "G", "55", "1", "9999"), "syntax"),
        (ptsa("PTSAX", "2", "30", "40", "F", "55", "3", "9999"), "syntax"),
        (ptsa("PTSAX", "2", "30", "F", "55", "1", "9999"), "syntax"),
        (ptsa("PTSAX", "200", "30", "40", "F", "55", "1", "9999"), "range"),
        (ptsa("PTSAG", "2", "9100.0", "N", "00000.0", "E", "F", "1", "1", "9999"), "range"),
        (dated("#1", "31"), "range"),
        (dated("#1", "01", "2018" * 9), "range"),
        (dated("1", "01"), "syntax"),
    ],
)
def test_what_is_rejected(line: bytes, reason: str) -> None:
    (record,) = read("gaps", line)
    assert (type(record), record.reason) == (Rejected, reason)
