"""Gaps in the samples: bridged with honest sigmas up to a limit, begun again after more."""

from functools import cache

import msgspec
import numpy as np
import pytest

from gateway.estimator import Estimator
from gateway.messages import Checkpoint, Innovation, NavSolution, SavedState, UsblFix
from gateway.modes import KNOWN_HEADING_SD, Mode
from gateway.nav import earth
from gateway.replay.passes import SmoothedPass
from gateway.timeline import MAX_WAITING
from tests.gateway.emulated import demo_data, make
from tests.gateway.test_estimator import fed, of
from tests.gateway.voyages import T0_NS, Voyage, block, configuration

BEGINS_S = 40.0
RATE_HZ = 50.0


@cache
def with_a_gap(gap_s, seed, after_s=80.0):
    """A voyage whose samples are lost from 40 s on; the next one stands in for them."""
    data = demo_data() | {"duration_s": BEGINS_S + gap_s + after_s, "seed": seed}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    data["devices"]["usbl0"]["outliers"] = {}
    trip = Voyage(make(data))
    ends_s = BEGINS_S + gap_s
    lost = (trip.t_imu > BEGINS_S + 1e-6) & (trip.t_imu < ends_s - 1e-6)
    stands_in, n = int(np.flatnonzero(lost)[-1]) + 1, int(lost.sum())
    rows = trip.rows.copy()
    rows[stands_in, :7] *= n + 1
    rows[stands_in, 7] = n / RATE_HZ
    return trip, trip.t_ns[~lost], rows[~lost]


def arrivals(gap_s, seed, heard_within=True, block_samples=25):
    """Blocks and fixes as a live gateway gets them, half a second late."""
    trip, t_ns, rows = with_a_gap(gap_s, seed)
    ends_ns = T0_NS + (BEGINS_S + gap_s) * 1e9
    fixes = [f for f in trip.fixes if heard_within or not T0_NS + 4e10 < f.t_ns < ends_ns]
    out = []
    for k in range(0, len(t_ns), block_samples):
        part = slice(k, k + block_samples)
        begins_ns = t_ns[part][0] - rows[part][0, 0] * 1e9
        while fixes and fixes[0].t_ns + 5e8 <= max(begins_ns, t_ns[part][0] - 2e9):
            out.append(fixes.pop(0))
        out.append(block(t_ns[part], rows[part]))
    return out


def horizontal(trip, nav):
    """Error and its sigma (m)."""
    truth = trip.truth.geodetic(np.array([(nav.t_ns - T0_NS) * 1e-9]))
    R_M, R_N = earth.radii(truth.lat[0])
    north = float((nav.lat - truth.lat[0]) * R_M)
    east = float((nav.lon - truth.lon[0]) * R_N * np.cos(truth.lat[0]))
    return np.hypot(north, east), np.hypot(*nav.sd_position[:2])


def since_the_gap(gap_s, outputs):
    """The solutions from its end on, and the seconds."""
    navs = of(NavSolution, outputs)
    after = [(nav.t_ns - T0_NS) * 1e-9 - BEGINS_S - gap_s for nav in navs]
    return [(s, nav) for s, nav in zip(after, navs, strict=True) if s > -1e-6]


@pytest.mark.parametrize(("gap_s", "soon_m"), [(1.0, 1.5), (3.0, 3.0), (10.0, 10.0), (29.0, 60.0)])
def test_a_gap_is_lived_through(gap_s, soon_m):
    """In a seaway, on a circle: the claim grows with the gap, the error stays within it."""
    trip, _, _ = with_a_gap(gap_s, 3)
    estimator = Estimator(configuration(trip.scenario), 1.0)
    after = since_the_gap(gap_s, fed(estimator, arrivals(gap_s, 3)))
    assert len(after) > 70
    for seconds, nav in after:
        error_m, sigma_m = horizontal(trip, nav)
        assert error_m < 4.0 * sigma_m
        assert error_m < soon_m or seconds < 10.0
    assert after[-1][1].mode is Mode.AIDED
    assert estimator.counts().resets == 0


@pytest.mark.parametrize("gap_s", [3.0, 10.0])
def test_an_outlier_after_a_gap_is_not_believed(gap_s):
    """The heading may be any by 17 or 32 deg, but no heading makes a range 40 m longer."""
    trip, _, _ = with_a_gap(gap_s, 3)
    measurements = arrivals(gap_s, 3)
    k, fix = next(
        (k, m)
        for k, m in enumerate(measurements)
        if isinstance(m, UsblFix) and m.t_ns > T0_NS + (BEGINS_S + gap_s) * 1e9
    )
    away = {"slant_range": fix.slant_range + 40.0, "elevation": fix.elevation + 0.3}
    measurements[k] = msgspec.structs.replace(fix, **away)
    outputs = fed(Estimator(configuration(trip.scenario), 1.0), measurements)
    verdicts = [v for v in of(Innovation, outputs) if not v.accepted]
    assert [(v.t_ns, v.reason) for v in verdicts] == [(fix.t_ns, "gate")]
    for _, nav in since_the_gap(gap_s, outputs):
        error_m, sigma_m = horizontal(trip, nav)
        assert error_m < 4.0 * sigma_m


@pytest.mark.parametrize(("gap_s", "seed"), [(40.0, 3), (100.0, 1), (100.0, 2)])
def test_after_too_long_a_gap_it_begins_again(gap_s, seed):
    """Nothing of what the vehicle did is known: no claim before a fix, and then none too bold."""
    trip, _, _ = with_a_gap(gap_s, seed)
    estimator = Estimator(configuration(trip.scenario), 1.0)
    after = since_the_gap(gap_s, fed(estimator, arrivals(gap_s, seed, heard_within=False)))
    modes = [nav.mode for _, nav in after]
    assert list(dict.fromkeys(modes)) == [Mode.ALIGNING, Mode.AIDED]
    known = [nav.sd_attitude[2] <= KNOWN_HEADING_SD for _, nav in after]
    fresh = [nav.fix_age_s is not None for _, nav in after]
    claims = [k and f for k, f in zip(known, fresh, strict=True)]
    assert [mode is Mode.AIDED for mode in modes] == claims
    assert after[0][1].fix_age_s is None
    assert horizontal(trip, after[0][1])[1] > gap_s
    for _, nav in after:
        error_m, sigma_m = horizontal(trip, nav)
        assert error_m < 4.0 * sigma_m
    assert horizontal(trip, after[-1][1])[1] < 10.0
    assert estimator.counts().resets == 0


def test_every_fix_of_a_gap_has_its_verdict():
    gap_s = 60.0
    trip, t_ns, _ = with_a_gap(gap_s, 3)
    estimator = Estimator(configuration(trip.scenario), 1.0)
    measurements = arrivals(gap_s, 3)
    outputs = fed(estimator, measurements)
    fixes = [m for m in measurements if not isinstance(m.t_ns, bytes)]
    verdicts = of(Innovation, outputs)
    assert sorted(v.t_ns for v in verdicts) == [f.t_ns for f in fixes]
    within = [v for v in verdicts if 40.0 < (v.t_ns - T0_NS) * 1e-9 < 40.0 + gap_s]
    assert {v.reason for v in within} == {"too_early", "too_late"}
    early = [v for v in within if v.reason == "too_early"]
    assert all(v.t_ns > T0_NS + 70e9 for v in early)
    counts = estimator.counts()
    assert (counts.fixes_too_early, counts.fixes_too_late) == (len(early), len(within) - len(early))
    assert counts.imu_samples == len(t_ns)


def test_it_aligns_again_where_the_configuration_says_how():
    gap_s = 60.0
    trip, _, _ = with_a_gap(gap_s, 4)
    plain = msgspec.to_builtins(configuration(trip.scenario))
    plain["initial"]["align"] = {"heading": "config", "level_s": 10.0}
    config = msgspec.convert(plain, type(configuration(trip.scenario)))
    outputs = fed(Estimator(config, 1.0), arrivals(gap_s, 4, heard_within=False))
    levels = [v for v in of(Innovation, outputs) if v.device == "imu0"]
    assert [v.accepted for v in levels] == [True, True]
    assert (levels[1].t_ns - T0_NS) * 1e-9 == pytest.approx(BEGINS_S + gap_s, abs=1e-3)
    after = since_the_gap(gap_s, outputs)
    assert {nav.mode for seconds, nav in after if seconds < 9.5} == {Mode.ALIGNING}
    assert after[-1][1].mode is Mode.AIDED
    for _, nav in after:
        error_m, sigma_m = horizontal(trip, nav)
        assert error_m < 4.0 * sigma_m


@pytest.mark.parametrize("block_samples", [1, 4000])
def test_outputs_do_not_depend_on_the_batches(block_samples):
    gap_s = 40.0
    trip, t_ns, rows = with_a_gap(gap_s, 3)
    config = configuration(trip.scenario)

    def said(size):
        blocks = [block(t_ns[k : k + size], rows[k : k + size]) for k in range(0, len(t_ns), size)]
        outputs = fed(Estimator(config, 3.0), blocks)
        return [o for o in outputs if not isinstance(o, Checkpoint)]

    assert said(block_samples) == said(37)


def test_a_checkpoint_from_before_leads_over_it():
    """A worker that dies after the gap begins before it, and says the same."""
    gap_s = 40.0
    trip, _, _ = with_a_gap(gap_s, 3)
    config = configuration(trip.scenario)
    measurements = arrivals(gap_s, 3)
    outputs = fed(Estimator(config, 5.0), measurements)
    counted = [o for o in outputs if not isinstance(o, SavedState | Checkpoint)]
    checkpoints = of(Checkpoint, outputs)
    before = [c for c in checkpoints if c.t_ns < T0_NS + BEGINS_S * 1e9][-1]
    assert [c for c in checkpoints if c.t_ns > T0_NS + (BEGINS_S + gap_s) * 1e9]
    again = fed(Estimator(config, 5.0, before), measurements[before.received :])
    again = [o for o in again if not isinstance(o, SavedState | Checkpoint)]
    assert before.said + len(again) == len(counted)
    assert msgspec.msgpack.encode(again[-300:]) == msgspec.msgpack.encode(counted[-300:])


@pytest.mark.parametrize("gap_s", [10.0, 40.0])
def test_smoothing_bridges_it_too(gap_s):
    """The interval on either side, and nothing in between."""
    trip, _, _ = with_a_gap(gap_s, 3)
    smoother = SmoothedPass(configuration(trip.scenario), 1.0)
    for measurement in arrivals(gap_s, 3):
        assert list(smoother.feed(measurement)) == []
    outputs = list(smoother.finish())
    assert not [n for n in of(NavSolution, outputs) if 41 < (n.t_ns - T0_NS) * 1e-9 < 39 + gap_s]
    after = since_the_gap(gap_s, outputs)
    assert len(after) > 75
    for seconds, nav in after:
        error_m, sigma_m = horizontal(trip, nav)
        assert error_m < 4.0 * sigma_m
        assert sigma_m < 10.0 or seconds < 1e-6  # the first: before any sample


def test_few_fixes_wait_for_a_first_sample():
    """An IMU that never comes: what is kept for it is bounded, and the rest is told."""
    trip, _, _ = with_a_gap(10.0, 3)
    plain = msgspec.to_builtins(configuration(trip.scenario))
    for align in (None, {"heading": "unknown"}):
        plain["initial"]["align"] = align
        config = msgspec.convert(plain, type(configuration(trip.scenario)))
        estimator = Estimator(config, 1.0)
        many = [msgspec.structs.replace(trip.fixes[0], t_ns=k) for k in range(MAX_WAITING + 5)]
        verdicts = fed(estimator, many)
        assert [v.reason for v in verdicts] == ["too_early"] * 5
        assert estimator.counts().fixes_too_early == 5
