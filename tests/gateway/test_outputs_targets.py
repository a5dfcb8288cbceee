"""What is said of targets: read back by somebody else's parser, and against plain geometry."""

import math

import msgspec
import numpy as np
import pynmeagps
import pytest

from gateway.config import Target
from gateway.modes import Mode
from gateway.nav import earth
from gateway.outputs import nmea
from gateway.outputs.following import target_report
from gateway.outputs.nmea_targets import as_vessel, write
from gateway.outputs.schema import NavReport, TargetReport
from gateway.targets import Followed, TrackedPlace
from tests.gateway.reports import NAV

replace = msgspec.structs.replace
OWN = replace(NAV, lat_deg=60.0, lon_deg=5.0, height_m=0.0, vn_m_s=2.0, ve_m_s=0.0)


def report(
    north_m: float, east_m: float, age_s: float = 1.0, nav: NavReport = OWN, **changes: object
) -> TargetReport:
    """Of something 50 m below a place so far from our own, at 1 m/s to the east."""
    lat, lon = np.radians(60.0), np.radians(5.0)
    r_e = earth.lla_to_ecef(lat, lon, 0.0) + earth.C_en(lat, lon) @ [north_m, east_m, 50.0]
    P = np.diag([4.0, 1.0, 0.25, 0.04, 0.04, 0.04])
    place = TrackedPlace(0, *map(float, earth.ecef_to_lla(r_e)), (0.0, 1.0, 0.1), P, age_s)
    followed = Followed(2, "7", Target(name="rov", max_age_s=30.0), place)
    return replace(target_report(followed, nav), **changes)


def test_a_report_tells_place_sigmas_and_how_it_lies_from_us() -> None:
    said = report(300.0, 400.0)
    assert said.range_m == pytest.approx(500.0, rel=1e-4)
    assert said.bearing_deg == pytest.approx(math.degrees(math.atan2(400.0, 300.0)), abs=5e-3)
    assert said.height_m == pytest.approx(-50.0, abs=0.05)
    assert (said.sd_n_m, said.sd_e_m, said.sd_d_m) == (2.0, 1.0, 0.5)
    assert (said.ellipse_major_m, said.ellipse_minor_m, said.ellipse_deg) == (2.0, 1.0, 0.0)
    assert (said.number, said.name, said.beacon) == (2, "rov", "7")


@pytest.mark.parametrize(("age_s", "state"), [(9.0, "tracked"), (11.0, "coasting"), (31.0, "lost")])
def test_what_is_not_seen_is_said(age_s: float, state: str) -> None:
    said = report(300.0, 400.0, age_s)
    assert said.state == state
    line = pynmeagps.NMEAReader.parse(write(said, OWN, ["TLL"], "RA"))
    assert line.status == ("L" if state == "lost" else "T")
    vessel = as_vessel(said, OWN)
    modes = {"tracked": Mode.AIDED, "coasting": Mode.DEAD_RECKONING}
    assert (None if vessel is None else vessel.mode) == modes.get(state)


@pytest.mark.parametrize(
    ("own", "state", "claimed"),
    [
        (Mode.AIDED, "tracked", Mode.AIDED),
        (Mode.DEAD_RECKONING, "tracked", Mode.DEAD_RECKONING),
        (Mode.ALIGNING, "lost", None),
        (Mode.FAULT, "lost", None),
    ],
)
def test_a_target_claims_no_more_than_we_do(own: Mode, state: str, claimed: Mode | None) -> None:
    """Its place is told from ours."""
    nav = replace(OWN, mode=own)
    said = report(300.0, 400.0, nav=nav)
    assert said.state == state
    vessel = as_vessel(said, nav)
    assert (None if vessel is None else vessel.mode) == claimed


def test_sentences_are_what_a_plotter_reads() -> None:
    said = report(1852.0, 0.0)
    data = write(said, OWN, ["GGA", "TLL", "TTM"], "RA").splitlines(keepends=True)
    assert all(len(line) <= 82 for line in data)
    tll, ttm = (pynmeagps.NMEAReader.parse(line) for line in data)
    assert (tll.msgID, tll.targetnum, tll.targetname) == ("TLL", 2, "rov")
    assert (tll.targetlat, tll.targetlon) == pytest.approx((said.lat_deg, said.lon_deg), abs=2e-6)
    assert (ttm.targetnum, ttm.targetname, ttm.speedu) == (2, "rov", "N")
    assert ttm.targetdist == pytest.approx(1.0, abs=1e-3)
    assert ttm.targetbearing == pytest.approx(0.0, abs=0.05) or ttm.targetbearing == pytest.approx(
        360.0, abs=0.05
    )
    assert ttm.targetspeed == pytest.approx(1.94, abs=0.06)
    assert ttm.targetcourse == pytest.approx(90.0)
    # We go north at 2 m/s, it goes east at 1 m/s: nearest when 0.8 of the way is made good.
    closing = np.array([-2.0, 1.0])
    t_s = -np.array([1852.0, 0.0]) @ closing / (closing @ closing)
    least = np.linalg.norm(np.array([1852.0, 0.0]) + t_s * closing)
    assert pytest.approx(least / 1852.0, abs=1e-3) == ttm.closestapproach
    assert pytest.approx(t_s / 60.0, abs=0.06) == ttm.timetoCPA


def test_as_a_vessel_it_has_place_course_and_speed() -> None:
    said = report(300.0, 400.0)
    vessel = as_vessel(said, OWN)
    assert vessel is not None
    lines = nmea.epoch(vessel, vessel.utc_ns, ["GGA", "GLL", "RMC", "VTG", "GST"])
    gga, gll, rmc, vtg, gst = map(pynmeagps.NMEAReader.parse, lines.splitlines(keepends=True))
    assert (gga.lat, gll.lon) == pytest.approx((said.lat_deg, said.lon_deg), abs=2e-7)
    assert (gga.quality, rmc.status) == (1, "A")
    assert rmc.spd == pytest.approx(1.94, abs=0.01)
    assert vtg.cogt == pytest.approx(90.0)
    assert gst.stdLat == pytest.approx(2.0)
