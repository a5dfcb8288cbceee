"""From the words of a configuration to the first state, and from a state back to words."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gateway.fusion import initial
from gateway.fusion.errors import FAMILY
from gateway.fusion.report import calibration, solution
from gateway.fusion.state import ATT, BA, BG, POS, VEL
from gateway.modes import Mode
from gateway.nav import earth
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import configuration

SIGMA = {"position_m": [5, 3, 1], "velocity_m_s": 0.2, "attitude_deg": [0.02, 0.04, 1.5]}
INITIAL = {
    "lat_deg": -33.0,
    "lon_deg": 151.0,
    "height_m": -20.0,
    "velocity_ned_m_s": [3.0, -1.0, 0.2],
    "attitude_deg": [4.0, -20.0, 250.0],
    "sigma": SIGMA,
}


def config(**blocks):
    return configuration(make(demo_data()), **({"initial": INITIAL} | blocks))


def said(state):
    return solution(state, 1, Mode.ALIGNING, None, 0, 0)


def test_the_first_solution_says_what_was_configured():
    nav = said(initial.initial_state(config()))
    np.testing.assert_allclose(np.degrees([nav.lat, nav.lon]), (-33.0, 151.0), atol=1e-12)
    assert nav.h == pytest.approx(-20.0, abs=1e-8)
    np.testing.assert_allclose(nav.v_eb_n, INITIAL["velocity_ned_m_s"], atol=1e-14)
    angles = np.degrees([nav.roll, nav.pitch, nav.heading])
    np.testing.assert_allclose(angles, INITIAL["attitude_deg"], atol=1e-12)
    np.testing.assert_allclose(nav.sd_position, SIGMA["position_m"], rtol=1e-12)
    np.testing.assert_allclose(nav.sd_velocity, [0.2] * 3, rtol=1e-12)
    np.testing.assert_allclose(np.degrees(nav.sd_attitude), SIGMA["attitude_deg"], rtol=1e-9)
    assert nav.cov_ne == pytest.approx(0.0, abs=1e-12)


def test_the_heading_sigma_lies_about_the_vertical():
    """Not about an Earth-fixed axis: the ship is level, the Earth's axes are not."""
    level = INITIAL | {"attitude_deg": [0.0, 0.0, 250.0]}
    state = initial.initial_state(config(initial=level))
    C = earth.C_en(np.radians(-33.0), np.radians(151.0))
    P_n = C.T @ state.P[ATT, ATT] @ C
    turn = Rotation.from_euler("z", 250.0, degrees=True).as_matrix()
    expected = turn @ np.diag(np.radians(SIGMA["attitude_deg"]) ** 2) @ turn.T
    np.testing.assert_allclose(P_n, expected, atol=1e-15)


def test_the_attitude_is_the_bodys():
    state = initial.initial_state(config())
    C_nb = Rotation.from_euler("ZYX", [250.0, -20.0, 4.0], degrees=True).as_matrix()
    C_en = earth.C_en(np.radians(-33.0), np.radians(151.0))
    np.testing.assert_allclose(state.C_eb, C_en @ C_nb, atol=1e-14)
    np.testing.assert_array_equal(state.chain, state.C_eb)


def test_sigmas_of_the_biases_are_the_imus():
    state = initial.initial_state(config())
    sd = np.sqrt(state.P.diagonal())
    np.testing.assert_allclose(np.degrees(sd[BG]) * 3600.0, 0.02, rtol=1e-12)
    np.testing.assert_allclose(sd[BA] / 9.80665e-6, 50.0, rtol=1e-12)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_reported_sigmas_are_first_order_in_euler_angles(seed):
    """The spread of roll, pitch and heading over small drawn errors, against the formula."""
    rng = np.random.default_rng(seed)
    state = initial.initial_state(config())
    lat, lon, h = rng.uniform(-1.4, 1.4), rng.uniform(-3.0, 3.0), 0.0
    state.r_e[:] = earth.lla_to_ecef(lat, lon, h)
    euler = rng.uniform(-1.2, 1.2, 3)
    C_en = earth.C_en(lat, lon)
    state.C_eb[:] = C_en @ Rotation.from_euler("ZYX", euler[::-1]).as_matrix()
    L = rng.normal(0.0, 1.0, (3, 3))
    state.P[ATT, ATT] = 1e-8 * L @ L.T
    nav, columns = said(state), []
    for i in range(3):
        xi = np.zeros(len(state.P))
        xi[i] = 1e-5
        moved = FAMILY["additive"].boxplus(state, xi, state.r_e)
        turned = (C_en.T @ moved.C_eb, C_en.T @ state.C_eb)
        new, old = (Rotation.from_matrix(C).as_euler("ZYX")[::-1] for C in turned)
        columns.append((new - old) / 1e-5)
    J = np.column_stack(columns)
    spread = np.sqrt((J @ state.P[ATT, ATT] @ J.T).diagonal())
    np.testing.assert_allclose(nav.sd_attitude, spread, rtol=1e-3)
    assert 0.0 <= nav.heading < 2.0 * np.pi


def test_the_error_ellipse_is_turned_into_north_and_east():
    state = initial.initial_state(config())
    C = earth.C_en(np.radians(-33.0), np.radians(151.0))
    P_n = np.array([[4.0, 1.5, 0.1], [1.5, 9.0, -0.2], [0.1, -0.2, 1.0]])
    state.P[POS, POS], state.P[VEL, VEL] = C @ P_n @ C.T, 0.01 * C @ P_n @ C.T
    nav = said(state)
    np.testing.assert_allclose(nav.sd_position, (2.0, 3.0, 1.0), rtol=1e-12)
    np.testing.assert_allclose(nav.sd_velocity, (0.2, 0.3, 0.1), rtol=1e-12)
    assert nav.cov_ne == pytest.approx(1.5, rel=1e-12)


def test_noise_densities_in_si():
    """Angle random walk in deg/sqrt(h), velocity random walk in ug/sqrt(Hz), wandering biases."""
    noise = {
        "angle_random_walk_deg_sqrt_h": 0.6,
        "gyro_bias_deg_h": 1.0,
        "velocity_random_walk_ug_sqrt_hz": 100.0,
        "accel_bias_ug": 1000.0,
        "gyro_bias_correlation_s": 500.0,
    }
    imu = configuration(make(demo_data())).imu[1]
    block = type(imu.noise)(**noise)
    q = initial.noise_densities(block)
    assert np.sqrt(q[0]) == pytest.approx(np.radians(0.01))
    assert np.sqrt(q[1]) == pytest.approx(9.80665e-4)
    assert q[2] == pytest.approx(2.0 * (np.radians(1.0) / 3600.0) ** 2 / 500.0)
    assert q[3] == 0.0


def test_constants_in_edge_units_and_those_without_prior_left_out():
    state = initial.initial_state(config())
    names = [c.name for c in calibration(state, 1).constants]
    assert names == [
        *(f"gyro_bias_{axis}_deg_h" for axis in "xyz"),
        *(f"accel_bias_{axis}_ug" for axis in "xyz"),
        *(f"mounting_{axis}_deg" for axis in "xyz"),
        "range_scale",
    ]
    xi = np.zeros(len(state.P))
    xi[9:] = [np.radians(1 / 3600)] * 3 + [9.80665e-6] * 3 + [np.radians(1)] * 3 + [0.001]
    moved = FAMILY["additive"].boxplus(state, xi, state.r_e)
    values = [c.value for c in calibration(moved, 1).constants]
    np.testing.assert_allclose(values, [1.0] * 9 + [0.001], rtol=1e-9)
    sigmas = {c.name: c.sigma for c in calibration(state, 1).constants}
    assert sigmas["mounting_y_deg"] == pytest.approx(0.1)
    assert sigmas["range_scale"] == pytest.approx(0.002)
