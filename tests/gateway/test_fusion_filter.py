"""The filter on the emulator's data: gate, open gate, lock-out, and what it says of each fix."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace

from gateway.fusion import initial
from gateway.fusion.doubt import FREED, LOCK_OUT, RARE
from gateway.fusion.errors import FAMILY
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.report import solution
from gateway.fusion.state import ATT, POS, VEL, State
from gateway.messages import Depth, PositionFix
from gateway.modes import Mode
from gateway.nav import earth
from gateway.nav.lie import exp_so3
from gateway.timeline import Timeline
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import Voyage, configuration

RATE_HZ = 50.0


@cache
def voyage(duration_s=80.0):
    data = demo_data() | {"duration_s": duration_s, "seed": 4}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    data["devices"]["usbl0"]["outliers"] = {}
    found = Voyage(make(data))
    return found, configuration(found.scenario)


def at_the_truth(sigma=(1e-3, 0.1, 1.0)):
    """A filter that begins with the true state and some uncertainty, and its timeline."""
    trip, config = voyage()
    fresh = initial.initial_state(config)
    state = State(trip.state(0.0).x, fresh.P, fresh.columns)
    state.P[:9, :9] = np.diag(np.repeat(sigma, 3) ** 2)
    filter_ = Filter(initial.model(config), Memory(state))
    return trip, filter_, Timeline(filter_, RATE_HZ, 10.0, slice_=None)


def sail(trip, timeline, t_s):
    """Samples up to a time, no fixes."""
    begin = 0 if timeline.t_head_ns is None else np.searchsorted(trip.t_ns, timeline.t_head_ns) + 1
    end = np.searchsorted(trip.t_imu, t_s, side="right")
    return timeline.extend(trip.t_ns[begin:end], trip.rows[begin:end])


def offer(trip, timeline, k, **changes):
    """Sail past fix `k` and insert it, changed; the one verdict on it."""
    fix = replace(trip.fixes[k], **changes)
    sail(trip, timeline, (fix.t_ns - trip.t_ns[0]) * 1e-9 + 0.5)
    (verdict,) = timeline.insert(fix, fix.t_ns, str(fix))
    return verdict


def test_a_good_fix_is_used():
    trip, filter_, timeline = at_the_truth()
    for k in range(3):
        verdict = offer(trip, timeline, k)
        assert (verdict.accepted, verdict.reason) == (True, "")
        assert verdict.nis < 16.3
        assert filter_.memory.used == k + 1
        assert filter_.memory.t_used_ns == verdict.t_ns == trip.fixes[k].t_ns
    assert np.sqrt(filter_.memory.state.P.diagonal()[POS]).max() < 0.5


@pytest.mark.parametrize("error", sorted(FAMILY))
def test_places_and_heights_at_one_moment_tell_nothing_of_the_attitude(error):
    """The first place moves the estimate by metres; what is known of the level must not turn that
    into a height that those after it contradict."""
    _, filter_, _ = at_the_truth((0.02, 0.1, 30.0))
    filter_.model = dataclasses.replace(filter_.model, error=FAMILY[error])
    state = filter_.memory.state
    filter_.origin_e = state.r_e.copy()
    C = earth.C_en(*earth.ecef_to_lla(state.r_e)[:2])
    lat, lon, h = map(float, earth.ecef_to_lla(state.r_e + C @ [40.0, 30.0, 0.0]))
    before = state.P[ATT, ATT].copy()
    for fix in 3 * [PositionFix(0, "aid", lat, lon, None, (0.1,) * 3), Depth(0, "aid", h, 0.05)]:
        assert filter_.apply(fix, None).accepted
    np.testing.assert_allclose(filter_.memory.state.P[ATT, ATT], before, atol=1e-9)


def test_an_outlier_is_refused_and_leaves_no_trace():
    trip, filter_, timeline = at_the_truth()
    same = at_the_truth()
    offer(trip, timeline, 0)
    offer(trip, same[2], 0)
    far = trip.fixes[1].slant_range + 30.0
    verdict = offer(trip, timeline, 1, slant_range=far)
    sail(trip, same[2], (timeline.t_head_ns - trip.t_ns[0]) * 1e-9 + trip.t_imu[0])
    assert (verdict.accepted, verdict.reason) == (False, "gate")
    assert verdict.nis > 100.0
    assert (filter_.memory.used, filter_.memory.gated) == (1, 1)
    now, untouched = filter_.memory.state, same[1].memory.state
    assert same[2].t_head_ns == timeline.t_head_ns
    np.testing.assert_allclose(now.x, untouched.x, rtol=0.0, atol=1e-6)  # the split sample
    np.testing.assert_allclose(now.P, untouched.P, rtol=1e-3, atol=1e-9)


def test_the_verdict_says_measured_minus_predicted_in_edge_units():
    trip, filter_, timeline = at_the_truth()
    verdict = offer(trip, timeline, 0, slant_range=trip.fixes[0].slant_range + 30.0)
    assert [c.name for c in verdict.components] == ["elevation_deg", "bearing_deg", "range_m"]
    assert verdict.components[2].value == pytest.approx(30.0, abs=1.0)
    assert 0.2 < verdict.components[2].sigma < 2.0
    noise = np.degrees(filter_.model.arrays["usbl0"].sigma)
    for component, white in zip(verdict.components[:2], noise, strict=False):
        assert abs(component.value) < 5.0 * component.sigma
        assert white < component.sigma < 2.0


def test_components_that_were_not_measured_are_not_claimed():
    trip, _, timeline = at_the_truth()
    verdict = offer(trip, timeline, 0, slant_range=None)
    assert [c.name for c in verdict.components] == ["elevation_deg", "bearing_deg"]
    verdict = offer(trip, timeline, 1, elevation=None, bearing=None)
    assert [c.name for c in verdict.components] == ["range_m"]
    assert verdict.accepted


def turned(state, off_deg, sd_deg):
    """Turn the heading, and say how uncertain it is."""
    state.C_eb[:] = exp_so3(np.radians(off_deg) * up(state)) @ state.C_eb
    state.P[ATT, ATT] += np.radians(sd_deg) ** 2 * np.outer(up(state), up(state))


def test_the_gate_waits_for_the_heading():
    """With the heading unknown a linearised gate would lock good fixes out."""
    trip, filter_, timeline = at_the_truth()
    turned(filter_.memory.state, 40.0, 40.0)
    verdict = offer(trip, timeline, 0, bearing=trip.fixes[0].bearing + 3.0)
    assert verdict.accepted
    assert verdict.nis > 16.3


def test_what_no_heading_explains_is_refused_before_it_is_known():
    trip, filter_, timeline = at_the_truth()
    turned(filter_.memory.state, 20.0, 20.0)
    verdict = offer(trip, timeline, 0, slant_range=trip.fixes[0].slant_range + 30.0)
    assert (verdict.accepted, verdict.reason) == (False, "gate")
    assert not filter_.knows_heading()
    assert offer(trip, timeline, 1).accepted


def test_the_gate_closes_once_the_heading_is_known():
    trip, filter_, timeline = at_the_truth()
    state = filter_.memory.state
    state.C_eb[:] = exp_so3(np.radians(20.0) * up(state)) @ state.C_eb
    state.P[ATT, ATT] += np.radians(20.0) ** 2 * np.outer(up(state), up(state))
    for k in range(20):
        offer(trip, timeline, k)
    assert filter_.knows_heading()
    verdict = offer(trip, timeline, 20, bearing=trip.fixes[20].bearing + 0.5)
    assert (verdict.accepted, verdict.reason) == (False, "gate")


def up(state):
    lat, lon, _ = earth.ecef_to_lla(state.r_e)
    return -earth.C_en(lat, lon)[:, 2]


@pytest.mark.parametrize("east_m", [20.0, 50.0, 200.0, 500.0])
def test_a_locked_out_filter_frees_itself(east_m):
    """Far off and sure of it: refused until the doubt has grown, then soon right and used again."""
    trip, filter_, timeline = at_the_truth(sigma=(1e-3, 0.1, 0.3))
    here = earth.C_en(np.radians(39.8), np.radians(116.2))
    filter_.memory.state.r_e[:] += here @ [0.0, east_m, 0.0]
    verdicts = [offer(trip, timeline, k) for k in range(35)]
    first = [v.accepted for v in verdicts].index(True)
    assert LOCK_OUT < first <= 12
    assert all(v.reason == "gate" and v.moved is None for v in verdicts[:first])
    gone = np.sum([v.moved for v in verdicts if v.moved is not None], axis=0)
    assert np.linalg.norm(gone - [0.0, -east_m, 0.0]) < 6.0, "it tells how far it was off"
    t_s = (timeline.t_head_ns - trip.t_ns[0]) * 1e-9 + trip.t_imu[0]
    truth = trip.state(t_s)
    assert np.linalg.norm(filter_.memory.state.r_e - truth.r_e) < 5.0
    assert np.linalg.norm(filter_.memory.state.v_eb_e - truth.v_eb_e) < 0.2
    assert sum(v.accepted for v in verdicts[20:]) >= 13
    assert filter_.memory.refused_in_a_row <= 2


def test_where_fixes_come_rarely_fewer_refusals_free_it():
    """One in ten seconds: half a minute after the last that was used, not a minute and a half."""
    trip, filter_, timeline = at_the_truth(sigma=(1e-3, 0.1, 0.3))
    every = round(10.0 / float(np.diff([f.t_ns for f in trip.fixes[:2]])[0] * 1e-9))
    assert offer(trip, timeline, 0).accepted
    here = earth.C_en(np.radians(39.8), np.radians(116.2))
    filter_.memory.state.r_e[:] += here @ [0.0, 50.0, 0.0]
    verdicts = [offer(trip, timeline, k) for k in range(every, 7 * every, every)]
    first = [v.accepted for v in verdicts].index(True)
    assert RARE <= first < LOCK_OUT - 2
    t_s = (timeline.t_head_ns - trip.t_ns[0]) * 1e-9 + trip.t_imu[0]
    assert np.linalg.norm(filter_.memory.state.r_e - trip.state(t_s).r_e) < 10.0


def test_a_wrong_velocity_locks_out_for_good_no_more():
    trip, filter_, timeline = at_the_truth(sigma=(1e-3, 0.1, 0.3))
    here = earth.C_en(np.radians(39.8), np.radians(116.2))
    filter_.memory.state.v_eb_e[:] += here @ [3.0, 0.0, 0.0]
    for k in range(35):
        offer(trip, timeline, k)
    t_s = (timeline.t_head_ns - trip.t_ns[0]) * 1e-9 + trip.t_imu[0]
    assert np.linalg.norm(filter_.memory.state.r_e - trip.state(t_s).r_e) < 1.5
    assert np.linalg.norm(filter_.memory.state.v_eb_e - trip.state(t_s).v_eb_e) < 0.1


def test_below_the_limit_refusals_do_not_touch_the_covariance():
    trip, filter_, timeline = at_the_truth()
    offer(trip, timeline, 0)
    for k in range(1, LOCK_OUT + 1):
        assert not offer(trip, timeline, k, slant_range=500.0).accepted
    assert filter_.memory.refused_in_a_row == LOCK_OUT
    P = filter_.memory.state.P
    before = P.copy()
    fix = replace(trip.fixes[LOCK_OUT], slant_range=500.0)
    assert not filter_.apply(fix, timeline).accepted
    added = P - before
    for part, share in ((ATT, 0.5), (VEL, 1.0), (POS, 9.0)):
        mean = np.trace(before[part, part]) / 3.0
        np.testing.assert_allclose(added[part, part], share * mean * np.eye(3), rtol=1e-9)
        added[part, part] = 0.0
    np.testing.assert_array_equal(added, 0.0)


def test_good_fixes_in_a_row_restore_trust():
    """While locked out one good fix is not enough: the next refusal adds doubt at once."""
    trip, filter_, timeline = at_the_truth()
    for k in range(LOCK_OUT + 1):
        offer(trip, timeline, k, slant_range=500.0)
    for k in range(LOCK_OUT + 1, LOCK_OUT + 1 + FREED):
        assert filter_.memory.refused_in_a_row > LOCK_OUT or k > LOCK_OUT + 1
        assert offer(trip, timeline, k).accepted
    assert filter_.memory.refused_in_a_row == 0


def test_a_beacon_that_is_not_configured_is_refused_by_name():
    trip, filter_, timeline = at_the_truth()
    verdict = offer(trip, timeline, 0, beacon="77")
    assert (verdict.accepted, verdict.reason, verdict.beacon) == (False, "unknown_beacon", "77")
    assert verdict.components == ()
    assert np.isnan(verdict.nis)
    assert filter_.memory.gated == 1


def test_a_bearing_of_a_beacon_straight_below_is_refused_for_its_geometry():
    trip, filter_, timeline = at_the_truth()
    sail(trip, timeline, 1.0)
    state = filter_.memory.state
    overhead = filter_.model.beacons["1"].r_e + 50.0 * up(state)
    level = earth.C_en(*earth.ecef_to_lla(overhead)[:2])
    state.C_eb[:], state.r_e[:] = level, overhead - level @ [0.5, 0.0, 0.8]
    bearing = replace(trip.fixes[0], elevation=None, slant_range=None)
    verdict = filter_.apply(bearing, timeline)
    assert (verdict.accepted, verdict.reason) == (False, "geometry")
    verdict = filter_.apply(trip.fixes[0], timeline)
    assert [c.name for c in verdict.components] == ["elevation_deg", "range_m"]


@pytest.mark.parametrize("where", ["x", "P"])
def test_a_state_that_is_not_finite_is_a_fault_and_no_exception(where):
    trip, filter_, timeline = at_the_truth()
    sail(trip, timeline, 5.0)
    getattr(filter_.memory.state, where)[...] = np.nan
    with np.errstate(invalid="ignore"):
        verdict = filter_.apply(trip.fixes[0], timeline)
    assert (verdict.accepted, verdict.reason) == (False, "fault")
    assert not filter_.memory.state.is_sound()


def test_a_covariance_that_is_not_positive_is_a_fault():
    trip, filter_, timeline = at_the_truth()
    sail(trip, timeline, 5.0)
    filter_.memory.state.P[POS, POS] = -np.eye(3)
    assert filter_.apply(trip.fixes[0], timeline).reason == "fault"
    assert not filter_.memory.state.is_sound()


def test_a_copy_of_the_memory_is_a_snapshot():
    trip, filter_, timeline = at_the_truth()
    sail(trip, timeline, 1.0)
    saved = filter_.save()
    x, P = saved.state.x.copy(), saved.state.P.copy()
    sail(trip, timeline, 2.0)
    assert not np.array_equal(filter_.memory.state.x, x)
    filter_.restore(saved)
    filter_.memory.state.x[:] = 0.0
    np.testing.assert_array_equal(saved.state.x, x)
    np.testing.assert_array_equal(saved.state.P, P)


def test_solution_of_a_running_filter_claims_its_sigma():
    """Error within five sigma in every component after forty seconds of fixes."""
    trip, filter_, timeline = at_the_truth()
    for k in range(20):
        offer(trip, timeline, k)
    t_s = (timeline.t_head_ns - trip.t_ns[0]) * 1e-9 + trip.t_imu[0]
    nav = solution(filter_.memory.state, timeline.t_head_ns, Mode.AIDED, 0.0, 20, 0)
    g = trip.truth.geodetic(np.array([t_s]))
    R_M, R_N = earth.radii(g.lat[0])
    errors = [(nav.lat - g.lat[0]) * R_M, (nav.lon - g.lon[0]) * R_N * np.cos(g.lat[0])]
    errors += [g.h[0] - nav.h, *(np.array(nav.v_eb_n) - g.v_eb_n[0])]
    sigma = np.array([*nav.sd_position, *nav.sd_velocity])
    assert np.all(np.abs(errors) < 5.0 * sigma)
    assert np.all(sigma[:3] < 1.0)
