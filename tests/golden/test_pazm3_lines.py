"""A reply of a Zima 2 and a corrupted line of one, as its maker's logs have them."""

import math

import pytest

from drivers import registry
from drivers.nmea0183 import sentence
from drivers.records import NmeaSentence, Rejected, UsblRecord
from tests.golden.usbl_lines import read

REPLY = b"$PAZM3,1,0,0,38,23.8,0.080975,115.3,113.0,22.8,325.8,11.4,1147.22,4.5,,2.6,-2.9*0E\r\n"
CORRUPTED = b"$PAZM3,1,0,0,0,23.4,360.035150,52.7,,360.0,360.0,0.8,1120.93,26.9,,1.9,-0.3\r\n"


def azm(status: str, way: str, slant: str, elevation: str = "30") -> bytes:
    told = [status, "7", "0", "0", "20", way, slant, "", "", "90", elevation]
    return sentence("PAZM3", [*told, "", "", "", "", ""])


def test_a_reply() -> None:
    (fix,) = read("pazm3", REPLY)
    assert (fix.beacon, fix.valid, fix.slant_range_m, fix.depth_m) == ("0", True, 115.3, 22.8)
    assert fix.bearing_deg == pytest.approx(325.8 - 360)
    assert fix.one_way_s == 0.080975
    # Range and time give a sound speed of cold, nearly fresh water, range and depth the angle.
    assert fix.slant_range_m / fix.one_way_s == pytest.approx(1424, abs=1)
    assert fix.elevation_deg == pytest.approx(-math.degrees(math.asin(22.8 / 115.3)), abs=0.05)


def test_a_corrupted_line_without_a_sum() -> None:
    (record,) = read("pazm3", CORRUPTED)
    assert (type(record), record.reason) == (Rejected, "range")
    (strict,) = read("pazm3", REPLY[: REPLY.index(b"*")] + b"\r\n", checksum="required")
    assert isinstance(strict, Rejected)


def test_what_is_no_fix() -> None:
    assert isinstance(read("pazm3", azm("0", "", ""))[0], NmeaSentence)
    faults = {
        "timeout": azm("2", "", ""),
        "no_range": azm("1", "0.1", ""),
        "inconsistent": azm("1", "0.1", "200"),
    }
    for fault, line in faults.items():
        (told,) = read("pazm3", line)
        assert (told.valid, told.error_code) == (False, fault)
    assert isinstance(read("pazm3", azm("3", "0.1", "150"))[0], Rejected)
    assert isinstance(read("pazm3", azm("1", "0.1", "-150"))[0], Rejected)


@pytest.mark.parametrize(("positive", "elevation"), [("down", -30.0), ("up", 30.0)])
def test_which_way_elevation_grows(positive: str, elevation: float) -> None:
    (fix,) = read("pazm3", azm("1", "0.1", "150"), elevation_positive=positive)
    assert fix.elevation_deg == elevation
    codec = registry.lookup("pazm3")
    line = codec.encode(fix, codec.options(elevation_positive=positive))
    assert read("pazm3", line, elevation_positive=positive)[0].elevation_deg == elevation
    west = UsblRecord(t_rx_ns=0, beacon="1", bearing_deg=-0.01, slant_range_m=10.0)
    assert b",0.0," in codec.encode(west, codec.options())
