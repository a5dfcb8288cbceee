"""The core of the filter process: deterministic whatever the batches, honest modes, going on."""

from functools import cache

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.estimator import Estimator
from gateway.messages import (
    Calibration,
    Checkpoint,
    FilterCounts,
    ImuBlock,
    Innovation,
    NavSolution,
    SavedState,
)
from gateway.modes import Mode
from gateway.nav import earth
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import T0_NS, Voyage, block, configuration

OUTPUT_HZ = 10.0


@cache
def voyage():
    data = demo_data() | {"duration_s": 30.0, "seed": 3}
    data["devices"]["imu0"]["rate_hz"] = 50.0
    data["devices"]["usbl0"]["outliers"] = {}
    found = Voyage(make(data))
    return found, configuration(found.scenario), list(found.arrivals(latency_s=0.5))


def fed(estimator, measurements):
    return [output for m in measurements for output in estimator.feed(m)]


@cache
def whole():
    _, config, measurements = voyage()
    return fed(Estimator(config, OUTPUT_HZ), measurements)


def of(kind, outputs):
    return [o for o in outputs if isinstance(o, kind)]


def bytes_of(output):
    """An output as bytes, without the count of messages, which is of batches."""
    if isinstance(output, Checkpoint):
        output = msgspec.structs.replace(output, received=0)
    return msgspec.msgpack.encode(output)


def cut(measurement, at):
    """An IMU block in parts after the given numbers of samples."""
    t_ns = np.frombuffer(measurement.t_ns, dtype=np.int64)
    rows = np.frombuffer(measurement.rows).reshape(-1, 8)
    ends = [*(a for a in at if 0 < a < len(t_ns)), len(t_ns)]
    return [block(t_ns[a:b], rows[a:b]) for a, b in zip([0, *ends], ends, strict=False)]


def joined(measurements):
    """Neighbouring IMU blocks as one."""
    out = []
    for m in measurements:
        if out and isinstance(m, ImuBlock) and isinstance(out[-1], ImuBlock):
            out[-1] = ImuBlock(out[-1].t_ns + m.t_ns, out[-1].rows + m.rows)
        else:
            out.append(m)
    return out


@settings(max_examples=5, deadline=None)
@given(st.lists(st.integers(1, 400), max_size=30, unique=True).map(sorted))
def test_outputs_do_not_depend_on_the_batches(cuts):
    """Byte for byte: samples one by one, in odd parts, or all between two fixes at once."""
    _, config, measurements = voyage()
    again = []
    for m in joined(measurements):
        again += cut(m, cuts) if isinstance(m, ImuBlock) else [m]
    outputs = fed(Estimator(config, OUTPUT_HZ), again)
    assert [bytes_of(o) for o in outputs] == [bytes_of(o) for o in whole()]


def test_outputs_do_not_depend_on_the_batches_while_history_is_run_again():
    """Fixes 8 s late at 200 Hz: slices go on over many samples, which come one by one or not."""
    data = demo_data() | {"duration_s": 14.0, "seed": 4}
    data["devices"]["usbl0"]["outliers"] = {}
    trip = Voyage(make(data))
    assert trip.rate_hz == 200.0
    config = configuration(trip.scenario)
    fine = list(trip.arrivals(latency_s=8.0, block_s=0.005))
    outputs = fed(Estimator(config, 50.0), fine)
    assert [bytes_of(o) for o in fed(Estimator(config, 50.0), joined(fine))] == [
        bytes_of(o) for o in outputs
    ]
    verdict = next(i for i, o in enumerate(outputs) if isinstance(o, Innovation))
    arrived = of(Innovation, outputs)[0].t_ns + 8.0e9
    before = of(NavSolution, outputs[:verdict])[-1]
    assert before.t_ns > arrived and before.fixes_used == 0, "solutions go on meanwhile"
    assert of(NavSolution, outputs[verdict:])[0].t_ns - arrived < 0.1e9


def test_who_gives_a_solution_knows_whether_more_is_to_be_done():
    """That can wait until the solution is away: the slices after late fixes, and each second."""
    data = demo_data() | {"duration_s": 12.0, "seed": 4}
    trip = Voyage(make(data))
    estimator = Estimator(configuration(trip.scenario), trip.rate_hz)
    owed, work = [], []
    for m in trip.arrivals(latency_s=2.5, block_s=1.0 / trip.rate_hz):
        for output in estimator.feed(m):
            if isinstance(output, NavSolution):
                owed.append(estimator.owes)
                work.append(0)
            elif isinstance(m, ImuBlock):
                work[-1] += 1
        assert not estimator.owes
    fixes = sum(n == 1 for n in work)
    assert fixes > 2, "verdicts that come with a slice"
    assert all(owes for owes, n in zip(owed, work, strict=True) if n)
    assert sum(owed) < 20 * (12 + fixes) < len(owed) / 2


def test_one_run_is_like_the_other():
    _, config, measurements = voyage()
    outputs = fed(Estimator(config, OUTPUT_HZ), measurements)
    assert [bytes_of(o) for o in outputs] == [bytes_of(o) for o in whole()]


def test_solutions_come_at_their_rate_and_the_rest_each_second():
    trip, _, _ = voyage()
    t = np.array([n.t_ns for n in of(NavSolution, whole())])
    np.testing.assert_allclose(np.diff(t), 1e9 / OUTPUT_HZ, atol=1e9 / trip.rate_hz)
    for kind in (Calibration, FilterCounts, SavedState):
        assert len(of(kind, whole())) in (30, 31)


def test_solutions_are_near_the_truth_and_say_so():
    trip, _, _ = voyage()
    for nav in of(NavSolution, whole())[-50:]:
        g = trip.truth.geodetic(np.array([(nav.t_ns - T0_NS) * 1e-9]))
        R_M, R_N = earth.radii(g.lat[0])
        north = (nav.lat - g.lat[0]) * R_M
        east = (nav.lon - g.lon[0]) * R_N * np.cos(g.lat[0])
        assert np.hypot(north, east) < 1.0
        assert np.hypot(north, east) < 4.0 * np.hypot(*nav.sd_position[:2])


def test_modes_say_what_may_be_claimed():
    """Aligning before the first fix, aided while one is young enough, then dead reckoning."""
    trip, config, measurements = voyage()
    silent_after = trip.t_ns[0] + 12_000_000_000
    config = msgspec.structs.replace(
        config, filter=msgspec.structs.replace(config.filter, max_fix_age_s=5.0)
    )
    heard = [m for m in measurements if isinstance(m, ImuBlock) or m.t_ns < silent_after]
    outputs = fed(Estimator(config, OUTPUT_HZ), heard)
    last = max(m.t_ns for m in heard if not isinstance(m, ImuBlock))
    navs = of(NavSolution, outputs)
    modes = [nav.mode for nav in navs]
    assert list(dict.fromkeys(modes)) == [Mode.ALIGNING, Mode.AIDED, Mode.DEAD_RECKONING]
    for nav in navs:
        if nav.mode is Mode.ALIGNING:
            assert nav.fix_age_s is None
            assert nav.fixes_used == 0
        elif nav.mode is Mode.AIDED:
            assert nav.fix_age_s <= 5.0
        else:
            assert nav.fix_age_s == pytest.approx((nav.t_ns - last) * 1e-9)
            assert nav.fix_age_s > 5.0


def test_every_fix_gets_one_verdict():
    _, _, measurements = voyage()
    fixes = [m for m in measurements if not isinstance(m, ImuBlock)]
    assert sorted(v.t_ns for v in of(Innovation, whole())) == [f.t_ns for f in fixes]
    assert all(v.accepted for v in of(Innovation, whole()))


def test_fixes_out_of_order_are_counted():
    _, config, measurements = voyage()
    fixes = [m for m in measurements if not isinstance(m, ImuBlock)]
    estimator = Estimator(config, OUTPUT_HZ)
    outputs = fed(estimator, measurements)
    again = fed(estimator, [fixes[-1], fixes[0]])
    assert [v.reason for v in again] == ["duplicate", "too_late"]
    counts = estimator.counts()
    assert counts.fixes_duplicate == 1
    assert counts.fixes_too_late == 1
    assert counts.fixes_late == len(fixes)
    assert counts.fixes_used == len(fixes)
    assert counts.imu_samples == len(voyage()[0].t_ns)
    assert of(FilterCounts, outputs)[-1].resets == 0


def spoilt(measurement):
    """A block whose last sample is not a number."""
    rows = np.frombuffer(measurement.rows).copy()
    rows[-6] = np.nan
    return ImuBlock(measurement.t_ns, rows.tobytes())


@pytest.mark.parametrize("fix_between", [False, True])
def test_a_state_that_is_not_finite_is_a_fault_and_a_new_start(fix_between):
    """One bad sample, with or without a fix before anybody looked: FAULT, then on by itself."""
    _, config, measurements = voyage()
    first_fix = next(i for i, m in enumerate(measurements) if not isinstance(m, ImuBlock))
    at = first_fix - 1 if fix_between else 200
    estimator = Estimator(config, OUTPUT_HZ)
    with np.errstate(invalid="ignore"):
        outputs = fed(estimator, measurements[:at])
        outputs += fed(estimator, [spoilt(measurements[at])])
        outputs += fed(estimator, measurements[at + 1 :])
    modes = [nav.mode for nav in of(NavSolution, outputs)]
    assert modes.count(Mode.FAULT) == 1
    assert estimator.counts().resets == 1
    at_fault = modes.index(Mode.FAULT)
    assert Mode.ALIGNING in modes[at_fault:]
    assert modes[-1] is Mode.AIDED
    for nav in of(NavSolution, outputs):
        assert np.isfinite([nav.lat, nav.lon, nav.h, *nav.v_eb_n, nav.heading]).all()


def test_constants_are_told_in_their_units():
    trip, _, _ = voyage()
    last = {c.name: c for c in of(Calibration, whole())[-1].constants}
    assert set(last) >= {"gyro_bias_x_deg_h", "accel_bias_z_ug", "mounting_x_deg", "range_scale"}
    assert "bearing_offset_deg" not in last, "no prior: not estimated"
    truth = dict(zip(("x", "y", "z"), trip.errors.bias[:3], strict=True))
    for axis, bias in truth.items():
        c = last[f"gyro_bias_{axis}_deg_h"]
        assert abs(c.value - np.degrees(bias) * 3600.0) < 4.0 * c.sigma
        assert 0.0 < c.sigma <= 0.0201
    scale = last["range_scale"]
    assert abs(scale.value - trip.constants[11]) < 4.0 * scale.sigma
