"""The emulated array against root finding, plain geometry and statistics."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from gateway.emulator.acoustics import measure
from gateway.emulator.trajectory import Trajectory
from gateway.nav import earth
from tests.gateway.emulated import demo_data, make, quiet_usbl, track

LEVER = np.array([0.5, -0.2, 0.8])
STILL = {"speed_m_s": 0.0, "sway": {}, "ramp_s": 0.0, "course_deg": 0.0}


def fixes(data, **usbl):
    data = demo_data() | data
    data["devices"] = {"imu0": data["devices"]["imu0"], "usbl0": quiet_usbl(**usbl)}
    scenario = make(data)
    trajectory = Trajectory(scenario.trajectory, scenario.duration_s)
    return scenario, trajectory, measure(scenario, "usbl0", scenario.devices["usbl0"], trajectory)


def place(lat_deg, lon_deg, height_m):
    return earth.lla_to_ecef(np.deg2rad(lat_deg), np.deg2rad(lon_deg), height_m)


def beacon_at(north, east, down):
    """A beacon at an offset from the tracks' origin."""
    lat, lon = np.deg2rad([-33.0, -72.0])
    r_e = earth.lla_to_ecef(lat, lon, -20.0) + earth.C_en(lat, lon) @ np.array([north, east, down])
    lat, lon, h = earth.ecef_to_lla(r_e)
    return {
        "lat_deg": float(np.rad2deg(lat)),
        "lon_deg": float(np.rad2deg(lon)),
        "height_m": float(h),
    }


@pytest.mark.parametrize("turnaround_ms", [0.0, 40.0])
def test_sound_goes_there_and_back_while_the_array_moves(turnaround_ms):
    beacon = beacon_at(900.0, 500.0, 300.0) | {"turnaround_ms": turnaround_ms}
    data = {"trajectory": track("circle"), "beacons": {"1": beacon}, "duration_s": 100.0}
    _, trajectory, found = fixes(data, lever_arm_m=LEVER.tolist())
    b_e = place(beacon["lat_deg"], beacon["lon_deg"], beacon["height_m"])

    def distance(t):
        pose = trajectory.pose(np.array([t]))
        return np.linalg.norm(pose.r_e[0] + pose.C_eb[0] @ LEVER - b_e)

    for k in range(0, len(found.t_tx), 7):
        t_tx = found.t_tx[k]
        t_reply = t_tx + distance(t_tx) / 1500.0 + turnaround_ms / 1e3
        t_rx = brentq(lambda t, t0=t_reply: t0 + distance(t) / 1500.0 - t, t_reply, t_reply + 3.0)
        assert found.t_rx[k] == pytest.approx(t_rx, abs=1e-11)
        mean = 0.5 * (distance(t_tx) + distance(t_rx))
        assert found.slant_range[k] == pytest.approx(mean, abs=1e-8)
    assert np.ptp(found.slant_range) > 100.0


def test_one_way_range_is_from_the_beacons_own_ping():
    beacon = beacon_at(900.0, 500.0, 300.0) | {"travel": "one_way"}
    data = {"trajectory": track("circle"), "beacons": {"1": beacon}, "duration_s": 20.0}
    _, trajectory, found = fixes(data, lever_arm_m=[0, 0, 0])
    b_e = place(beacon["lat_deg"], beacon["lon_deg"], beacon["height_m"])
    distance = np.linalg.norm(trajectory.pose(found.t_rx).r_e - b_e, axis=1)
    np.testing.assert_allclose(found.slant_range, distance, atol=1e-8)
    np.testing.assert_allclose(found.t_rx - found.t_tx, distance / 1500.0, atol=1e-11)


@pytest.mark.parametrize(
    ("offset", "mounting_deg", "bearing_deg", "elevation_deg"),
    [
        ((100, 0, 100), (0, 0, 0), 0.0, -45.0),
        ((0, 100, 100), (0, 0, 0), 90.0, -45.0),
        ((0, -100, -100), (0, 0, 0), -90.0, 45.0),
        ((0, 100, 0), (0, 0, 30), 60.0, 0.0),
        ((100, 0, 0), (0, 10, 0), 0.0, -10.0),
        ((0, 100, 0), (10, 0, 0), 90.0, 10.0),
    ],
)
def test_angles_in_words(offset, mounting_deg, bearing_deg, elevation_deg):
    """A still vehicle heading north; mounting turns the array, not the world."""
    data = {"trajectory": track("line", **STILL), "beacons": {"1": beacon_at(*offset)}}
    data["duration_s"] = 5.0
    _, _, found = fixes(data, lever_arm_m=[0, 0, 0], mounting_deg=list(mounting_deg))
    assert np.rad2deg(found.bearing[0]) == pytest.approx(bearing_deg, abs=1e-9)
    assert np.rad2deg(found.elevation[0]) == pytest.approx(elevation_deg, abs=1e-9)
    assert found.slant_range[0] == pytest.approx(np.linalg.norm(offset), abs=1e-8)


def test_constant_errors_are_added_as_defined():
    """C_bu = Exp(theta) C_bu_nominal; angles plus offsets; range times 1 + scale."""
    offset = np.array([60.0, -40.0, 90.0])
    theta = np.array([1.0, -2.0, 1.5])
    errors = {
        "mounting_deg": theta.tolist(),
        "bearing_deg": 0.7,
        "elevation_deg": -0.3,
        "range_scale": 0.004,
    }
    data = {"trajectory": track("line", **STILL), "beacons": {"1": beacon_at(*offset)}}
    data["duration_s"] = 5.0
    _, _, found = fixes(data, lever_arm_m=LEVER.tolist(), mounting_deg=[3, -2, 40], errors=errors)
    nominal = Rotation.from_euler("ZYX", [40, -2, 3], degrees=True)
    true = Rotation.from_rotvec(theta, degrees=True) * nominal
    x, y, z = true.inv().apply(offset - LEVER)
    assert np.rad2deg(found.bearing[0]) == pytest.approx(np.rad2deg(np.arctan2(y, x)) + 0.7)
    elevation = np.rad2deg(np.arctan2(-z, np.hypot(x, y))) - 0.3
    assert np.rad2deg(found.elevation[0]) == pytest.approx(elevation)
    assert found.slant_range[0] == pytest.approx(1.004 * np.linalg.norm(offset - LEVER))


def test_the_instrument_believes_its_own_sound_speed():
    data = {"trajectory": track("line", **STILL), "beacons": {"1": beacon_at(300, 0, 400)}}
    data |= {"duration_s": 5.0, "sound_speed_m_s": 1500.0, "true_sound_speed_m_s": 1485.0}
    _, _, found = fixes(data, lever_arm_m=[0, 0, 0])
    assert found.slant_range[0] == pytest.approx(500.0 * 1500.0 / 1485.0)


def test_beacons_are_asked_in_turn():
    beacons = {name: beacon_at(100, 0, z) for name, z in [("1", 50), ("2", 60), ("7", 70)]}
    data = {"trajectory": track("circle"), "beacons": beacons, "duration_s": 13.0}
    _, _, found = fixes(data)
    assert found.beacon == ["1", "2", "7", "1", "2", "7", "1"]
    np.testing.assert_allclose(np.diff(found.t_tx), 2.0)


def test_noise_outliers_and_silence_have_their_sizes():
    data = {"trajectory": track("circle"), "beacons": {"1": beacon_at(0, 0, 80)}}
    data |= {"duration_s": 4000.0, "seed": 11}
    noise = {"bearing_deg": 0.5, "elevation_deg": 0.3, "range_m": 0.4}
    outliers = {"probability": 0.1, "extra_range_m": 30.0, "angle_deg": 20.0}
    _, _, exact = fixes(data, period_s=1.0)
    _, _, noisy = fixes(data, period_s=1.0, noise=noise, outliers=outliers, missed_probability=0.2)
    n = len(exact.t_tx)
    assert n == 4000
    assert len(noisy.t_tx) == pytest.approx(0.8 * n, abs=4 * np.sqrt(0.16 * n))
    same = np.isin(exact.t_tx, noisy.t_tx)
    d_range = noisy.slant_range - exact.slant_range[same]
    d_bearing = np.rad2deg(noisy.bearing - exact.bearing[same])
    d_elevation = np.rad2deg(noisy.elevation - exact.elevation[same])
    good = ~noisy.outlier
    assert d_range[good].std() == pytest.approx(0.4, rel=0.06)
    assert ((d_bearing[good] + 180) % 360 - 180).std() == pytest.approx(0.5, rel=0.06)
    assert d_elevation[good].std() == pytest.approx(0.3, rel=0.06)
    assert noisy.outlier.mean() == pytest.approx(0.1, abs=0.02)
    assert d_range[noisy.outlier].min() > -2.0, "an echo comes late, never early"
    assert d_range[noisy.outlier].mean() == pytest.approx(30.0, rel=0.25)
    assert np.all(np.abs(noisy.elevation) <= np.pi / 2)
    assert np.all(np.abs(noisy.bearing) <= np.pi)


def test_constants_drawn_from_the_prior_have_its_size():
    drawn = []
    for seed in range(150):
        data = {"trajectory": track("line", **STILL), "beacons": {"1": beacon_at(100, 0, 0)}}
        data |= {"duration_s": 1.0, "seed": seed}
        _, _, found = fixes(
            data, lever_arm_m=[0, 0, 0], prior={"bearing_deg": 0.5, "range_scale": 0.01}
        )
        drawn.append([np.rad2deg(found.bearing[0]) / 0.5, (found.slant_range[0] / 100 - 1) / 0.01])
    assert np.std(drawn, axis=0) == pytest.approx([1.0, 1.0], abs=0.18)


def test_nothing_is_heard_from_beyond_the_range():
    data = {"trajectory": track("line", **STILL), "beacons": {"1": beacon_at(900, 0, 0)}}
    _, _, found = fixes(data | {"duration_s": 9.0}, max_range_m=800.0)
    assert len(found.t_tx) == 0
