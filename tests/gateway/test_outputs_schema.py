"""Edge units, against numpy and by hand."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.messages import Calibration, Component, Constant, Innovation
from gateway.modes import Mode
from gateway.outputs import schema
from tests.gateway.solutions import solution

OFFSET_NS = 1_700_000_000_123_456_789


def test_a_solution_comes_out_in_degrees_and_unix_time() -> None:
    report = schema.nav_report(solution(), OFFSET_NS)
    assert report.utc_ns == 1_700_000_005_123_456_790
    assert report.t_s == pytest.approx(1_700_000_005.123456790, abs=2.5e-7)
    assert (report.lat_deg, report.lon_deg) == pytest.approx((39.8, 116.2), abs=1e-12)
    assert (report.height_m, report.vn_m_s, report.ve_m_s, report.vd_m_s) == (-50.25, 3, -0.5, 0.25)
    attitude = (report.roll_deg, report.pitch_deg, report.heading_deg)
    assert attitude == pytest.approx((-1.5, 2.5, 350.0))
    sigmas = (report.sd_roll_deg, report.sd_pitch_deg, report.sd_heading_deg)
    assert sigmas == pytest.approx((0.1, 0.2, 0.3))
    assert (report.sd_n_m, report.sd_e_m, report.sd_d_m) == (0.3, 0.4, 0.5)
    assert (report.sd_vn_m_s, report.sd_ve_m_s, report.sd_vd_m_s) == (0.01, 0.02, 0.03)
    assert (report.mode, report.fix_age_s) == (Mode.AIDED, 1.5)
    assert (report.fixes_used, report.fixes_rejected) == (12, 3)


def test_the_json_has_the_documented_keys_and_plain_values() -> None:
    data = msgspec.json.decode(msgspec.json.encode(schema.nav_report(solution(), OFFSET_NS)))
    assert data["mode"] == "aided"
    assert data["utc_ns"] == 1_700_000_005_123_456_790
    assert data["lat_deg"] == pytest.approx(39.8)


@pytest.mark.parametrize(
    ("lon_deg", "expected"),
    [(180.0, -180.0), (-180.0, -180.0), (200.5, -159.5), (359.0, -1.0), (-179.5, -179.5)],
)
def test_longitude_is_signed(lon_deg: float, expected: float) -> None:
    report = schema.nav_report(solution(lon=math.radians(lon_deg)), OFFSET_NS)
    assert report.lon_deg == pytest.approx(expected, abs=1e-9)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_stay_inside(angle: float) -> None:
    assert 0.0 <= schema.wrap(angle) < 360.0
    assert -180.0 <= schema.wrap_180(angle) < 180.0
    assert math.cos(math.radians(schema.wrap_180(angle) - angle)) == pytest.approx(1.0)


@given(st.floats(0.01, 100), st.floats(0.01, 100), st.floats(-0.999, 0.999))
def test_the_ellipse_is_the_eigenvectors_of_the_covariance(
    sd_n: float, sd_e: float, correlation: float
) -> None:
    cov = correlation * sd_n * sd_e
    P = np.array([[sd_n**2, cov], [cov, sd_e**2]])
    major, minor, azimuth = schema.error_ellipse(sd_n, sd_e, cov)
    values = np.linalg.eigvalsh(P)
    assert (minor**2, major**2) == pytest.approx(tuple(values), rel=1e-9, abs=1e-9 * major**2)
    axis = np.array([math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth))])
    assert axis @ P @ axis == pytest.approx(values[1])
    assert 0.0 <= azimuth < 180.0


def test_an_innovation_keeps_its_names_values_and_verdict() -> None:
    innovation = Innovation(
        t_ns=0,
        device="usbl0",
        beacon="1",
        components=(Component("elevation_deg", 1.5, 0.5), Component("range_m", 0.5, 0.2)),
        nis=9.25,
        accepted=False,
        reason="gate",
    )
    report = schema.innovation_report(innovation, OFFSET_NS)
    assert report.utc_ns == OFFSET_NS
    names = [c.name for c in report.components]
    assert names == ["elevation_deg", "range_m"]
    assert [c.value for c in report.components] == [1.5, 0.5]
    assert (report.device, report.beacon, report.nis) == ("usbl0", "1", 9.25)
    assert (report.accepted, report.reason) == (False, "gate")


def test_constants_keep_their_names_and_order() -> None:
    constants = (Constant("range_scale", 0.004, 1e-4), Constant("bearing_deg", 0.5, 0.1))
    report = schema.calibration_report(Calibration(0, constants), OFFSET_NS)
    assert list(report.constants) == ["range_scale", "bearing_deg"]
    assert report.constants["bearing_deg"].value == 0.5
