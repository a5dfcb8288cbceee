"""Both forms of the Cerulean sentence, as its maker prints them."""

import pytest

from drivers import registry
from drivers.nmea0183 import sentence
from drivers.records import NmeaSentence, Rejected, UsblRecord
from tests.golden.usbl_lines import lines, read

SHORT = ["358.5", "1.5", "2.8", "142.8", "52.8", "37.2", "2.8"]
REST = ["-0.6", "1.9", "178.1", "271.9", "16"]


def test_both_forms() -> None:
    """The sum printed behind the long one is that of other fields."""
    printed = lines("cerulean_rovl")
    short, misprinted, other = read("usrth", *printed)
    assert (type(misprinted), misprinted.reason) == (Rejected, "checksum")
    assert isinstance(other, NmeaSentence)
    (long,) = read("usrth", printed[1].partition(b"*")[0] + b"\r\n", checksum="forbidden")
    for fix in (short, long):
        assert (fix.bearing_deg, fix.elevation_deg, fix.slant_range_m) == (1.5, 2.8, 142.8)
        assert (fix.beacon, fix.valid, fix.axes) == ("1", True, "array")


def test_true_angles() -> None:
    short = read("usrth", *lines("cerulean_rovl"), angles="true", beacon="rov")[0]
    assert (short.bearing_deg, short.axes, short.beacon) == (37.2, "north", "rov")


@pytest.mark.parametrize("angles", ["apparent", "true"])
@pytest.mark.parametrize("positive", ["up", "down"])
def test_what_is_written_is_read(angles: str, positive: str) -> None:
    codec = registry.lookup("usrth")
    options = codec.options(angles=angles, elevation_positive=positive)
    axes = "array" if angles == "apparent" else "north"
    fix = UsblRecord(
        t_rx_ns=0,
        beacon="1",
        bearing_deg=-150.5,
        elevation_deg=-30.5,
        slant_range_m=12.5,
        axes=axes,
    )
    line = codec.encode(fix, options)
    (again,) = read("usrth", line, angles=angles, elevation_positive=positive)
    assert (again.bearing_deg, again.elevation_deg, again.axes) == (-150.5, -30.5, axes)
    assert line.split(b",")[3] == (b"-30.5" if positive == "up" else b"30.5")
    with pytest.raises(ValueError, match="usrth cannot say"):
        codec.encode(UsblRecord(t_rx_ns=0, beacon="1", slant_range_m=1.0), options)


@pytest.mark.parametrize(
    ("at", "text", "reason"),
    [(0, "35.0", "range"), (2, "95.0", "range"), (3, "-1", "range"), (1, "", "syntax")],
)
def test_what_is_rejected(at: int, text: str, reason: str) -> None:
    fields = [*SHORT, *REST]
    fields[at] = text
    (record,) = read("usrth", sentence("USRTH", fields))
    assert (type(record), record.reason) == (Rejected, reason)


def test_a_direction_without_a_range_is_no_fix() -> None:
    (fix,) = read("usrth", sentence("USRTH", [*SHORT[:3], "", *SHORT[4:], *REST]))
    assert (fix.valid, fix.error_code) == (False, "no_range")
