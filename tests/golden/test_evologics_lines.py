"""EvoLogics lines: a bench capture, a driver's test and the example of the maker's guide."""

import math

import pytest

from drivers import registry
from drivers.records import OtherFrame, Rejected, UsblRecord
from tests.golden.usbl_lines import lines, read

FILE = "evologics_s2c"


def test_fixes() -> None:
    records = read("evologics", *lines(FILE))
    assert not any(isinstance(record, Rejected) for record in records)
    failed, near, far = (r for r in records if isinstance(r, UsblRecord) and r.xyz_m)

    assert (near.beacon, near.valid, near.t_device_s) == ("1", True, 455.346033)
    assert near.xyz_m == (0.9197, 1.2601, 0.3958)
    assert near.slant_range_m == pytest.approx(1500 * 1073e-6, abs=0.001)
    assert near.one_way_s == 1073e-6
    assert near.age_s == 0.25479
    assert near.bearing_deg == pytest.approx(53.87, abs=0.01)
    assert near.elevation_deg == pytest.approx(-14.24, abs=0.01)

    assert (far.beacon, far.valid) == ("2", True)
    assert far.slant_range_m == pytest.approx(1500 * 0.990922, abs=0.1)
    assert far.age_s == 0.134348

    # The modem heard it but found no direction: its accuracy is the range itself.
    assert (failed.valid, failed.error_code) == (False, "accuracy")
    assert failed.slant_range_m == pytest.approx(1.2375, abs=5e-5)


def test_the_guide_turns_the_fix_as_its_attitude_says() -> None:
    """By roll 180 and heading -90 deg right, forward, up become the guide's east, north, up."""
    fix = read("evologics", lines(FILE)[-1])[0]
    forward, starboard, down = fix.xyz_m
    east, north, up = 1000.1375, -1099.5699, -2.3382
    assert (north, east, up) == pytest.approx((-starboard, -forward, down), abs=2e-4)


def test_time_differences() -> None:
    (told,) = (r for r in read("evologics", *lines(FILE)) if getattr(r, "differences", None))
    assert (told.beacon, told.t_device_s, told.age_s) == ("3", 10446.534642, 0.457984)
    delays = {(d.element, d.than): d.delay_s for d in told.differences}
    assert delays == {
        ("1", "5"): -39278e-9,
        ("2", "5"): -10591e-9,
        ("4", "5"): -12608e-9,
        ("1", "2"): -27941e-9,
        ("4", "1"): 23818e-9,
    }
    # They close their circles but for some microseconds: the order of the fields is right.
    assert delays["1", "5"] - delays["2", "5"] == pytest.approx(delays["1", "2"], abs=1e-6)
    assert delays["4", "5"] - delays["1", "5"] == pytest.approx(delays["4", "1"], abs=3e-6)
    # The first element is one that heard it a hand's breadth of sound before the fifth.
    assert math.isclose(1500 * delays["1", "5"], -0.0589, abs_tol=1e-4)


def test_what_else_a_modem_says_comes_out_as_it_is() -> None:
    names = [r.name for r in read("evologics", *lines(FILE)) if isinstance(r, OtherFrame)]
    assert names == [
        *("OK", "SENDSTART", "SENDEND", "RECVSTART", "RECVEND", "DELIVEREDIM"),
        "USBLPHYP",
    ]


@pytest.mark.parametrize(("positive", "rate"), [("closing", 0.25), ("opening", -0.25)])
@pytest.mark.parametrize(
    "line",
    [
        b"RECV,3,7,1,1000,-36,130,990922,-0.25,a\n,\r\n",
        b"RECVIM,3,7,1,noack,182272,-36,130,-0.25,a\n,\r\n",
        b"RECVIMS,3,7,1,1853461060,182272,-36,130,-0.25,a\n,\r\n",
        b"RECVPBM,3,7,1,182272,-36,130,-0.25,a\n,\r\n",
    ],
)
def test_velocity(line: bytes, positive: str, rate: float) -> None:
    (record,) = read("evologics", line, velocity_positive=positive)
    assert (record.beacon, record.range_rate_m_s) == ("7", rate)
    (unused,) = read("evologics", line)
    assert isinstance(unused, OtherFrame)


def test_a_beacon_of_any_direction_is_written_and_read() -> None:
    codec = registry.lookup("evologics")
    rate = UsblRecord(t_rx_ns=0, beacon="4", range_rate_m_s=-1.25)
    options = codec.options(velocity_positive="closing", framed=True)
    line = codec.encode(rate, options)
    assert read("evologics", line, velocity_positive="closing")[0].range_rate_m_s == -1.25
    angles = UsblRecord(t_rx_ns=0, beacon="4", bearing_deg=-120.0, elevation_deg=-60.0)
    (again,) = read("evologics", codec.encode(angles, options))
    assert (again.bearing_deg, again.elevation_deg) == pytest.approx((-120, -60), abs=0.01)
    with pytest.raises(ValueError, match="evologics needs"):
        codec.encode(UsblRecord(t_rx_ns=0, beacon="4"), options)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("USBLANGLES,1.0,2.0,2,0,0,0,0,0,0,0,0,0,0", "range"),
        ("USBLANGLES,2.0,2.0,2,0,9.9,0,0,0,0,0,0,0,0", "range"),
        ("USBLPHYD,1.0,1.0,2", "syntax"),
        ("USBLPHYD,1.0,1.0,a,0,1,1,1,1,1,1,1,1", "syntax"),
    ],
)
def test_what_is_rejected(line: str, reason: str) -> None:
    (record,) = read("evologics", f"+++AT:{len(line)}:{line}\r\n".encode())
    assert (type(record), record.reason) == (Rejected, reason)
    wrong = read("evologics", f"+++AT:{len(line) + 1}:{line}\r\n".encode())
    assert all(isinstance(part, Rejected) for part in wrong)
    assert wrong[0].reason == "checksum"


def test_a_weak_link_is_refused_where_that_is_asked_for() -> None:
    (fix,) = read("evologics", lines(FILE)[-2], integrity_min=147)
    assert (fix.valid, fix.error_code) == (False, "integrity")
