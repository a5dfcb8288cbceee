"""A fix from nearly overhead, where angles are anything but linear over what is uncertain."""

from functools import cache

import msgspec
import numpy as np
import pytest
import scipy.stats

from gateway.config import Config
from gateway.emulator import twin
from gateway.fusion import initial
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.state import POS, State
from gateway.fusion.usbl import angles
from gateway.messages import UsblFix
from gateway.nav.earth import C_en, ecef_to_lla
from tests.gateway.emulated import demo_data, make

SIGMA_M = np.array([5.0, 5.0, 1.0])
DEPTH_M = 50.0
DRAWS = 60


@cache
def model(error):
    """The demo's array, at the IMU, without constant errors; a one-way beacon."""
    data = demo_data()
    data["devices"]["usbl0"] |= {"prior": {}, "lever_arm_m": [0, 0, 0]}
    data["beacons"]["1"]["travel"] = "one_way"
    config = msgspec.convert(twin.gateway_config(make(data)), Config)
    block = msgspec.structs.replace(config.filter, error=error)
    config = msgspec.structs.replace(config, filter=block)
    return initial.model(config), initial.initial_state(config)


def spun(b_e, origin_e):
    """Right-invariant error (9,) of the whole pose turned about the vertical through a beacon."""
    lat, lon, _ = ecef_to_lla(b_e)
    down = C_en(lat, lon)[:, 2]
    return np.concatenate([down, np.zeros(3), np.cross(b_e - origin_e, down)])


def squared_error(error, rng, off_m, use, sigma_m=SIGMA_M):
    """Normalised square of the position's error after one fix from `off_m` beside the beacon."""
    known, fresh = model(error)
    b_e, array = known.beacons["1"].r_e, known.arrays["usbl0"]
    lat, lon, _ = ecef_to_lla(b_e)
    C_eb = C_en(lat, lon)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    beside = np.array([off_m * np.cos(azimuth), off_m * np.sin(azimuth), -DEPTH_M])
    r_true = b_e + C_eb @ beside
    wrong = C_eb @ (sigma_m * rng.standard_normal(3))
    P = np.diag(np.full(len(fresh.P), 1e-12))
    P[POS, POS] = C_eb @ np.diag(sigma_m**2) @ C_eb.T
    state = State.at(C_eb, np.zeros(3), r_true + wrong, P, fresh.columns)
    r_u = array.geometry.C_bu.T @ -beside
    elevation, bearing = angles(tuple(r_u)) + array.sigma[:2] * rng.standard_normal(2)
    slant = np.linalg.norm(r_u) + array.sigma[2] * rng.standard_normal()
    filter_ = Filter(known, Memory(state))
    use(filter_, UsblFix(0, "usbl0", "1", elevation, bearing, float(slant)))
    e = filter_.memory.state.r_e - r_true
    return float(e @ np.linalg.solve(filter_.memory.state.P[POS, POS], e))


def looked_at_again(filter_, fix):
    filter_._update_along(filter_._observe(fix, None), fix, None)


def looked_at_once(filter_, fix):
    filter_._update(filter_._observe(fix, None), filter_.model.error)


@pytest.mark.parametrize("error", ["right_invariant", "left_invariant", "additive"])
@pytest.mark.parametrize("off_m", [10.0, 20.0, 80.0])
def test_the_claim_holds_where_the_fix_bends(error, off_m):
    """Its mean is chi-squared; of one look at the fix it is beyond any bound."""
    total = {}
    for use in (looked_at_again, looked_at_once):
        rng = np.random.default_rng(3)
        total[use] = sum(squared_error(error, rng, off_m, use) for _ in range(DRAWS))
    low, high = scipy.stats.chi2.ppf([0.001, 0.999], 3 * DRAWS)
    assert low < total[looked_at_again] < high
    if off_m < 50.0:
        assert total[looked_at_once] > 10.0 * high


@pytest.mark.parametrize("error", ["right_invariant", "left_invariant", "additive"])
def test_the_claim_holds_where_the_place_is_lost_and_the_heading_is_not(error):
    """Ten minutes without a fix: kilometres off, and the first one is 60 m from its beacon."""
    rng, sigma_m = np.random.default_rng(5), np.array([2500.0, 2500.0, 2000.0])

    def applied(filter_, fix):
        assert filter_.knows_heading()
        assert filter_.apply(fix, None).accepted

    total = sum(squared_error(error, rng, 60.0, applied, sigma_m) for _ in range(DRAWS))
    low, high = scipy.stats.chi2.ppf([0.001, 0.999], 3 * DRAWS)
    assert low < total < high


def test_a_fix_that_bends_says_nothing_of_the_heading_about_its_beacon():
    """The pose turned about the beacon gives the same fix, wherever it is looked at from."""
    known, fresh = model("right_invariant")
    b_e, array = known.beacons["1"].r_e, known.arrays["usbl0"]
    lat, lon, _ = ecef_to_lla(b_e)
    C_eb = C_en(lat, lon)
    r_e = b_e + C_eb @ np.array([-60.0, 8.0, -DEPTH_M])
    P = np.diag(np.full(len(fresh.P), 1e-12))
    P[:9, :9] = np.diag(np.repeat([np.radians(2.0), 0.1, 5.0], 3) ** 2)
    r_u = array.geometry.C_bu.T @ (C_eb.T @ (b_e - r_e) + [9.0, 12.0, 2.0])
    fix = UsblFix(0, "usbl0", "1", *angles(tuple(r_u)), float(np.linalg.norm(r_u)))

    def used(use):
        filter_ = Filter(known, Memory(State.at(C_eb, np.zeros(3), r_e, P, fresh.columns)))
        use(filter_, fix)
        state, origin_e = filter_.memory.state, filter_.origin_e
        turn = known.error.to_additive(state, origin_e) @ spun(b_e, origin_e)
        return state.r_e, turn @ np.linalg.solve(state.P[:9, :9], turn)

    _, before = used(lambda filter_, fix: None)
    once_e, _ = used(looked_at_once)
    again_e, after = used(looked_at_again)
    assert np.linalg.norm(again_e - once_e) > 0.2
    assert after == pytest.approx(before, rel=1e-6)
