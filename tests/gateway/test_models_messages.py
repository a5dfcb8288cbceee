"""Messages to models: what each says of the vehicle, through the filter as it runs."""

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from drivers.records import UsblRecord
from gateway.emulator import twin
from gateway.filter_process.channel import encode, read_in_worker
from gateway.fusion import initial
from gateway.fusion.doubt import LOCK_OUT
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.observation import Mount, observe
from gateway.fusion.state import State
from gateway.ingest.usbl import UsblIngest
from gateway.messages import (
    BeaconRange,
    BottomVelocity,
    Depth,
    HeadingFix,
    PositionFix,
    RadialRate,
    Stationary,
    UsblFix,
    VelocityFix,
)
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler, euler_from_C
from gateway.timeline import Timeline
from tests.gateway.emulated import demo_data, make, quiet_usbl, track
from tests.gateway.voyages import T0_NS, Voyage, configuration

RATE_HZ = 100.0
LEVER = np.array([2.0, -1.0, 0.5])
C_BS = C_from_euler(0.1, -0.2, 0.7)
ELEMENTS = [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, -0.1, 0.0]]


@pytest.fixture(scope="module")
def trip():
    """A swaying line past a beacon, everything exact."""
    data = demo_data() | {"trajectory": track("line", speed_m_s=4.0), "duration_s": 40.0}
    data["beacons"] = {"1": {"lat_deg": -33.004, "lon_deg": -72.001, "height_m": -250.0}}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    data["devices"]["usbl0"] = quiet_usbl(lever_arm_m=LEVER.tolist(), mounting_deg=[5, -3, 40])
    return Voyage(make(data))


def as_declared(trip, **options):
    """The configuration of the trip with an ordinary array's noise, though its fixes are exact."""
    devices = twin.gateway_config(trip.scenario)["devices"]
    devices["usbl0"]["noise"] = {"bearing_deg": 0.1, "elevation_deg": 0.1, "range_m": 0.1}
    return configuration(trip.scenario, devices=devices, filter=options)


def filter_at(trip, t_s, **options):
    """A filter that knows the true state at a time, without a past."""
    config = as_declared(trip, **options)
    fresh = initial.initial_state(config)
    state = State(trip.state(t_s).x, fresh.P, fresh.columns)
    k = round(t_s * RATE_HZ) - 1
    state.x[33:40] = trip.rows[k, :7]
    return Filter(initial.model(config), Memory(state))


def truth(trip, t_s):
    """Antenna at the lever arm: geodetic position, velocity in n, by the emulator's track."""
    eps = 1e-3
    t = np.array([t_s - eps, t_s, t_s + eps])
    pose = trip.truth.pose(t)
    r = pose.r_e + pose.C_eb @ LEVER
    lat, lon, h = earth.ecef_to_lla(r[1])
    return (float(lat), float(lon), float(h)), (r[2] - r[0]) / (2.0 * eps), pose.C_eb[1], r[1]


T_S = 30.0
T_NS = T0_NS + round(T_S * 1e9)
ONES = (1.0, 1.0, 1.0)


def own_measurements(trip):
    """What perfect sensors at `LEVER`, mounted by `C_BS`, say at `T_S`."""
    (lat, lon, h), v_e, C_eb, _ = truth(trip, T_S)
    C_ne = earth.C_en(lat, lon).T
    v_n = (C_ne @ v_e).tolist()
    heading = float(euler_from_C(C_ne @ C_eb @ C_BS)[2])
    return [
        PositionFix(T_NS, "aid", lat, lon, h, ONES),
        PositionFix(T_NS, "aid", lat, lon, None, ONES),
        VelocityFix(T_NS, "aid", *v_n, ONES),
        VelocityFix(T_NS, "aid", v_n[0], v_n[1], None, ONES),
        Depth(T_NS, "aid", h, 1.0),
        BottomVelocity(T_NS, "aid", tuple((C_BS.T @ C_eb.T @ v_e).tolist()), ONES),
        HeadingFix(T_NS, "aid", heading, 1.0),
    ]


def test_perfect_sensors_leave_no_residual(trip):
    """Body rate over a sample, not at its end: a few mm/s over a lever arm of 2 m in a seaway."""
    engine = filter_at(trip, T_S)
    engine.model.mounts["aid"] = Mount(LEVER, C_BS)
    rows = [3, 2, 3, 2, 1, 3, 1]
    for fix, n in zip(own_measurements(trip), rows, strict=True):
        z = observe(engine.model, engine.memory.state, fix, None)
        tolerance = 1e-3 if isinstance(fix, VelocityFix | BottomVelocity) else 2e-7
        assert len(z.residual) == n
        np.testing.assert_allclose(z.residual, 0.0, atol=tolerance, err_msg=str(fix))


def test_a_sensor_that_is_not_named_sits_at_the_imu(trip):
    engine = filter_at(trip, T_S)
    lat, lon, h = (float(v) for v in earth.ecef_to_lla(engine.memory.state.r_e))
    z = observe(engine.model, engine.memory.state, PositionFix(0, "x", lat, lon, h, ONES), None)
    np.testing.assert_allclose(z.residual, 0.0, atol=1e-7)


def test_rest_is_no_velocity(trip):
    engine = filter_at(trip, T_S)
    before = np.linalg.norm(engine.memory.state.v_eb_e)
    verdict = engine.apply(Stationary(T_NS, "imu0", 1e-3), None)
    assert not verdict.accepted  # at 4 m/s the gate knows better
    engine.memory.state.P[3:6, 3:6] += 25.0 * np.eye(3)
    assert engine.apply(Stationary(T_NS, "imu0", 1e-3), None).accepted
    assert np.linalg.norm(engine.memory.state.v_eb_e) < 1e-3 * before


@pytest.mark.parametrize("by_element", [False, True])
def test_radial_rates_of_elements(trip, by_element):
    """Distances of the true elements at two moments, a moored beacon between."""
    engine = filter_at(trip, T_S)
    array = engine.model.arrays["usbl0"]
    array = type(array)(array.geometry, array.sigma, 0.02, np.array(ELEMENTS), by_element)
    engine.model.arrays["usbl0"] = array
    beacon = engine.model.beacons["1"].r_e
    eps = 1e-3
    pose = trip.truth.pose(np.array([T_S - eps, T_S + eps]))
    levers = LEVER + np.array(ELEMENTS) @ array.geometry.C_bu.T
    places = pose.r_e[:, None] + np.einsum("nij,kj->nki", pose.C_eb, levers)
    distance = np.linalg.norm(places - beacon, axis=-1)
    rates = (distance[1] - distance[0]) / (2.0 * eps)
    assert np.ptp(rates) > 1e-4
    z = observe(
        engine.model, engine.memory.state, RadialRate(T_NS, "usbl0", "1", tuple(rates)), None
    )
    assert len(z.residual) == (4 if by_element else 1)
    np.testing.assert_allclose(z.residual, 0.0, atol=1e-3)
    np.testing.assert_allclose(np.diag(z.R), 0.02**2 / (1 if by_element else 4))
    mean = observe(
        engine.model, engine.memory.state, RadialRate(T_NS, "usbl0", "1", (rates.mean(),)), None
    )
    assert mean.R[0, 0] == pytest.approx(0.02**2)
    two = RadialRate(T_NS, "usbl0", "1", (1.0, 2.0))
    assert observe(engine.model, engine.memory.state, two, None) == "elements"


def test_ranges_of_one_ping_are_each_at_their_own_reception(trip):
    """A stated transmission and one that follows from the range are the same moment here."""
    config = configuration(trip.scenario)
    fresh = initial.initial_state(config)
    engine = Filter(initial.model(config), Memory(State(trip.state(0.0).x, fresh.P, fresh.columns)))
    timeline = Timeline(engine, RATE_HZ, 10.0, slice_=None)
    heard = trip.heard
    k = 10
    t_rx = T0_NS + round(heard.t_rx[k] * 1e9)
    t_tx = T0_NS + round(heard.t_tx[k] * 1e9)
    sailed = trip.t_ns <= t_rx + 500_000_000
    timeline.extend(trip.t_ns[sailed], trip.rows[sailed])
    range_m = float(heard.slant_range[k])
    said = BeaconRange(t_rx, "usbl0", "1", range_m, t_tx)
    silent = replace(said, t_transmit_ns=None)
    (one,) = timeline.insert(said, t_rx, repr(said))
    (other,) = timeline.insert(silent, t_rx, repr(silent))
    assert [c.name for c in one.components] == ["range_m"]
    assert one.components[0].value == pytest.approx(0.0, abs=2e-3)
    assert one.accepted and other.accepted
    assert engine.memory.t_used_ns == t_rx


def test_what_has_no_model_is_named(trip):
    engine = filter_at(trip, T_S)
    state = engine.memory.state
    for fix, reason in (
        (BeaconRange(0, "usbl0", "9", 10.0), "unknown_beacon"),
        (RadialRate(0, "sonar", "1", (0.0,)), "unknown_device"),
        (UsblFix(0, "sonar", "1", 0.0, 0.0, 1.0), "unknown_device"),
    ):
        assert observe(engine.model, state, fix, None) == reason
    up = Mount(np.zeros(3), C_from_euler(0.0, np.pi / 2.0, 0.0))
    level = State.at(earth.C_en(0.5, 0.5), np.zeros(3), earth.lla_to_ecef(0.5, 0.5, 0), np.eye(15))
    engine.model.mounts["aid"] = up
    assert observe(engine.model, level, HeadingFix(0, "aid", 0.0, 0.1), None) == "geometry"


def test_only_what_locates_tells_of_a_lock_out(trip):
    engine = filter_at(trip, T_S)
    for _ in range(3 * LOCK_OUT):
        assert engine.apply(Depth(T_NS, "aid", 1e4, 0.1), None).reason == "gate"
    assert engine.memory.refused_in_a_row == 0
    assert engine.memory.gated == 3 * LOCK_OUT
    h = float(earth.ecef_to_lla(engine.memory.state.r_e)[2])
    assert engine.apply(Depth(T_NS, "aid", h, 0.1), None).accepted
    assert engine.memory.t_used_ns is None
    far = PositionFix(T_NS, "aid", 0.0, 0.0, None, ONES)
    for _ in range(2):
        engine.apply(far, None)
    assert engine.apply(Depth(T_NS, "aid", h, 0.1), None).accepted
    assert engine.memory.refused_in_a_row == 2


def sailed(trip, options, **changes):
    """Every fix of the trip, some changed or (None) left out, through a filter with options."""
    config = as_declared(trip, **options)
    fresh = initial.initial_state(config)
    state = State(trip.state(0.0).x, fresh.P, fresh.columns)
    engine = Filter(initial.model(config), Memory(state))
    timeline = Timeline(engine, RATE_HZ, 10.0, slice_=None)
    verdicts = []
    for k, fix in enumerate(trip.fixes):
        if (changed := changes.get(f"fix{k}", fix)) is not None:
            timeline.insert(changed, fix.t_ns, str(k))
    for begin in range(0, len(trip.t_ns), 50):
        part = slice(begin, begin + 50)
        verdicts += timeline.extend(trip.t_ns[part], trip.rows[part])
    return engine, verdicts


def test_loose_and_tight_agree_on_exact_fixes(trip):
    for options in ({"coupling": "loose"}, {"coupling": "loose", "loose_noise": "fixed"}):
        engine, verdicts = sailed(trip, options)
        assert len(verdicts) > 10
        assert all(v.accepted for v in verdicts)
        assert [c.name for c in verdicts[0].components] == ["north_m", "east_m", "down_m"]
        true = trip.truth.pose(np.array([trip.t_imu[-1]])).r_e[0]
        assert np.linalg.norm(engine.memory.state.r_e - true) < 0.05
        assert max(abs(c.value) for v in verdicts for c in v.components) < 0.05


def test_a_fix_that_is_not_whole_is_no_position(trip):
    engine = filter_at(trip, T_S, coupling="loose")
    fix = UsblFix(T_NS, "usbl0", "1", None, None, 200.0)

    class Still:
        def at(self, t_ns):
            return np.concatenate([np.zeros(3), np.eye(3).ravel()])

    assert observe(engine.model, engine.memory.state, fix, Still()) == "geometry"


@pytest.mark.parametrize(("kind", "share"), [("huber", 0.75), ("student_t", 0.5)])
def test_a_robust_filter_moves_less_by_an_outlier(trip, kind, share):
    k = len(trip.fixes) - 1
    fix = trip.fixes[k]
    base = {"innovation_gate": 1.0 - 1e-12}
    bent = replace(fix, slant_range=fix.slant_range + 0.6)
    far = {}
    for name in ("none", kind):
        end = []
        for changed in (fix, bent):
            engine, _ = sailed(trip, base | {"robust": name}, **{f"fix{k}": changed})
            end.append(engine.memory.state.r_e.copy())
        far[name] = np.linalg.norm(end[1] - end[0])
    assert far["none"] > 0.0
    assert far[kind] < share * far["none"]


def test_quality_and_noise_are_part_of_a_snapshot(trip):
    engine, verdicts = sailed(trip, {"adaptive_noise": True})
    saved = engine.save()
    assert verdicts[-1].quality == saved.quality["1"][1] < 0.1  # exact fixes
    assert set(saved.noise) == {"usbl0/elevation_deg", "usbl0/bearing_deg", "usbl0/range_m"}
    assert all(value < 1.0 for value in saved.noise.values())
    before = (saved.quality.copy(), saved.noise.copy())
    engine.memory.quality["1"] = (1, 9.0)
    engine.memory.noise.clear()
    assert (saved.quality, saved.noise) == before
    engine.restore(saved)
    assert (engine.memory.quality, engine.memory.noise) == before


def test_late_fixes_learn_the_same(trip):
    """What is learnt goes back with the history: late arrival changes nothing."""
    options = {"adaptive_noise": True, "robust": "student_t"}
    config = as_declared(trip, **options)
    fresh = initial.initial_state(config)
    late = Filter(initial.model(config), Memory(State(trip.state(0.0).x, fresh.P, fresh.columns)))
    timeline = Timeline(late, RATE_HZ, 10.0, slice_=None)
    for measurement in trip.arrivals(latency_s=3.3):
        if isinstance(measurement, UsblFix):
            timeline.insert(measurement, measurement.t_ns, repr(measurement))
        else:
            t_ns = np.frombuffer(measurement.t_ns, dtype=np.int64)
            timeline.extend(t_ns, np.frombuffer(measurement.rows).reshape(-1, 8))
    assert timeline.counts.late > 10
    came = timeline.counts.late
    again, _ = sailed(trip, options, **{f"fix{k}": None for k in range(came, len(trip.fixes))})
    assert late.memory.noise == pytest.approx(again.memory.noise, rel=1e-9)
    assert late.memory.quality["1"] == pytest.approx(again.memory.quality["1"], rel=1e-9)


def test_every_message_crosses_to_the_worker(trip):
    for fix in [
        *own_measurements(trip),
        Stationary(1, "imu0", 0.1),
        BeaconRange(1, "usbl0", "1", 10.0, None),
        RadialRate(1, "usbl0", "1", (0.5, 0.25)),
        UsblFix(1, "usbl0", "1", 0.1, None, 3.0),
    ]:
        plain = msgspec.convert(msgspec.to_builtins(fix), type(fix))
        assert read_in_worker(encode(fix)) == plain == fix
        assert hash(fix) == hash(plain)


@pytest.mark.parametrize("valid", [True, False])
def test_a_rate_stands_where_the_fix_is_not_valid(trip, valid):
    config = configuration(trip.scenario)
    ingest = UsblIngest("usbl0", config.usbl["usbl0"], config.sound_speed_m_s)
    fields = {"bearing_deg": 10.0, "elevation_deg": -5.0, "slant_range_m": 80.0}
    ingest.take(UsblRecord(t_rx_ns=T_NS, beacon="1", valid=valid, range_rate_m_s=-0.5, **fields))
    *fixes, rate = ingest.flush()
    assert len(fixes) == valid
    assert (rate.beacon, rate.rates) == ("1", (-0.5,))
    assert all(fix.t_ns == rate.t_ns for fix in fixes)
    assert ingest.counts.measurements == 1 + valid
    assert ingest.counts.ignored["invalid"] == (not valid)
