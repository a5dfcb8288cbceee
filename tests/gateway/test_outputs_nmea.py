"""Own sentences read by an independent parser, and the rules that readers in the field need."""

import math
from datetime import UTC, datetime, timedelta

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pynmeagps import NMEAMessage, NMEAReader

from gateway.modes import Mode
from gateway.outputs import nmea
from gateway.outputs.schema import NavReport, nav_report
from tests.gateway.solutions import solution

DEPTHS = ("DPT", "DBT", "DBS")
ALL = ("GGA", "GLL", "RMC", "VTG", "HDT", "THS", "ZDA", "GST", "GBS", "GSA", *DEPTHS, "PUNAV")
SURFACE_M = 10.0
"""Height of the surface above the ellipsoid."""
NOON_NS = 1_700_049_600_000_000_000  # 2023-11-15 12:00:00 UTC
USABLE = (Mode.AIDED, Mode.DEAD_RECKONING)


def report(**changes: object) -> NavReport:
    return msgspec.structs.replace(nav_report(solution(t_ns=0), NOON_NS), **changes)


def write(nav: NavReport | None, *sentences: str, utc_ns: int = NOON_NS) -> dict[str, list[str]]:
    """Fields of each sentence of an epoch by name, as they stand on the line."""
    data = nmea.epoch(nav, utc_ns, sentences or ALL, "GP", surface_height_m=SURFACE_M)
    lines = data.decode().split("\r\n")[:-1]
    bodies = [line[1 : line.index("*")].split(",") for line in lines]
    return {body[0].removeprefix("GP"): body[1:] for body in bodies}


def parse(data: bytes) -> dict[str, NMEAMessage]:
    lines = data.splitlines(keepends=True)
    return {m.msgID: m for m in map(NMEAReader.parse, lines)}


def reports(modes: tuple[Mode, ...] = USABLE) -> st.SearchStrategy[NavReport]:
    angle, sigma = st.floats(0, 359.999999), st.floats(0, 1e5)
    return st.builds(
        report,
        utc_ns=st.integers(0, 4_000_000_000 * 10**9),
        lat_deg=st.floats(-90, 90),
        lon_deg=st.floats(-180, 179.9999999999),
        height_m=st.floats(-11_000, 9_000),
        vn_m_s=st.floats(-50, 50),
        ve_m_s=st.floats(-50, 50),
        roll_deg=st.floats(-180, 180),
        pitch_deg=st.floats(-90, 90),
        heading_deg=angle,
        sd_n_m=sigma,
        sd_e_m=sigma,
        sd_d_m=sigma,
        sd_roll_deg=sigma,
        sd_pitch_deg=sigma,
        sd_heading_deg=sigma,
        ellipse_major_m=sigma,
        ellipse_minor_m=sigma,
        ellipse_deg=st.floats(0, 179.999999),
        mode=st.sampled_from(modes),
    )


def circle_close(a: float, b: float, tolerance: float) -> bool:
    return abs((a - b + 180) % 360 - 180) <= tolerance


@settings(max_examples=200, deadline=None)
@given(reports())
def test_an_independent_parser_reads_back_the_solution(nav: NavReport) -> None:
    got = parse(nmea.epoch(nav, 0, ALL[:-1]))
    for name in ("GGA", "GLL", "RMC"):
        assert got[name].lat == pytest.approx(nav.lat_deg, abs=1e-7)
        assert circle_close(got[name].lon, nav.lon_deg, 1e-7)
    assert got["GGA"].alt + got["GGA"].sep == pytest.approx(nav.height_m, abs=0.0051)
    speed = math.hypot(nav.vn_m_s, nav.ve_m_s)
    assert got["RMC"].spd == pytest.approx(speed * 3600 / 1852, abs=0.0051)
    assert got["VTG"].sogk == pytest.approx(speed * 3.6, abs=0.0051)
    if speed > 0.2:
        course = math.degrees(math.atan2(nav.ve_m_s, nav.vn_m_s))
        assert circle_close(got["RMC"].cog, course, 0.0051)
        assert got["VTG"].cogt == got["RMC"].cog
    assert circle_close(got["HDT"].headingT, nav.heading_deg, 0.0051)
    assert circle_close(got["THS"].headt, nav.heading_deg, 0.0051)
    assert got["GSA"].navMode == 3
    for name, said in (("errLat", nav.sd_n_m), ("errLon", nav.sd_e_m), ("errAlt", nav.sd_d_m)):
        assert getattr(got["GBS"], name) == pytest.approx(said, rel=1e-3, abs=0.00051)


@settings(max_examples=200, deadline=None)
@given(reports())
def test_the_time_is_right_to_the_hundredth_with_its_date(nav: NavReport) -> None:
    got = parse(nmea.epoch(nav, 0, ALL[:-1]))
    truth = datetime(1970, 1, 1) + timedelta(microseconds=nav.utc_ns // 1000)
    zda = datetime.combine(
        datetime(got["ZDA"].year, got["ZDA"].month, got["ZDA"].day), got["ZDA"].time
    )
    assert abs(zda - truth) <= timedelta(milliseconds=5.001)
    assert f"{zda:%d%m%y}" == write(nav, "RMC")["RMC"][8]
    for name in ("GGA", "GLL", "RMC", "GST"):
        assert got[name].time == got["ZDA"].time


@settings(max_examples=300, deadline=None)
@given(reports(tuple(Mode)))
def test_every_sentence_fits_and_ends_as_it_must(nav: NavReport) -> None:
    data = nmea.epoch(nav, 0, ALL, "GP", surface_height_m=SURFACE_M, range_error_m=5.1)
    for line in data.split(b"\r\n")[:-1]:
        check = 0
        for byte in line[1:-3]:
            check ^= byte
        assert line[:1] == b"$"
        assert line[-3:] == b"*%02X" % check
        assert len(line) + 2 <= 82


def test_an_aided_solution_says_so() -> None:
    got = write(report())
    where = ["3948.00000", "N", "11612.00000", "E"]
    assert got["GGA"] == ["120000.00", *where, "1", "00", "", "-50.25", "M", "0.0", "M", "", ""]
    assert got["GLL"] == [*where, "120000.00", "A", "A"]
    assert got["RMC"] == ["120000.00", "A", *where, "5.91", "350.54", "151123", "", "", "A"]
    assert got["VTG"] == ["350.54", "T", "", "M", "5.91", "N", "10.95", "K", "A"]
    assert got["HDT"] == ["350.00", "T"]
    assert got["THS"] == ["350.00", "A"]
    assert got["ZDA"] == ["120000.00", "15", "11", "2023", "00", "00"]
    assert got["GST"] == ["120000.00", "", "0.431", "0.253", "62.5", "0.300", "0.400", "0.500"]
    assert got["GBS"] == ["120000.00", "0.300", "0.400", "0.500", "", "", "", ""]
    assert got["GSA"] == ["A", "3", *[""] * 15]
    assert got["DPT"] == ["60.25", "0.0"]
    assert got["DBT"] == got["DBS"] == ["197.7", "f", "60.25", "M", "32.9", "F"]
    sigmas = ["0.500", "0.500", "0.100", "0.200", "0.300"]
    assert got["PUNAV"] == ["120000.00", "A", "-1.50", "2.50", "350.00", "50.25", *sigmas]


def test_without_fixes_the_solution_is_estimated() -> None:
    got = write(report(mode=Mode.DEAD_RECKONING))
    assert got["GGA"][5] == "6"
    assert (got["RMC"][1], got["RMC"][-1]) == ("A", "E")
    assert got["GLL"][-2:] == ["A", "E"]
    assert got["VTG"][-1] == got["THS"][-1] == "E"
    assert got["PUNAV"][1] == "D"


@pytest.mark.parametrize(
    ("nav", "state"),
    [
        (report(mode=Mode.ALIGNING), "I"),
        (None, "N"),
        (report(mode=Mode.INVALID), "N"),
        (report(mode=Mode.FAULT), "F"),
        (report(lat_deg=math.nan), "A"),
    ],
)
def test_without_a_solution_there_is_nothing_to_plot(nav: NavReport | None, state: str) -> None:
    got = write(nav)
    assert got["GGA"] == ["120000.00", "", "", "", "", "0", "00", *[""] * 7]
    assert got["GLL"] == ["", "", "", "", "120000.00", "V", "N"]
    assert got["RMC"] == ["120000.00", "V", *[""] * 6, "151123", "", "", "N"]
    assert got["VTG"] == ["", "T", "", "M", "", "N", "", "K", "N"]
    assert got["THS"] == ["", "V"]
    assert got["GST"] == ["120000.00", *[""] * 7]
    assert got["ZDA"] == ["120000.00", "15", "11", "2023", "00", "00"]
    assert got["PUNAV"] == ["120000.00", state, *[""] * 9]
    assert got["GBS"] == ["120000.00", *[""] * 7]
    assert got["GSA"] == ["A", "1", *[""] * 15]
    assert not {"HDT", *DEPTHS} & got.keys()


def test_rounding_carries_from_minutes_into_degrees() -> None:
    got = write(report(lat_deg=-(9 + 59.9999996 / 60), lon_deg=99 + 59.9999996 / 60), "GLL")
    assert got["GLL"][:4] == ["1000.00000", "S", "10000.00000", "E"]
    assert write(report(lon_deg=-179.99999999999), "GLL")["GLL"][2:4] == ["18000.00000", "W"]


def test_rounding_carries_into_the_next_day_and_its_date() -> None:
    midnight = datetime(2024, 3, 1, tzinfo=UTC)
    utc_ns = int(midnight.timestamp()) * 10**9 - 4_000_000
    got = write(report(utc_ns=utc_ns), "RMC", "ZDA")
    assert (got["RMC"][0], got["RMC"][8]) == ("000000.00", "010324")
    assert got["ZDA"][:4] == ["000000.00", "01", "03", "2024"]
    got = write(report(utc_ns=utc_ns - 2_000_000), "RMC")
    assert (got["RMC"][0], got["RMC"][8]) == ("235959.99", "290224")


def test_directions_that_round_to_a_full_turn_are_zero() -> None:
    nav = report(heading_deg=359.996, ellipse_deg=179.96, vn_m_s=3.0, ve_m_s=-1e-4)
    got = write(nav)
    assert got["HDT"][0] == got["THS"][0] == got["PUNAV"][4] == "0.00"
    assert got["RMC"][7] == got["VTG"][0] == "0.00"
    assert got["GST"][4] == "0.0"


def test_a_standstill_has_no_course() -> None:
    got = write(report(vn_m_s=0.03, ve_m_s=0.03))
    assert (got["RMC"][6], got["RMC"][7], got["VTG"][0]) == ("0.08", "", "")
    noisy = report(vn_m_s=0.5, ve_m_s=0.0, sd_vn_m_s=0.6)
    assert write(noisy, "VTG")["VTG"][0] == ""


def test_small_negative_numbers_have_no_negative_zero() -> None:
    got = write(report(height_m=-0.001, roll_deg=-0.001))
    assert got["GGA"][8] == got["PUNAV"][2] == got["PUNAV"][5] == "0.00"


def test_a_depth_is_known_where_the_surface_is_and_never_negative() -> None:
    assert nmea.epoch(report(), 0, DEPTHS) == b""
    got = write(report(height_m=SURFACE_M + 0.4))
    assert (got["DPT"][0], got["DBT"][2], got["DBS"][2]) == ("0.00", "0.00", "0.00")


def test_dilutions_are_what_makes_the_sigmas_of_a_range_error() -> None:
    nav = report(sd_n_m=3.0, sd_e_m=4.0, sd_d_m=12.0)
    got = parse(nmea.epoch(nav, 0, ("GGA", "GSA"), range_error_m=2.0))
    assert got["GGA"].HDOP == got["GSA"].HDOP == 2.5
    assert (got["GSA"].PDOP, got["GSA"].VDOP) == (6.5, 6.0)
    without = (nmea.epoch(nav, 0, ("GGA",)), nmea.epoch(None, 0, ("GGA",), range_error_m=2.0))
    assert {parse(data)["GGA"].HDOP for data in without} == {""}


def test_the_order_and_the_talker_are_the_users() -> None:
    data = nmea.epoch(report(), 0, ("ZDA", "GGA", "PUNAV"), "IN")
    assert [line.split(b",")[0] for line in data.splitlines()] == [b"$INZDA", b"$INGGA", b"$PUNAV"]
