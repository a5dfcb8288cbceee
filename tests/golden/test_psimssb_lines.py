"""PSIMSSB lines: a HiPAP at sea, another make's output, and the examples of the description."""

import pytest

from drivers import registry
from drivers.nmea0183 import sentence
from drivers.records import HeadingRecord, Rejected, UsblRecord
from tests.golden.usbl_lines import lines, read


def fixes() -> list[UsblRecord]:
    return [r for r in read("psimssb", *lines("psimssb_hipap")) if isinstance(r, UsblRecord)]


def test_only_the_line_with_a_wrong_sum_is_rejected() -> None:
    bad = [r for r in read("psimssb", *lines("psimssb_hipap")) if isinstance(r, Rejected)]
    assert [(r.reason, r.data.split(b",")[1]) for r in bad] == [("checksum", b"085405.61")]


def test_no_reply_is_never_a_fix() -> None:
    told = [(f.valid, f.error_code) for f in fixes() if f.beacon == "M17"]
    assert told == [(False, "NRy"), (True, None), (False, "NRy")]


def test_a_fix_by_north() -> None:
    fix = fixes()[1]
    assert (fix.axes, fix.xyz_m, fix.one_way_s) == ("north", (46.649, 1.632, 24.829), 0.033681)
    assert fix.t_device_s == pytest.approx(8 * 3600 + 37 * 60 + 33.386)
    # The range is that of the reference point, the time that of the transducer: near each other.
    assert fix.slant_range_m == pytest.approx(1500 * fix.one_way_s, rel=0.08)


def test_a_fix_by_the_vessels_head() -> None:
    """What the description says of its example: 50 m ahead, 100 m to starboard."""
    polar = next(f for f in fixes() if f.beacon == "B01")
    assert polar.axes == "level"
    assert polar.xyz_m == pytest.approx((50, 100, 48.5), abs=0.02)
    assert polar.bearing_deg == pytest.approx(63.43)
    assert polar.t_device_s is None


def test_attitude() -> None:
    (told,) = (r for r in read("psimssb", *lines("psimssb_hipap")) if isinstance(r, HeadingRecord))
    assert (told.roll_deg, told.pitch_deg, told.heading_deg) == (-1.27, -1.13, 250.87)
    assert told.t_device_s == pytest.approx(7 * 3600 + 56 * 60 + 17.446)


def ssb(mode: str, x: str, y: str, *, kind: str = "M", status: str = "A") -> bytes:
    fields = ["120000", "B1", status, "", *mode, kind, x, y, "30", "0.1", "N", "", ""]
    return sentence("PSIMSSB", fields)


@pytest.mark.parametrize(
    ("mode", "x", "y", "axes", "xyz_m"),
    [
        ("CH", "40", "30", "level", (30, 40, 30)),
        ("CN", "40", "30", "north", (40, 30, 30)),
        ("CE", "40", "30", "north", (30, 40, 30)),
        ("PH", "10", "270", "level", (0, -10, 30)),
        ("PN", "10", "90", "north", (0, 10, 30)),
    ],
)
def test_every_system(mode: str, x: str, y: str, axes: str, xyz_m: tuple[float, ...]) -> None:
    (fix,) = read("psimssb", ssb(mode, x, y))
    assert (fix.axes, fix.valid) == (axes, True)
    assert fix.xyz_m == pytest.approx(xyz_m)
    (own,) = read("psimssb", ssb(mode, x, y), levelled=False)
    assert own.axes == ("array" if axes == "level" else "north")


@pytest.mark.parametrize("mode", ["UN", "UE"])
def test_a_place_in_an_unknown_zone_is_no_fix(mode: str) -> None:
    (told,) = read("psimssb", ssb(mode, "7000000.0", "500000.0"))
    assert (told.valid, told.error_code, told.xyz_m, told.depth_m) == (False, "utm", None, 30)


@pytest.mark.parametrize(
    ("line", "options", "fault"),
    [
        (ssb("CH", "1", "1", kind="P"), {}, "predicted"),
        (ssb("CH", "1", "1", kind="F"), {}, None),
        (ssb("CH", "1", "1", kind="F"), {"filtered": False}, "filtered"),
        (ssb("CH", "1", "1", status="V"), {}, "V"),
    ],
)
def test_what_is_no_fix(line: bytes, options: dict[str, bool], fault: str | None) -> None:
    (told,) = read("psimssb", line, **options)
    assert (told.valid, told.error_code) == (fault is None, fault)
    codec = registry.lookup("psimssb")
    (again,) = read("psimssb", codec.encode(told, codec.options(**options)), **options)
    assert again.error_code == told.error_code


@pytest.mark.parametrize("fields", [("RH", "1", "1"), ("PE", "1", "1"), ("CH", "x", "1")])
def test_what_is_rejected(fields: tuple[str, str, str]) -> None:
    (told,) = read("psimssb", ssb(*fields))
    assert (type(told), told.reason) == (Rejected, "syntax")


def test_a_bare_asterisk_where_that_is_allowed() -> None:
    line = ssb("CH", "1", "1")
    (told,) = read("psimssb", line[: line.index(b"*") + 1] + b"\r\n", checksum="optional")
    assert told.valid
