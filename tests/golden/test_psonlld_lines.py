"""Sonardyne lines: a vehicle at sea and a ship, as drivers quote them."""

import pytest

from drivers import registry
from drivers.nmea0183 import sentence
from drivers.records import NmeaSentence, Rejected, UsblRecord
from tests.golden.usbl_lines import lines, read

ALVIN = (
    b"$PSONLLD,170004.53,ALVIN 914,A,28.8114807,-87.80925696,1951.156,13.96,13.96,0.00,2.62,,,,*6F"
    b"\r\n"
)


def test_lines_of_a_system() -> None:
    ship, *rest = read("psonlld", *lines("sonardyne_ranger2"))
    assert (ship.beacon, ship.valid) == ("Ship 1", True)
    assert (ship.lat_deg, ship.lon_deg, ship.depth_m) == (51.3306281, -0.83499295, 0)
    assert ship.t_device_s == pytest.approx(13 * 3600 + 37 * 60 + 7.59)
    assert [type(record) for record in rest] == [NmeaSentence, NmeaSentence]


def test_a_vehicle_with_a_blank_in_its_name() -> None:
    (fix,) = read("psonlld", ALVIN)
    assert (fix.beacon, fix.lat_deg, fix.lon_deg) == ("ALVIN 914", 28.8114807, -87.80925696)
    assert fix.depth_m == 1951.156
    codec = registry.lookup("psonlld")
    assert codec.encode(fix, codec.options())[:60] == ALVIN.replace(b"807,", b"8070,")[:60]


def lld(*changed: str) -> bytes:
    return sentence("PSONLLD", ["120000", *changed, "1", "1", "0", "1", "", "", "", ""])


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (lld("A1", "A", "91", "0", "10"), "range"),
        (lld("A1", "A", "", "0", "10"), "syntax"),
        (lld("A1", "X", "1", "0", "10"), "syntax"),
        (lld("", "A", "1", "0", "10"), "syntax"),
        (sentence("PSONLLD", ["120000", "A1", "A", "1", "0", "10"]), "syntax"),
    ],
)
def test_what_is_rejected(line: bytes, reason: str) -> None:
    (record,) = read("psonlld", line)
    assert (type(record), record.reason) == (Rejected, reason)


def test_status() -> None:
    (fix,) = read("psonlld", lld("A1", "V", "1", "2", "10"))
    assert (fix.valid, fix.error_code, fix.lat_deg) == (False, "V", 1)
    codec = registry.lookup("psonlld")
    with pytest.raises(ValueError, match="needs latitude"):
        codec.encode(UsblRecord(t_rx_ns=0, beacon="1"), codec.options())
