"""Lines of the MicronNav's manual, in the shared vectors, decode to what it says of them."""

from math import atan2, degrees, hypot

import pytest

from drivers import registry
from drivers.records import OtherFrame, Rejected, UsblRecord
from tests.golden.usbl_lines import lines, read


def raw(content: str, count: int | None = None, head: str = "082031") -> bytes:
    """A line with the count it should have, or another."""
    length = len(content) + len(head) + 8
    return f"%D{length if count is None else count:04X}{head}{content}\r\n".encode()


def test_raw_position_with_commas_and_in_columns() -> None:
    commas, world, columns = lines("tritech_micronnav")
    for line in (commas, columns):
        (fix,) = read("micronnav", line)
        assert (fix.beacon, fix.valid, fix.axes) == ("0", True, "level")
        assert fix.xyz_m == (4.764, -18.686, 4.1)
        assert fix.slant_range_m == pytest.approx(hypot(4.764, 18.686, 4.1))
        assert fix.bearing_deg == pytest.approx(degrees(atan2(-18.686, 4.764)))
        assert fix.elevation_deg < 0
        assert fix.t_device_s == 15 * 3600 + 31 * 60 + 56.32
    (printed,) = read("micronnav", world)
    assert (type(printed), printed.reason) == (Rejected, "length")


def test_a_place_in_the_world_is_passed_on() -> None:
    """As printed it lacks a character of those it counts: the sign that every other number has."""
    line = lines("tritech_micronnav")[1].replace(b",503868", b",+503868")
    (other,) = read("micronnav", line)
    assert (type(other), other.name, other.data) == (OtherFrame, "slot 08 kind 0", line)


@pytest.mark.parametrize("commas", [True, False])
def test_lines_are_written_as_the_manual_has_them(commas: bool) -> None:
    codec = registry.lookup("micronnav")
    (fix,) = read("micronnav", lines("tritech_micronnav")[0])
    written = codec.encode(fix, codec.options(commas=commas))
    printed = lines("tritech_micronnav")[0 if commas else 2]
    assert written == printed.replace(b"0.8", b"1.0")


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (",3,+500,-4764,+100,2.5,31,15315782", None),
        (",3,+500,-4764,+100,2.5,14,15315782", "replies_14"),
        (",3,+500,-4764,+100,0.4,30,15315782", "quality"),
        (",3,+0,+0,+0,2.5,30,15315782", "no_range"),
    ],
)
def test_faults(content: str, fault: str | None) -> None:
    (fix,) = read("micronnav", raw(content), quality_min=0.5, levelled=False)
    assert (fix.valid, fix.error_code, fix.axes) == (fault is None, fault, "array")
    codec = registry.lookup("micronnav")
    options = codec.options(quality_min=0.5, levelled=False)
    assert read("micronnav", codec.encode(fix, options), quality_min=0.5, levelled=False) == [
        fix.__class__(**{name: getattr(fix, name) for name in fix.__struct_fields__})
    ]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (raw(",3,+500,-4764,+100,2.5,30,15315782", count=9), "length"),
        (raw(",3,+500,-4764,+100,2.5,30,25315782"), "range"),
        (raw(",20,+500,-4764,+100,2.5,30,15315782"), "range"),
        (raw(",3,+500,-476400000,+100,2.5,30,15315782"), "range"),
        (raw(",3,+500,-4764,+100,2.5,15315782"), "syntax"),
        (raw(",3,+500,-4764,+100,2.5,30,15315782", head="082001"), "syntax"),
        (b"$GPHDT,1.0,T*32\r\n", "syntax"),
    ],
)
def test_what_is_rejected(line: bytes, reason: str) -> None:
    (record,) = read("micronnav", line)
    assert (type(record), record.reason) == (Rejected, reason)


@pytest.mark.parametrize(
    "record",
    [
        UsblRecord(t_rx_ns=0, beacon="1", xyz_m=(1.0, 2.0, 3.0)),
        UsblRecord(t_rx_ns=0, beacon="1", bearing_deg=1.0, axes="level"),
        UsblRecord(t_rx_ns=0, beacon="20", xyz_m=(1.0, 2.0, 3.0), axes="level"),
        UsblRecord(t_rx_ns=0, beacon="1", xyz_m=(1e6, 2.0, 3.0), axes="level"),
    ],
)
def test_what_it_cannot_say(record: UsblRecord) -> None:
    codec = registry.lookup("micronnav")
    with pytest.raises(ValueError, match="micronnav"):
        codec.encode(record, codec.options())
