"""Strapdown and covariance prediction against exact increments and plain linear algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from gateway.fusion.errors import FAMILY
from gateway.fusion.state import ATT, BA, BG, N_STATES, POS, VEL, State
from gateway.nav import covariance, earth, strapdown
from gateway.nav.lie import log_so3, skew
from tests.gateway.states import ORIGIN
from tests.gateway.voyages import perfect_rows, trajectory, true_state

QUIET = np.zeros(4)
ADDITIVE = FAMILY["additive"]


def run(state, rows, q=QUIET):
    track = np.empty((len(rows), 12))
    strapdown.run(state.x, state.P, rows, q, track)
    return track


def away(state, truth):
    """Distance (m) and angle (deg) between two states."""
    turn = log_so3(state.C_eb @ truth.C_eb.T)
    return np.linalg.norm(state.r_e - truth.r_e), np.degrees(np.linalg.norm(turn))


# --- gravity ---------------------------------------------------------------------------------


@settings(deadline=None)
@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0), st.floats(-11_000.0, 9_000.0))
def test_what_falls_falls_with_the_earths_gravity(lat_deg, lon_deg, h):
    """A microsecond from rest, sensing nothing: the compiled gravity against the module earth."""
    lat, lon = np.radians([lat_deg, lon_deg])
    C, r = earth.C_en(lat, lon), earth.lla_to_ecef(lat, lon, h)
    state = State.at(np.eye(3), np.zeros(3), r, np.zeros((N_STATES, N_STATES)))
    run(state, np.array([[1e-6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(state.v_eb_e / 1e-6, C @ earth.gravity_n(lat, h), atol=2e-9)


# --- the mean against exact increments of analytic motion ------------------------------------


CHANGES = {"circle": {}, "line": {"course_deg": 80.0}, "spiral": {"descent": 0.2}}


@pytest.mark.parametrize("kind", CHANGES)
@pytest.mark.parametrize("lat_deg", [0.0, 45.0, 75.0, -34.0])
def test_exact_increments_lead_along_the_truth(kind, lat_deg):
    """1000 s at 100 Hz in a seaway of 5 deg, the line across the antimeridian."""
    track = "line" if kind == "line" else "circle"
    truth = trajectory(track, 1000.0, lat_deg=lat_deg, lon_deg=179.9995, **CHANGES[kind])
    state = true_state(truth, 0.0)
    run(state, perfect_rows(truth, 1000.0, 100.0))
    end = true_state(truth, 1000.0)
    metres, degrees = away(state, end)
    assert metres < 0.002
    assert degrees < 1e-6
    assert np.linalg.norm(state.v_eb_e - end.v_eb_e) < 5e-6
    if kind == "line":
        assert (
            earth.ecef_to_lla(end.r_e)[1] < 0.0 < earth.ecef_to_lla(true_state(truth, 0.0).r_e)[1]
        )


@pytest.mark.parametrize("kind", ["circle", "lawnmower"])
def test_errors_fall_with_the_step(kind):
    """Second order and better: half the interval, at most a quarter of the error."""
    truth = trajectory(kind, 60.0)
    end = true_state(truth, 60.0)
    errors = []
    for rate_hz in (25.0, 50.0):
        state = true_state(truth, 0.0)
        run(state, perfect_rows(truth, 60.0, rate_hz))
        errors.append(np.array(away(state, end)))
    assert np.all(errors[1] < errors[0] / 4.0)


def test_biases_are_taken_off():
    truth = trajectory("circle", 60.0)
    rows = perfect_rows(truth, 60.0, 100.0)
    plain, biased = true_state(truth, 0.0), true_state(truth, 0.0)
    bias = np.array([1e-3, -2e-3, 3e-3, 0.1, -0.2, 0.3])
    biased.x[15:21] = bias
    run(plain, rows)
    shifted = rows.copy()
    shifted[:, 1:7] += bias * rows[:, :1]
    # the sample before the first is part of the coning term: it holds the bias too
    run(biased, shifted)
    assert away(plain, biased)[0] < 1e-6
    assert away(plain, biased)[1] < 1e-10


def test_at_rest_nothing_moves():
    truth = trajectory("line", speed_m_s=0.0, ramp_s=0.0, sway={}, lat_deg=60.0)
    state = true_state(truth, 0.0)
    run(state, perfect_rows(truth, 60.0, 10.0))
    assert away(state, true_state(truth, 0.0))[0] < 1e-6


def test_displacement_and_chain_follow_without_feedback():
    """What the track says of the past is the motion between, whatever the state was set to."""
    truth = trajectory("circle", 20.0)
    state = true_state(truth, 0.0)
    state.s_e[:] = (1.0, 2.0, 3.0)
    start = state.copy()
    track = run(state, perfect_rows(truth, 20.0, 100.0))
    np.testing.assert_allclose(state.s_e - start.s_e, state.r_e - start.r_e, atol=1e-6)
    np.testing.assert_allclose(state.chain, state.C_eb, atol=1e-12)
    np.testing.assert_array_equal(track[-1], state.x[21:33])
    half = true_state(truth, 10.0)
    np.testing.assert_allclose(track[999, :3] - (1.0, 2.0, 3.0), half.r_e - start.r_e, atol=1e-4)
    np.testing.assert_allclose(track[999, 3:].reshape(3, 3), half.C_eb, atol=1e-8)


# --- parts of samples ------------------------------------------------------------------------

fractions = st.lists(st.floats(0.001, 0.999), min_size=1, max_size=3, unique=True).map(sorted)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), fractions)
def test_split_samples_lead_to_the_same_place(seed, cuts):
    """One in ten samples in parts: a measurement may fall anywhere."""
    truth = trajectory("circle", 10.0)
    rows = perfect_rows(truth, 5.0, 100.0)
    whole, split = true_state(truth, 0.0), true_state(truth, 0.0)
    whole.P[:] = split.P[:] = 1e-4 * np.diag(np.linspace(0.1, 1.0, N_STATES))
    q = np.array([1e-8, 1e-6, 1e-10, 1e-8])
    run(whole, rows, q)
    chosen = np.random.default_rng(seed).random(len(rows)) < 0.1
    for row, cut in zip(rows, chosen, strict=True):
        ends = [*cuts, 1.0] if cut else [1.0]
        for begin, end in zip([0.0, *ends], ends, strict=False):
            strapdown.advance(split.x, split.P, row, begin, end, q)
    metres, degrees = away(whole, split)
    assert metres < 5e-6
    assert degrees < 1e-10
    np.testing.assert_allclose(split.P, whole.P, rtol=2e-5, atol=1e-10)


@pytest.mark.parametrize("cut", [0.001, 0.3, 0.5, 0.999])
def test_one_split_sample_is_the_whole(cut):
    """Attitude to rounding, velocity to 1e-11 m/s; position to the trapezium's 40 nm at 100 Hz."""
    truth = trajectory("circle", 10.0)
    rows = perfect_rows(truth, 1.0, 100.0)
    whole, split = true_state(truth, 0.0), true_state(truth, 0.0)
    run(whole, rows)
    run(split, rows[:-1])
    strapdown.advance(split.x, split.P, rows[-1], 0.0, cut, QUIET)
    strapdown.advance(split.x, split.P, rows[-1], cut, 1.0, QUIET)
    np.testing.assert_allclose(split.C_eb, whole.C_eb, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(split.v_eb_e, whole.v_eb_e, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(split.r_e, whole.r_e, rtol=0.0, atol=5e-8)
    np.testing.assert_array_equal(split.x[strapdown.LAST], whole.x[strapdown.LAST])


# --- the covariance --------------------------------------------------------------------------


def step_of(state, row):
    """The mean after one sample, and the code's (21, 21) transition over it.

    The last constant goes through a prediction unchanged: correlated with another state, its column
    comes back as the transition's column of that state.
    """
    after, u, C_mid = state.copy(), np.empty(3), np.empty((3, 3))
    strapdown.mechanise(after.x, row, 1.0, u, C_mid)
    Phi, last = np.eye(N_STATES), N_STATES - 1
    for i in range(last):
        P = np.zeros((N_STATES, N_STATES))
        P[i, last] = P[last, i] = 1.0
        covariance.predict(P, row[0], 0.0, u, C_mid, after.r_e, QUIET)
        Phi[:last, i] = P[:last, last]
    return after, Phi, (u, C_mid)


def flow_derivative(state, rows):
    """(21, 21) derivative of the mean's flow over `rows`, central differences."""
    steps = np.repeat([1e-4, 1e-1, 50.0, 1e-4, 1e-1, 1e-3, 1e-3], 3)
    columns = []
    for i, h in enumerate(steps):
        ends = []
        for sign in (1.0, -1.0):
            xi = np.zeros(N_STATES)
            xi[i] = sign * h
            y = ADDITIVE.boxplus(state, xi, ORIGIN)
            run(y, rows)
            ends.append(y)
        columns.append(ADDITIVE.boxminus(ends[0], ends[1], ORIGIN) / (2.0 * h))
    return np.column_stack(columns)


def test_transition_over_one_sample_is_the_derivative_of_the_mean():
    """Left out in 10 ms: the coning term's bias, C's curvature; position rows: rounding of ECEF."""
    truth = trajectory("circle", 20.0)
    rows = perfect_rows(truth, 10.0, 100.0)
    state = true_state(truth, 0.0)
    run(state, rows[:-1])
    _, Phi, _ = step_of(state, rows[-1])
    left_out = np.abs(Phi - flow_derivative(state, rows[-1:]))
    assert left_out[ATT].max() < 1e-8
    assert left_out[VEL].max() < 2e-7
    assert left_out[POS].max() < 1e-5
    assert left_out[POS, VEL].max() < 2e-8
    assert left_out[VEL, POS].max() < 0.01 * np.abs(Phi[VEL, POS]).max()  # gravity's gradient
    np.testing.assert_array_equal(left_out[9:], 0.0)
    np.testing.assert_array_equal(Phi[15:], np.eye(N_STATES)[15:])


@pytest.mark.parametrize("kind", ["circle", "line"])
def test_covariance_over_ten_seconds_is_that_of_the_flow(kind):
    """P(10 s) = Phi P Phi^T with Phi by differences of the whole flow: 2e-3 of each sigma."""
    truth = trajectory(kind, 20.0)
    rows = perfect_rows(truth, 10.0, 100.0)
    state = true_state(truth, 0.0)
    sigma = np.repeat([1e-3, 0.1, 5.0, 1e-5, 5e-3, 0.01, 0.02], 3)
    state.P[:] = np.diag(sigma**2)
    Phi = flow_derivative(state, rows)
    run(state, rows)
    exact = Phi @ np.diag(sigma**2) @ Phi.T
    scale = np.sqrt(np.outer(exact.diagonal(), exact.diagonal()))
    np.testing.assert_allclose(state.P / scale, exact / scale, atol=2e-3)


def test_prediction_is_phi_p_phi_and_q():
    """The block kernel against dense matrices, with any covariance and missing data."""
    rng = np.random.default_rng(1)
    truth = trajectory("circle", 20.0)
    rows = perfect_rows(truth, 1.0, 100.0)
    state = true_state(truth, 0.0)
    L = rng.normal(0.0, 1.0, (N_STATES, N_STATES))
    P = L @ L.T
    after, Phi, (u, C_mid) = step_of(state, rows[0])
    q, dt, missing = np.array([0.3, 0.5, 0.7, 0.11]), 0.01, 0.4
    Q = np.zeros(N_STATES)
    Q[:15] = np.repeat([q[0] * dt, q[1] * dt, 0.0, q[2] * dt, q[3] * dt], 3)
    Q[ATT] += covariance.GAP_TURN * missing**3 / 3.0
    Q[VEL] += covariance.GAP_FORCE * missing**3 / 3.0
    expected, up = Phi @ P @ Phi.T, after.r_e / np.linalg.norm(after.r_e)
    level = np.eye(3) - np.outer(up, up)
    force = 0.5 * 9.81 * np.trace(level @ expected[ATT, ATT])
    expected[VEL, VEL] += covariance.TILTED_S * dt * force**2 * np.outer(up, up)
    found = P.copy()
    covariance.predict(found, dt, missing**3 / 3.0, u, C_mid, after.r_e, q)
    np.testing.assert_allclose(found, expected + np.diag(Q), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found, found.T)


@pytest.mark.parametrize("shares", [1, 7, 40])
def test_a_gap_is_as_blind_in_many_shares_as_in_one(shares):
    """At rest, against the closed form for a rate and a force that walk back from its end.

    The velocity is compared loosely: here the turn walks, there its rate.
    """
    truth = trajectory("line", speed_m_s=0.0, ramp_s=0.0, sway={})
    gap_s = 1.6
    row = perfect_rows(truth, gap_s, 1.0 / gap_s)[0]
    row[7] = gap_s
    state = true_state(truth, 0.0)
    for k in range(shares):
        strapdown.advance(state.x, state.P, row, k / shares, (k + 1) / shares, QUIET)
    walked = np.array([covariance.GAP_TURN, covariance.GAP_FORCE]) * gap_s**3 / 3.0
    fallen = 9.8**2 * covariance.GAP_TURN * gap_s**5 * 2.0 / 15.0
    C = earth.C_en(*earth.ecef_to_lla(state.r_e)[:2])
    turned, gained = (np.diag(C.T @ state.P[b, b] @ C) for b in (ATT, VEL))
    np.testing.assert_allclose(turned, walked[0], rtol=1e-3)
    bent = gained[2] - walked[1]
    assert 0.0 < bent < 0.1 * walked[1]  # what gravity turned by comes to in second order
    np.testing.assert_allclose(np.sqrt(gained[:2]), np.sqrt(walked[1] + fallen), rtol=0.1)


def test_noise_grows_as_the_continuous_model_says():
    """A minute from P = 0 against Van Loan's integral of the continuous model at rest."""
    truth = trajectory("line", speed_m_s=0.0, ramp_s=0.0, sway={})
    rows, t = perfect_rows(truth, 60.0, 50.0), 60.0
    state = true_state(truth, 0.0)
    q = np.array([1e-8, 1e-6, 1e-12, 1e-8])
    run(state, rows, q)
    omega, f = (a[0] for a in truth.inertial(np.array([30.0])))
    C = true_state(truth, 30.0).C_eb
    W, up = skew(np.array([0.0, 0.0, earth.OMEGA_IE])), state.r_e / np.linalg.norm(state.r_e)
    G = -9.81 / np.linalg.norm(state.r_e) * (np.eye(3) - 3.0 * np.outer(up, up))
    F = np.zeros((15, 15))
    F[ATT, ATT], F[ATT, BG] = -W, -C
    F[VEL, ATT], F[VEL, VEL], F[VEL, POS], F[VEL, BA] = -skew(C @ f), -2.0 * W, G, -C
    F[POS, VEL] = np.eye(3)
    Qc = np.diag(np.repeat([q[0], q[1], 0.0, q[2], q[3]], 3))
    M = expm(np.block([[-F, Qc], [np.zeros((15, 15)), F.T]]) * t)
    exact = M[15:, 15:].T @ M[:15, 15:]
    scale = np.sqrt(np.outer(exact.diagonal(), exact.diagonal()))
    np.testing.assert_allclose(state.P[:15, :15] / scale, exact / scale, atol=2e-3)
    assert np.linalg.norm(omega) == pytest.approx(earth.OMEGA_IE)


def test_a_gap_costs_what_a_seaway_may_have_done():
    """Two seconds without data: some degrees and decimetres a second, far more than the noise."""
    truth = trajectory("circle", 20.0)
    state = true_state(truth, 0.0)
    row = np.array([2.0, *(200.0 * perfect_rows(truth, 0.01, 100.0)[0, 1:7]), 1.99])
    run(state, row[None, :], np.array([1e-12, 1e-10, 0.0, 0.0]))
    sd = np.sqrt(state.P.diagonal())
    assert 2.0 < np.degrees(sd[ATT]).max() < 10.0
    assert 0.2 < sd[VEL].max() < 2.0
