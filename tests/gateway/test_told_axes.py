"""Fixes in axes that a topside has levelled or turned north: derivatives, and by whose attitude.

North turns with the position, tan(lat) / R_e a metre, which the models leave out.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gateway.fusion import loose, usbl
from gateway.fusion.axes import nominal_axes, told_axes
from gateway.fusion.errors import FAMILY
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.observation import AcousticArray, Loose, Model, Transponder, observe, settled
from gateway.fusion.state import LATENCY, POS, State
from gateway.messages import BeaconPlace, UsblFix
from gateway.nav import earth
from tests.gateway.states import NAMES, ORIGIN, error_map, random_state
from tests.gateway.test_models_jacobians import (
    LATENCY_IN_MEAN,
    LEVER,
    LONG,
    SIGMA,
    case,
    derivative,
    relative_error,
)

R_E = 6.3e6
AXES = ["level", "north"]


def sight_of(c, axes, y=None):
    state = c.state if y is None else y
    measured = np.array([-0.5, 0.3, np.linalg.norm(c.beacon_e - c.state.r_e)])
    return usbl.Sighting(measured, SIGMA, c.beacon_e, c.past(state), axes)


def seen(c, axes):
    """A case whose beacon lies where it has a bearing in the told axes."""
    C_ea = told_axes(c.state, c.geometry.C_bu, axes).C_ea
    range_m = np.linalg.norm(c.beacon_e - c.state.r_e)
    beacon_e = c.state.r_e + range_m * C_ea @ usbl.direction(-0.5, 0.3)
    return replace(c, beacon_e=beacon_e)


MODELS = {
    "tight": lambda c, y, axes: usbl.linearise(y, c.geometry, sight_of(c, axes, y)),
    "loose": lambda c, y, axes: loose.linearise(y, c.geometry, sight_of(c, axes, y), None),
}


@pytest.mark.parametrize("definition", NAMES)
@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("seed", range(2))
def test_every_column_is_the_derivative(definition, axes, name, seed):
    c = case(seed, range_m=150.0)
    c.state.x[LATENCY_IN_MEAN] = 0.0
    c = seen(c, axes)
    z = MODELS[name](c, c.state, axes)
    T = error_map(FAMILY[definition], c.state)
    found = derivative(
        lambda y: MODELS[name](c, y, axes).residual, c.state, FAMILY[definition], LONG
    )
    left_out = (found - z.H @ T) @ np.linalg.inv(T)
    scale = 1.0 if name == "tight" else np.linalg.norm(z.residual) + 150.0
    assert np.abs(left_out[:, POS]).max() < 4.0 * scale / R_E
    found = found - left_out[:, POS] @ T[POS]
    found[:, LATENCY] += left_out[:, POS] @ c.state.v_eb_e
    assert relative_error(z.H @ T, found) < 1e-6


@pytest.mark.parametrize("axes", AXES)
def test_an_array_that_stands_upright_is_not_level(axes):
    c = case(1)
    lat, lon, _ = earth.ecef_to_lla(c.state.r_e)
    up = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    C_bu = c.state.C_eb.T @ earth.C_en(lat, lon) @ up
    c = replace(c, geometry=usbl.ArrayGeometry(LEVER, C_bu))
    z = usbl.linearise(c.state, c.geometry, sight_of(c, axes))
    assert (z is None) is (axes == "level")


def test_north_says_nothing_of_a_heading_seen_from_the_imu():
    """A place by a topside's own attitude: no attitude of ours is in it but by the lever arm."""
    state = random_state(np.random.default_rng(2))
    state.theta[:] = state.lever_b[:] = 0.0
    beacon_e = state.r_e + np.array([50.0, 60.0, -20.0])
    sight = usbl.Sighting(np.array([-0.5, 0.3, 80.0]), SIGMA, beacon_e, None, "north")
    z = usbl.linearise(state, usbl.ArrayGeometry(np.zeros(3), np.eye(3)), sight)
    np.testing.assert_allclose(z.H[:, :3], 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(z.H[:, POS]) == 3


def test_level_says_of_the_attitude_what_a_heading_is():
    """Turning about the vertical turns the bearing; tilting turns nothing, but for the lever."""
    lat, lon = 0.8, 2.2
    C_en = earth.C_en(lat, lon)
    state = State.at(C_en, np.zeros(3), earth.lla_to_ecef(lat, lon, 0.0), np.eye(25))
    beacon_e = state.r_e + C_en @ np.array([80.0, 30.0, 40.0])
    sight = usbl.Sighting(np.array([-0.4, 0.3, 90.0]), SIGMA, beacon_e, None, "level")
    z = usbl.linearise(state, usbl.ArrayGeometry(np.zeros(3), np.eye(3)), sight)
    np.testing.assert_allclose(z.H[:, :3] @ C_en, [[0, 0, 0], [0, 0, -1], [0, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("tilt_deg", [0.0, 0.5])
def test_an_error_of_the_motion_sensor_is_that_of_the_angles(tilt_deg):
    """Against draws: small turns of the level axes, of a beacon 60 degrees down."""
    rng = np.random.default_rng(1)
    at = usbl.direction(-np.radians(60.0), 0.4)
    sd = np.radians([tilt_deg, 0.7])
    turns = rng.normal(size=(40_000, 3)) * [sd[0], sd[0], sd[1]]
    x, y, z = Rotation.from_rotvec(turns).apply(at).T
    drawn = np.cov(np.arctan2(-z, np.hypot(x, y)), np.arctan2(y, x))
    state = random_state(np.random.default_rng(3))
    state.theta[:] = state.lever_b[:] = 0.0
    state.x[LATENCY_IN_MEAN] = 0.0
    geometry = usbl.ArrayGeometry(np.zeros(3), np.eye(3))
    C_ea, _ = nominal_axes(state, geometry.C_bu, "north")
    beacon_e = state.r_e + 100.0 * C_ea @ at
    tiny = np.full(3, 1e-9)
    sight = usbl.Sighting(np.array([-1.0, 0.4, 100.0]), tiny, beacon_e, None, "north", tuple(sd))
    R = usbl.linearise(state, geometry, sight).R[:2, :2]
    scale = np.sqrt(np.outer(R.diagonal() + 1e-12, R.diagonal() + 1e-12))
    np.testing.assert_allclose((R - drawn) / scale, 0.0, atol=0.03)


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("name", MODELS)
def test_noise_is_that_of_an_array_that_is_not_level(axes, name):
    """Against draws: a beacon well below an array that leans by 25 degrees."""
    lat, lon = 0.8, 2.2
    C_eb = earth.C_en(lat, lon) @ Rotation.from_euler("zyx", [0.4, 0.3, 0.3]).as_matrix()
    state = State.at(C_eb, np.zeros(3), earth.lla_to_ecef(lat, lon, 0.0), np.eye(25))
    geometry = usbl.ArrayGeometry(np.zeros(3), np.eye(3))
    C_ea, _ = nominal_axes(state, geometry.C_bu, axes)
    beacon_e = state.r_e + 100.0 * C_ea @ usbl.direction(-np.radians(70.0), 0.4)
    sigma = np.array([0.01, 0.02, 0.1])
    elevation, bearing = usbl.angles(tuple(C_eb.T @ (beacon_e - state.r_e)))
    seen_a = []
    draws = sigma * np.random.default_rng(1).normal(size=(10_000, 3))
    for by_elevation, by_bearing, by_range in draws:
        at_u = usbl.direction(elevation + by_elevation, bearing + by_bearing)
        seen_a.append((100.0 + by_range) * C_ea.T @ C_eb @ at_u)
    told = np.array([[*usbl.angles(tuple(r_a)), np.linalg.norm(r_a)] for r_a in seen_a])
    if name == "loose":
        told = np.array(seen_a) @ (earth.C_en(lat, lon).T @ C_ea).T
    sight = usbl.Sighting(np.array([-np.radians(70.0), 0.4, 100.0]), sigma, beacon_e, None, axes)
    model = usbl.linearise if name == "tight" else loose.linearise
    R = model(state, geometry, sight, *([None] if name == "loose" else [])).R
    drawn = np.cov(told.T)
    scale = np.sqrt(np.outer(drawn.diagonal(), drawn.diagonal()))
    np.testing.assert_allclose(R / scale, drawn / scale, atol=0.06)


def follower(state, loose_=None):
    """A model whose topside goes by us, of an array mounted anyhow, and where its beacon is."""
    C_bu = Rotation.from_euler("zyx", [0.7, -0.1, 0.2]).as_matrix()
    geometry = usbl.ArrayGeometry(LEVER, C_bu)
    beacon_e = state.r_e + state.C_eb @ np.array([60.0, 25.0, 70.0])
    array = AcousticArray(geometry, SIGMA, goes_by_us=True)
    return Model(
        error=FAMILY["additive"],
        q=np.zeros(4),
        gate=0.999,
        sound_speed=1500.0,
        arrays={"usbl0": array},
        beacons={"1": Transponder(beacon_e, 0.0, False)},
        loose=loose_,
    )


@pytest.mark.parametrize("axes", AXES)
def test_what_was_turned_by_us_is_turned_back(axes):
    """Angles in the array's axes, and the same told by our own attitude: one measurement."""
    state = random_state(np.random.default_rng(4))
    model = follower(state)
    C_bu = model.arrays["usbl0"].geometry.C_bu
    C_na, _ = nominal_axes(state, C_bu, axes)
    r_u = usbl.direction(-0.6, 0.5)
    told = usbl.angles(tuple(C_na.T @ state.C_eb @ C_bu @ r_u))
    state.x[LATENCY_IN_MEAN] = 0.0
    raw = observe(model, state, UsblFix(0, "usbl0", "1", -0.6, 0.5, 97.0), None)
    turned = settled(model, state, UsblFix(0, "usbl0", "1", *told, 97.0, axes))
    ours = observe(model, state, turned, None)
    np.testing.assert_allclose(ours.residual, raw.residual, atol=1e-12)
    np.testing.assert_array_equal(ours.H, raw.H)
    part = UsblFix(0, "usbl0", "1", None, told[1], 97.0, axes)
    assert settled(model, state, part) == "geometry"


def test_a_beacons_place_told_by_us_is_ours_relative_to_it():
    """It lies off the chart by what our position is wrong by, to the other side."""
    state = random_state(np.random.default_rng(5))
    state.theta[:] = state.angle_offsets[:] = state.lever_b[:] = 0.0
    state.x[LATENCY_IN_MEAN] = 0.0
    state.x[LATENCY_IN_MEAN - 4] = 0.0
    model = follower(state)
    b_e = model.beacons["1"].r_e
    lat, lon, _ = earth.ecef_to_lla(b_e)
    off_n = np.array([1.5, -2.5, 0.0])
    off_lat, off_lon, _ = earth.ecef_to_lla(b_e + earth.C_en(lat, lon) @ off_n)
    fix = BeaconPlace(0, "usbl0", "1", float(off_lat), float(off_lon))
    z = observe(model, state, settled(model, state, fix), None)
    assert z.names == ("north_m", "east_m")
    np.testing.assert_allclose(z.residual, off_n[:2], atol=1e-5)
    np.testing.assert_allclose(z.H[:, POS], earth.C_en(lat, lon).T[:2], atol=1e-9)


@pytest.mark.parametrize("words", ["place", "north"])
def test_what_moves_with_the_estimate_is_used_once(words):
    """Where the heading is unknown others are used in parts, each of which sees the fix anew."""
    lat, lon = 0.8, 2.2
    C_en = earth.C_en(lat, lon)
    P = np.diag(np.repeat([1e-6, 1e-4, 25.0, 1e-12, 1e-12], 3))
    P[:3, :3] = C_en @ np.diag([1e-6, 1e-6, np.radians(8.0) ** 2]) @ C_en.T
    state = State.at(C_en, np.zeros(3), earth.lla_to_ecef(lat, lon, -20.0), P)
    model = replace(follower(state), loose=Loose(None))
    b_e = model.beacons["1"].r_e
    true_n = 4.0 * np.array([60.0, 25.0, 0.0]) / 65.0  # towards the beacon: a heading cannot be it
    seen_e = b_e - state.r_e - C_en @ (true_n + LEVER)
    if words == "place":
        told = earth.ecef_to_lla(b_e - C_en @ true_n)[:2]
        fix = BeaconPlace(10**9, "usbl0", "1", float(told[0]), float(told[1]))
    else:
        polar = (*usbl.angles(tuple(C_en.T @ seen_e)), float(np.linalg.norm(seen_e)))
        fix = UsblFix(10**9, "usbl0", "1", *polar, "north")
    engine = Filter(model, Memory(state.copy()))
    assert not engine.knows_heading()
    before = np.linalg.norm(C_en.T @ (engine.memory.state.r_e - state.r_e) - true_n)
    assert engine.apply(fix, None).accepted
    after = np.linalg.norm((C_en.T @ (engine.memory.state.r_e - state.r_e) - true_n)[:2])
    assert after < 0.25 * before


def test_a_place_by_a_topside_of_its_own_says_nothing_of_us():
    state = random_state(np.random.default_rng(6))
    model = follower(state)
    array = model.arrays["usbl0"]
    model.arrays["usbl0"] = replace(array, goes_by_us=False)
    fix = BeaconPlace(0, "usbl0", "1", 0.1, 0.2)
    assert settled(model, state, fix) is fix
    assert observe(model, state, fix, None) == "place"
    assert np.linalg.norm(state.r_e - ORIGIN) < 2e3
