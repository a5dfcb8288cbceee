"""The smoother: against least squares, against the filter, and true to its covariance."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.stats

from gateway.fusion import initial
from gateway.fusion.errors import FAMILY
from gateway.fusion.memory import Memory
from gateway.fusion.observation import observe
from gateway.fusion.recording import RecordingFilter
from gateway.fusion.smoother import between, smooth
from gateway.fusion.state import State
from gateway.nav import strapdown, transition
from gateway.timeline import Timeline
from tests.gateway.emulated import SWAY, demo_data, make
from tests.gateway.voyages import T0_NS, Voyage, configuration

RATE_HZ = 50.0
DURATION_S = 120.0
LAWNMOWER = {
    "type": "lawnmower",
    "lat_deg": 39.7993,
    "lon_deg": 116.2,
    "height_m": -10.0,
    "course_deg": 30.0,
    "leg_m": 60.0,
    "spacing_m": 30.0,
    "speed_m_s": 3.0,
    "sway": SWAY,
}


@cache
def voyage(seed):
    data = demo_data() | {"duration_s": DURATION_S, "seed": seed, "trajectory": LAWNMOWER}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    data["devices"]["usbl0"] |= {
        "outliers": {},
        "prior": {"mounting_deg": 0.3, "range_scale": 0.005},
    }
    return Voyage(make(data))


def record(trip, definition="right_invariant", **changes):
    """The forward pass over a voyage, its fixes in the order of time."""
    config = configuration(trip.scenario, filter={"error": definition})
    model = replace(initial.model(config), **changes)
    engine = RecordingFilter(model, Memory(initial.initial_state(config)))
    timeline = Timeline(engine, RATE_HZ, 10.0, slice_=None)
    for fix in trip.fixes:
        timeline.insert(fix, fix.t_ns, repr(fix))
    for k in range(0, len(trip.t_ns), 50):
        timeline.extend(trip.t_ns[k : k + 50], trip.rows[k : k + 50])
    engine.close()
    return engine


def errors_of(trip, engine, states, at):
    """Error (estimate minus truth) and covariance of each state, in the filter's own definition."""
    for state, n in zip(states, at, strict=True):
        truth = State(trip.state(n / RATE_HZ).x, state.P, state.columns)
        xi = engine.model.error.boxminus(state, truth, engine.origin_e)
        T = np.eye(len(xi))
        T[:9, :9] = np.linalg.inv(engine.model.error.to_additive(state, engine.origin_e))
        yield xi, T @ state.P @ T.T


def score(seed, definition="right_invariant"):
    """NEES of the smoother at each epoch, and squared position errors of filter and smoother."""
    trip = voyage(seed)
    engine = record(trip, definition)
    states = smooth(engine)
    at = range(100, round(DURATION_S * RATE_HZ), 500)
    nees = [
        xi @ np.linalg.solve(P, xi) / len(xi)
        for xi, P in errors_of(trip, engine, between(engine, states, at), at)
    ]
    truth = trip.truth.pose(np.array([knot.position / RATE_HZ for knot in engine.knots])).r_e
    squares = [
        np.mean(np.sum((np.array([state.r_e for state in those]) - truth) ** 2, axis=1))
        for those in ([knot.after for knot in engine.knots], states)
    ]
    return np.array(nees), squares


def bounds(runs, dof=21, inside=0.99):
    """Chi-squared bounds of the mean NEES of a degree of freedom; a run's epochs count as one."""
    tails = np.array([(1 - inside) / 2, (1 + inside) / 2])
    return scipy.stats.chi2.ppf(tails, runs * dof) / (runs * dof)


@pytest.mark.parametrize("definition", sorted(FAMILY))
def test_it_beats_the_filter_and_is_true_to_its_covariance(definition):
    runs = 10
    scores = [score(seed, definition) for seed in range(runs)]
    low, high = bounds(runs)
    assert low < np.mean([nees for nees, _ in scores]) < high
    filtered, smoothed = np.mean([squares for _, squares in scores], axis=0)
    assert np.sqrt(smoothed / filtered) < 0.6


@pytest.mark.slow
def test_fifty_runs_are_true_to_their_covariance():
    runs = 50
    nees = np.mean([score(seed)[0] for seed in range(runs)])
    low, high = bounds(runs, inside=0.95)
    assert low < nees < high


def test_a_filter_told_of_too_little_noise_smooths_to_a_covariance_that_fails():
    """The scale of every white noise, measurements' and the IMU's, taken four times too small."""
    nees = []
    for seed in range(4):
        trip = voyage(seed)
        config = configuration(trip.scenario)
        model = initial.model(config)
        array = model.arrays["usbl0"]
        sure = {"usbl0": replace(array, sigma=array.sigma / 4.0)}
        engine = record(trip, arrays=sure, q=model.q / 16.0, gate=1.0 - 1e-15)
        at = [3000]
        ((xi, P),) = errors_of(trip, engine, between(engine, smooth(engine), at), at)
        nees.append(xi @ np.linalg.solve(P, xi) / len(xi))
    assert np.mean(nees) > bounds(4)[1]


def test_constants_are_the_same_everywhere():
    engine = record(voyage(1))
    states = smooth(engine)
    for state in states[:-1]:
        np.testing.assert_allclose(state.constants, states[-1].constants, rtol=1e-6, atol=1e-12)
    sd = np.array([np.sqrt(state.P.diagonal()[9:]) for state in states])
    np.testing.assert_allclose(sd, np.broadcast_to(sd[-1], sd.shape), rtol=1e-4)


def test_it_ends_where_the_filter_ends():
    engine = record(voyage(1))
    last = smooth(engine)[-1]
    np.testing.assert_array_equal(last.x, engine.memory.state.x)
    np.testing.assert_array_equal(last.P, engine.memory.state.P)


@pytest.mark.parametrize("definition", sorted(FAMILY))
def test_without_process_noise_it_is_the_last_state_carried_back(definition):
    """The oracle is the strapdown: from the first smoothed state it must reach the last one."""
    engine = record(voyage(2), definition, q=np.zeros(4))
    states = smooth(engine)
    x, P = states[0].x.copy(), np.zeros((15, 15))
    track = np.empty((engine.consumed, 12))
    strapdown.run(x, P, engine.rows, np.zeros(4), track)
    last = states[-1]
    assert np.linalg.norm(x[strapdown.R_E] - last.r_e) < 0.02
    assert np.linalg.norm(x[strapdown.V_EB_E] - last.v_eb_e) < 5e-4
    assert np.abs(x[strapdown.C_EB] - last.x[strapdown.C_EB]).max() < 2e-6
    moved = np.linalg.norm(states[0].r_e - engine.knots[0].after.r_e)
    assert moved > 1.0, "the first state was nothing to improve"


def test_without_process_noise_its_covariance_is_that_of_least_squares():
    """Information of all fixes, carried to the start by the transitions."""
    engine = record(voyage(2), "additive", q=np.zeros(4), echoes=0.0)
    states = smooth(engine)
    information = np.linalg.inv(engine.knots[0].after.P)
    Phi = np.eye(len(information))
    used = 0
    for knot, state in zip(engine.knots[1:], states[1:], strict=True):
        Phi = knot.Phi @ Phi
        if knot.use is not None:
            z = observe(engine.model, state, knot.use.fix, knot.use.past)
            H = z.H @ Phi
            information += H.T @ np.linalg.solve(z.R, H)
            used += 1
    assert used > 50
    expected = np.sqrt(np.linalg.inv(information).diagonal())
    np.testing.assert_allclose(np.sqrt(states[0].P.diagonal()), expected, rtol=0.03)


def test_between_knots_nothing_leaps():
    """At every sample: the steps of the position differ from velocity times time by millimetres."""
    engine = record(voyage(3))
    states = between(engine, smooth(engine), range(1000, 1400))
    r = np.array([state.r_e for state in states])
    v = np.array([state.v_eb_e for state in states])
    step = np.diff(r, axis=0) - 0.5 * (v[1:] + v[:-1]) / RATE_HZ
    assert np.linalg.norm(step, axis=1).max() < 3e-3
    sd = np.array([np.sqrt(state.P.diagonal()[6:9]) for state in states])
    assert np.abs(np.diff(sd, axis=0)).max() < 2e-3


def test_recording_leaves_the_filter_as_it_is():
    """Bit for bit, the transition beside it is only noted."""
    trip = voyage(1)
    plain = initial.initial_state(configuration(trip.scenario))
    noted, Phi, q = plain.copy(), transition.identity(), np.full(4, 1e-9)
    track = np.empty((2, 200, 12))
    P0 = plain.P.copy()
    strapdown.run(plain.x, plain.P, trip.rows[:200], q, track[0])
    transition.run(noted.x, noted.P, Phi, trip.rows[:200], q, track[1])
    np.testing.assert_array_equal(noted.x, plain.x)
    np.testing.assert_array_equal(noted.P, plain.P)
    np.testing.assert_array_equal(track[1], track[0])
    whole = transition.whole(Phi, len(P0))
    Q = noted.P - whole @ P0 @ whole.T
    assert np.linalg.eigvalsh(Q[:6, :6]).min() > 0.0


def test_a_late_measurement_is_a_bug():
    trip = voyage(1)
    engine = RecordingFilter(
        initial.model(configuration(trip.scenario)),
        Memory(initial.initial_state(configuration(trip.scenario))),
    )
    timeline = Timeline(engine, RATE_HZ, 10.0, slice_=None)
    timeline.extend(trip.t_ns[:500], trip.rows[:500])
    with pytest.raises(AssertionError, match="late"):
        timeline.insert(trip.fixes[2], T0_NS + 3_000_000_000, "late")
