"""The emulator's motion and IMU against an independent high-order solution of the ODE."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gateway.emulator.routes import lawnmower
from gateway.emulator.sensors import ImuErrorSource, increments
from gateway.emulator.trajectory import Trajectory
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler
from tests.gateway.emulated import PATHS, TRACKS, demo_data, make, track

OMEGA_IE_E = np.array([0.0, 0.0, 7.292115e-5])


def trajectory(kind, duration_s=120.0, **changes):
    scenario = make(demo_data() | {"trajectory": track(kind, **changes), "duration_s": duration_s})
    return Trajectory(scenario.trajectory, duration_s)


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def navigate(truth, t_end):
    """Strapdown as one ODE in Earth-fixed axes, from what a perfect IMU senses."""
    start = truth.pose(np.zeros(1))
    geodetic = truth.geodetic(np.zeros(1))
    r0, C0 = start.r_e[0], start.C_eb[0]
    v0 = earth.C_en(geodetic.lat[0], geodetic.lon[0]) @ geodetic.v_eb_n[0]

    def derivative(t, x):
        C, v, r = x[:9].reshape(3, 3), x[9:12], r0 + x[12:]
        omega, f = (a[0] for a in truth.inertial(np.array([t])))
        lat, lon, h = earth.ecef_to_lla(r)
        g = earth.C_en(lat, lon) @ earth.gravity_n(lat, h)
        dC = C @ skew(omega) - skew(OMEGA_IE_E) @ C
        dv = C @ f + g - 2.0 * np.cross(OMEGA_IE_E, v)
        return np.concatenate([dC.ravel(), dv, v])

    x0 = np.concatenate([C0.ravel(), v0, np.zeros(3)])
    x = solve_ivp(derivative, (0.0, t_end), x0, "DOP853", rtol=1e-12, atol=1e-11, max_step=0.5)
    end = x.y[:, -1]
    return end[:9].reshape(3, 3), end[9:12], r0 + end[12:]


@pytest.mark.parametrize("kind", TRACKS)
def test_what_the_imu_senses_leads_along_the_truth(kind):
    truth = trajectory(kind)
    t_end = np.array([40.0])
    C, v, r = navigate(truth, t_end[0])
    pose, geodetic = truth.pose(t_end), truth.geodetic(t_end)
    v_true = earth.C_en(geodetic.lat[0], geodetic.lon[0]) @ geodetic.v_eb_n[0]
    assert np.linalg.norm(r - pose.r_e[0]) < 1e-6
    assert np.linalg.norm(v - v_true) < 1e-7
    assert np.abs(C - pose.C_eb[0]).max() < 1e-9


@pytest.mark.parametrize("kind", TRACKS)
def test_increments_are_integrals(kind):
    """Three nodes on 5 ms against fifteen on each of ten parts of it."""
    truth, dt, parts = trajectory(kind), 0.005, 10
    nodes, weights = np.polynomial.legendre.leggauss(15)
    ends = np.array([dt, 7.0, 31.415, 59.0])
    for t_end, found in zip(ends, increments(truth, ends, dt), strict=True):
        centres = t_end - dt + (np.arange(parts) + 0.5) * dt / parts
        t = (centres[:, None] + 0.5 * dt / parts * nodes).ravel()
        sensed = np.hstack(truth.inertial(t)).reshape(parts, 15, 6)
        exact = 0.5 * dt / parts * np.einsum("pnk,n->k", sensed, weights)
        assert np.linalg.norm(found - exact) < 1e-12 * np.linalg.norm(exact)


def slope(f, t, h=1e-3):
    """Derivative of a vectorised function of time by five points, to h^4."""
    return (f(t - 2 * h) - 8 * f(t - h) + 8 * f(t + h) - f(t + 2 * h)) / (12 * h)


@pytest.mark.parametrize("kind", PATHS)
def test_rates_and_forces_are_derivatives_of_the_pose(kind):
    """Everywhere, so at no moment does position, velocity or attitude jump, nor their rates."""
    truth = trajectory(kind)
    t = np.arange(0.1, 115.0, 0.0371)
    pose, g = truth.pose(t), truth.geodetic(t)
    v_e = np.einsum("nij,nj->ni", earth.C_en(g.lat, g.lon), g.v_eb_n)
    np.testing.assert_allclose(slope(lambda t: truth.pose(t).r_e, t), v_e, atol=2e-6)
    _, v_point = truth.point(t, (3.0, -2.0, 1.0))
    moved = slope(lambda t: truth.pose(t).r_e + truth.pose(t).C_eb @ [3.0, -2.0, 1.0], t)
    np.testing.assert_allclose(v_point, moved, atol=2e-6)

    def velocity(t):
        return truth.point(t, (0.0, 0.0, 0.0))[1]

    omega_ib_b, f_ib_b = truth.inertial(t)
    g_e = np.einsum("nij,nj->ni", earth.C_en(g.lat, g.lon), earth.gravity_n(g.lat, g.h))
    f_e = slope(velocity, t) + 2.0 * np.cross(OMEGA_IE_E, v_e) - g_e
    np.testing.assert_allclose(f_ib_b, np.einsum("nij,ni->nj", pose.C_eb, f_e), atol=1e-4)
    turning = np.swapaxes(pose.C_eb, -1, -2) @ slope(lambda t: truth.pose(t).C_eb, t)
    omega_eb_b = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=-1)
    omega_ie_b = np.einsum("nij,i->nj", pose.C_eb, OMEGA_IE_E)
    np.testing.assert_allclose(omega_ib_b, omega_eb_b + omega_ie_b, atol=1e-5)


def level(kind, **changes):
    truth = trajectory(kind, sway={}, **changes)
    return lambda t: truth.geodetic(np.array(t, dtype=float))


def test_a_spiral_goes_down_to_its_depth_and_stays_there():
    g = level("spiral")(np.arange(0.0, 120.0))
    assert g.h[0] == pytest.approx(-20.0, abs=1e-4)  # in the plane that touches its centre
    assert np.all(np.diff(g.h) < 1e-7)
    np.testing.assert_allclose(g.h[60:], -35.0, atol=1e-4)
    turn_s = 2 * np.pi * 15.0 / 3.0
    a, b = level("spiral")([15.0, 15.0 + turn_s]).h
    assert a - b == pytest.approx(10.0, abs=1e-3)
    slope = np.rad2deg(np.arctan(10.0 / (2 * np.pi * 15.0)))
    assert np.rad2deg(g.pitch[20]) == pytest.approx(-slope, abs=1e-3)


def test_a_transit_departs_cruises_and_arrives():
    """130 m at 3 m/s with 12 s to reach it and to stop: 43.3 s + 12 s."""
    at = level("transit")
    g = at([0.0, 27.0, 55.4, 110.0])
    np.testing.assert_allclose(g.v_eb_n[[0, 2, 3]], 0.0, atol=1e-9)
    assert np.linalg.norm(g.v_eb_n[1]) == pytest.approx(3.0, abs=1e-6)
    np.testing.assert_allclose(g.h, [-20.0, -30.0, -20.0, -20.0], atol=2e-3)
    place = earth.lla_to_ecef(g.lat, g.lon, g.h)
    assert np.linalg.norm(place[3] - place[0]) == pytest.approx(130.0, abs=1e-6)


def test_waypoints_are_passed_at_their_speeds():
    at = level("waypoints")
    t = np.arange(0.0, 115.0, 0.05)
    g = at(t)
    place = earth.lla_to_ecef(g.lat, g.lon, g.h)
    speed = np.linalg.norm(g.v_eb_n, axis=-1)
    points = PATHS["waypoints"]["points"]
    for k, point in enumerate(points):
        lat, lon = np.deg2rad([point["lat_deg"], point["lon_deg"]])
        away = np.linalg.norm(place - earth.lla_to_ecef(lat, lon, point["height_m"]), axis=-1)
        assert away.min() < (0.05 if k == 0 else 4.0)
        near = int(np.argmin(away[: len(away) if k < len(points) - 1 else None]))
        if 0 < k < len(points) - 1:
            assert speed[near] == pytest.approx(points[k - 1]["speed_m_s"], abs=0.05)
    assert speed[0] == speed[-1] == 0.0
    assert speed.max() == pytest.approx(4.0, abs=1e-6)


def test_at_rest_the_imu_feels_gravity_and_the_turning_earth():
    truth = trajectory("line", speed_m_s=0.0, course_deg=0.0, ramp_s=0.0, sway={})
    omega, f = (a[0] for a in truth.inertial(np.array([5.0])))
    lat = np.deg2rad(-33.0)
    np.testing.assert_allclose(f, [0, 0, -earth.gravity(lat, -20.0)], atol=1e-12)
    np.testing.assert_allclose(
        omega, 7.292115e-5 * np.array([np.cos(lat), 0, -np.sin(lat)]), atol=1e-18
    )


def test_the_circle_is_round_and_its_bow_leads():
    truth = trajectory("circle", sway={})
    t = np.linspace(0.0, 150.0, 301)
    centre = earth.lla_to_ecef(np.deg2rad(-33.0), np.deg2rad(-72.0), -20.0)
    np.testing.assert_allclose(np.linalg.norm(truth.pose(t).r_e - centre, axis=1), 71.4, atol=1e-8)
    g = truth.geodetic(t)
    assert g.heading[0] == pytest.approx(0.0, abs=1e-5)
    ahead = np.arctan2(g.v_eb_n[:, 1], g.v_eb_n[:, 0])
    np.testing.assert_allclose(np.exp(1j * g.heading), np.exp(1j * ahead), atol=1e-4)
    assert g.heading[10] < 0.0, "to port"


def test_a_ramp_starts_from_rest_and_reaches_the_speed():
    truth = trajectory("line", sway={})
    speed = np.linalg.norm(truth.geodetic(np.array([0.0, 10.0, 20.0, 50.0])).v_eb_n, axis=1)
    np.testing.assert_allclose(speed, [0.0, 1.5, 3.0, 3.0], atol=1e-6)


def test_the_lawnmower_mows():
    """Legs of the length asked for, at the spacing asked for, turning first to starboard."""
    route = lawnmower(0.0, leg=100.0, spacing=30.0, length=2000.0)
    s = np.arange(0.0, 2000.0, 0.25)
    r, dr, ddr = route.at(s)
    np.testing.assert_allclose(np.linalg.norm(dr, axis=1), 1.0, atol=1e-5)
    on_leg = np.abs(ddr).max(axis=1) < 1e-4
    columns = np.unique(np.round(r[on_leg, 1] / 30.0, 3))
    np.testing.assert_allclose(columns, np.arange(columns.size), atol=2e-3)
    assert columns.size > 8
    first = on_leg & (np.abs(r[:, 1]) < 0.01)
    assert r[first, 0].min() == pytest.approx(0.0, abs=1.0)
    assert r[first, 0].max() == pytest.approx(100.0, abs=10.0)


def test_white_noise_and_biases_have_the_sigma_of_their_block():
    data = demo_data()["devices"]["imu0"]
    data["noise"] = {
        "angle_random_walk_deg_sqrt_h": 0.006,
        "gyro_bias_deg_h": 1.0,
        "velocity_random_walk_ug_sqrt_hz": 30.0,
        "accel_bias_ug": 100.0,
    }
    model = make(demo_data() | {"devices": {"imu0": data}}).devices["imu0"]
    seconds = 100
    errors = ImuErrorSource(model, 3, "imu0").next(200 * seconds)
    per_second = errors.reshape(seconds, 200, 6).sum(axis=1)
    arw, vrw = np.deg2rad(0.006) / 60.0, 30e-6 * 9.80665
    spread = per_second.std(axis=0, ddof=1) / np.repeat([arw, vrw], 3)
    assert np.all((spread > 0.75) & (spread < 1.25))
    biases = np.array([ImuErrorSource(model, seed, "imu0").bias for seed in range(200)])
    sigma = np.repeat([np.deg2rad(1.0) / 3600.0, 100e-6 * 9.80665], 3)
    assert np.all(np.abs(biases.std(axis=0) / sigma - 1.0) < 0.2)


def test_a_wandering_bias_forgets():
    data = demo_data()["devices"]["imu0"]
    data["rate_hz"] = 1.0
    data["noise"] |= {"gyro_bias_deg_h": 1.0, "gyro_bias_correlation_s": 20.0}
    data["noise"] |= {"angle_random_walk_deg_sqrt_h": 1e-9}
    model = make(demo_data() | {"devices": {"imu0": data}}).devices["imu0"]
    x = ImuErrorSource(model, 3, "imu0").next(20_000)[:, :3]
    sigma = np.deg2rad(1.0) / 3600.0
    np.testing.assert_allclose(x.std(axis=0), sigma, rtol=0.15)
    correlation = np.mean(x[20:] * x[:-20], axis=0) / sigma**2
    np.testing.assert_allclose(correlation, np.exp(-1.0), atol=0.12)


def test_errors_do_not_depend_on_the_block_length():
    model = make(demo_data()).devices["imu0"]
    whole = ImuErrorSource(model, 5, "imu0").next(1000)
    source = ImuErrorSource(model, 5, "imu0")
    np.testing.assert_array_equal(np.vstack([source.next(n) for n in (1, 399, 600)]), whole)


def test_sway_turns_the_body_as_euler_angles_say():
    truth = trajectory("line", speed_m_s=0.0, ramp_s=0.0)
    g = truth.geodetic(np.array([0.0, 1.5]))
    roll = np.deg2rad(5.0 * np.sin(2 * np.pi * 1.5 / 6.0) + np.sin(2 * np.pi * 1.5 / 2.3))
    assert g.roll[1] == pytest.approx(roll, abs=1e-12)
    assert g.pitch[0] == pytest.approx(np.deg2rad(4.0), abs=1e-12)
    C_nb = C_from_euler(g.roll, g.pitch, g.heading)
    C_en = earth.C_en(g.lat, g.lon)
    np.testing.assert_allclose(C_en @ C_nb, truth.pose(np.array([0.0, 1.5])).C_eb, atol=1e-14)
