"""SeaTrac fixes put together byte by byte after the maker's table; no real one was found."""

import pytest

from drivers import registry
from drivers.checksums import crc16_arc
from drivers.records import OtherFrame, Rejected, UsblRecord
from tests.golden.usbl_lines import read

BEGIN = "0F 02 {flags} 00 0807 F6FF 0500 3200 983A 2CFB"
"""To 15, from 2: yaw 180.0, pitch -1.0, roll 0.5 deg, 5.0 m deep, 1500.0 m/s, -123.6 dB."""
RANGE = "E8030000 40420F00 C302"
"""1000 counts, 0.1 s, 70.7 m."""
ANGLES = "03 2CFB 2DFB 2EFB 1302 39FE 9600"
"""Three receivers; azimuth 53.1, elevation -45.5 deg, error 1.5."""
POSITION = "1400 1E00 F401"


def line(*blocks: str, cid: str = "39", flags: str = "00") -> bytes:
    content = bytes.fromhex(cid + "".join(blocks).format(flags=flags))
    return (
        b"$"
        + (content + crc16_arc(content).to_bytes(2, "little")).hex().upper().encode()
        + (b"\r\n")
    )


def test_check_value_of_the_catalogue() -> None:
    assert crc16_arc(b"123456789") == 0xBB3D


@pytest.mark.parametrize("cid", ["39", "42"])
def test_a_whole_fix(cid: str) -> None:
    (fix,) = read("seatrac", line(BEGIN, RANGE, ANGLES, POSITION, cid=cid, flags="07"))
    assert isinstance(fix, UsblRecord)
    assert (fix.beacon, fix.valid, fix.axes) == ("2", True, "array")
    assert (fix.bearing_deg, fix.elevation_deg, fix.slant_range_m) == (53.1, -45.5, 70.7)


def test_blocks_that_are_not_there() -> None:
    (ranged,) = read("seatrac", line(BEGIN, RANGE, flags="01"))
    assert (ranged.valid, ranged.slant_range_m, ranged.bearing_deg) == (True, 70.7, None)
    (seen,) = read("seatrac", line(BEGIN, ANGLES, flags="02"))
    assert (seen.valid, seen.slant_range_m, seen.bearing_deg) == (True, None, 53.1)
    (deaf,) = read("seatrac", line(BEGIN))
    assert (deaf.valid, deaf.error_code) == (False, "no_reply")


def test_azimuth_over_half_a_turn() -> None:
    (fix,) = read("seatrac", line(BEGIN, "00 100E 0000 0000", flags="02"))
    assert fix.bearing_deg == 0.0
    (fix,) = read("seatrac", line(BEGIN, "00 8C0A 0000 0000", flags="02"))
    assert fix.bearing_deg == -90.0


@pytest.mark.parametrize(
    ("flags", "options", "fault"),
    [
        ("03", {"fit_error_max": 1.4}, "fit_error"),
        ("13", {}, "filter"),
        ("03", {"elevation_positive": "down"}, None),
    ],
)
def test_options(flags: str, options: dict[str, object], fault: str | None) -> None:
    (fix,) = read("seatrac", line(BEGIN, RANGE, ANGLES, flags=flags), **options)
    assert (fix.valid, fix.error_code) == (fault is None, fault)
    assert fix.elevation_deg == (45.5 if "elevation_positive" in options else -45.5)
    codec = registry.lookup("seatrac")
    (again,) = read("seatrac", codec.encode(fix, codec.options(**options)), **options)
    told = (again.bearing_deg, again.elevation_deg, again.slant_range_m, again.error_code)
    assert told == (53.1, fix.elevation_deg, 70.7, fault)


def test_other_messages_come_out_as_they_are() -> None:
    (other,) = read("seatrac", line("0102", cid="02"))
    assert (type(other), other.name) == (OtherFrame, "0x02")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (line(BEGIN, RANGE, flags="03"), "length"),
        (line(BEGIN, RANGE, ANGLES, flags="01"), "length"),
        (line(BEGIN, RANGE, flags="01").replace(b"C302", b"C303"), "checksum"),
        (line(BEGIN, RANGE, flags="01")[:-3] + b"\r\n", "syntax"),
    ],
)
def test_what_is_rejected(text: bytes, reason: str) -> None:
    (record,) = read("seatrac", text)
    assert (type(record), record.reason) == (Rejected, reason)


def test_what_cannot_be_written() -> None:
    codec = registry.lookup("seatrac")
    far = UsblRecord(t_rx_ns=0, beacon="1", slant_range_m=7000.0)
    with pytest.raises(ValueError, match="seatrac cannot say this fix"):
        codec.encode(far, codec.options())
