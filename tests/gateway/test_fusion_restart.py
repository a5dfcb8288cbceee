"""A saved state after a time away: the model against an integrated one, a filter against truth."""

import math

import msgspec
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from gateway.estimator import Estimator
from gateway.fusion.restart import LONG_ABSENCE_S, WANDER_M_S, WANDER_S, inflate
from gateway.fusion.state import ATT, BG, N_MEAN, POS, VEL
from gateway.messages import NavSolution, SavedState
from gateway.modes import Mode
from gateway.nav import strapdown as sd
from gateway.nav.earth import C_en, lla_to_ecef
from tests.gateway.test_estimator_start import MOWING, aligning, scenario
from tests.gateway.voyages import Voyage

Q = np.array([1e-12, 1e-8, 1e-20, 1e-14])


def saved(P: np.ndarray, v_e: np.ndarray) -> SavedState:
    x = np.zeros(N_MEAN)
    x[sd.C_EB] = np.eye(3).ravel()
    x[sd.V_EB_E] = v_e
    x[sd.R_E] = lla_to_ecef(0.7, 2.0, 0.0)
    x[sd.LAST] = 1.0
    columns = np.arange(len(P)).tobytes()
    return SavedState(5, x.tobytes(), P.tobytes(), columns, 3, 2, 1, 4)


def opened(state: SavedState) -> tuple[np.ndarray, np.ndarray]:
    n = len(state.columns) // 8
    return np.frombuffer(state.x), np.frombuffer(state.P).reshape(n, n)


def random_covariance(rng: np.random.Generator, n: int = 21) -> np.ndarray:
    A = rng.normal(0.0, 1.0, (n, n)) * 1e-2
    return A @ A.T


def test_no_time_away_changes_nothing_but_what_only_the_next_sample_knows():
    P = random_covariance(np.random.default_rng(1))
    x, P_after = opened(inflate(saved(P, np.array([1.0, 2.0, 0.5])), 0.0, Q))
    before, _ = opened(saved(P, np.array([1.0, 2.0, 0.5])))
    np.testing.assert_allclose(P_after, P, atol=1e-16)
    assert x[: sd.LAST.start].tolist() == before[: sd.LAST.start].tolist()
    assert not x[sd.LAST].any()


@pytest.mark.parametrize("away_s", [1e-3, 2.0, 60.0, 300.0])
def test_position_and_velocity_are_those_of_an_integrated_gauss_markov_velocity(away_s):
    """Van Loan's matrix exponential gives transition and noise at once."""
    P = random_covariance(np.random.default_rng(2))
    v = np.array([0.5, -0.5, 0.1])
    A = np.array([[-1.0 / WANDER_S, 0.0], [1.0, 0.0]])
    G = np.diag([2.0 * WANDER_M_S**2 / WANDER_S, 0.0])
    M = expm(np.block([[-A, G], [np.zeros((2, 2)), A.T]]) * away_s)
    Phi = M[2:, 2:].T
    Qd = Phi @ M[:2, 2:]
    x, P_after = opened(inflate(saved(P, v), away_s, Q))
    start, _ = opened(saved(P, v))
    np.testing.assert_allclose(x[sd.V_EB_E], Phi[0, 0] * v, rtol=1e-9)
    np.testing.assert_allclose(x[sd.R_E] - start[sd.R_E], Phi[1, 0] * v, atol=1e-8)
    for axis in range(3):
        both = [VEL.start + axis, POS.start + axis]
        expected = Phi @ P[np.ix_(both, both)] @ Phi.T + Qd
        np.testing.assert_allclose(P_after[np.ix_(both, both)], expected, rtol=1e-6, atol=1e-9)


def test_a_long_time_forgets_the_heading_and_keeps_the_instruments():
    P = random_covariance(np.random.default_rng(3)) * 1e-2
    away_s = 30 * 86400.0
    _, P_after = opened(inflate(saved(P, np.zeros(3)), away_s, Q))
    C = C_en(0.7, 2.0)
    sd_deg = np.degrees(np.sqrt(np.diagonal(C.T @ P_after[ATT, ATT] @ C)))
    assert sd_deg == pytest.approx([5.0, 5.0, 180.0 / math.sqrt(3.0)])
    np.testing.assert_allclose(P_after[BG, BG] - P[BG, BG], np.eye(3) * Q[2] * away_s, atol=1e-16)
    np.testing.assert_array_equal(P_after[15:, 15:], P[15:, 15:])
    assert np.linalg.eigvalsh(P_after).min() > 0.0


def test_nothing_is_claimed_until_a_fix_is_used():
    after = inflate(saved(random_covariance(np.random.default_rng(4)), np.zeros(3)), 2.5, Q)
    assert (after.t_ns, after.t_used_ns) == (2_500_000_005, None)
    assert (after.refused_in_a_row, after.used, after.gated) == (0, 3, 2)


def taken_up(seed: int, away_s: float, inflated: bool) -> tuple[float, list[NavSolution], Voyage]:
    """A voyage whose gateway is away from the 60th second on, in a turn for the most part.

    Gives the normalised square of the first position's error after it, and the solutions.
    """
    voyage = Voyage(scenario(MOWING, 300 + seed, 60.0 + away_s + 150.0))
    config = aligning(voyage, heading="config", level_s=10)
    arrivals = list(voyage.arrivals(0.5, 0.5))
    first, state = Estimator(config, 1.0), None
    t_cut = voyage.t_ns[0] + 60e9
    for measurement in (m for m in arrivals if _time(m) < t_cut):
        for output in first.feed(measurement):
            state = output if isinstance(output, SavedState) else state
    assert state is not None
    t_back = t_cut + away_s * 1e9
    if not inflated:
        state = msgspec.structs.replace(state, t_ns=int(t_back))
    second = Estimator(config, 1.0, state)
    said = [o for m in arrivals if _time(m) >= t_back for o in second.feed(m)]
    solutions = [o for o in said if isinstance(o, NavSolution)]
    at = np.array([(solutions[0].t_ns - voyage.t_ns[0]) * 1e-9 + voyage.t_imu[0]])
    truth, s = voyage.truth.geodetic(at), solutions[0]
    north = (s.lat - truth.lat[0]) * 6.36e6
    east = (s.lon - truth.lon[0]) * 6.38e6 * math.cos(s.lat)
    S = np.array([[s.sd_position[0] ** 2, s.cov_ne], [s.cov_ne, s.sd_position[1] ** 2]])
    d = np.array([north, east])
    return float(d @ np.linalg.solve(S, d)), solutions, voyage


def _time(measurement) -> int:
    t = measurement.t_ns
    return int(np.frombuffer(t, dtype=np.int64)[-1]) if isinstance(t, bytes) else t


@pytest.mark.parametrize("away_s", [3.0, 20.0])
def test_a_vehicle_that_turned_unseen_is_found_again(away_s):
    """By its fixes after a short absence, by an alignment after a long one."""
    squares = []
    for seed in range(3):
        square, solutions, voyage = taken_up(seed, away_s, inflated=True)
        squares.append(square)
        aligned = next(n for n, s in enumerate(solutions) if s.mode is Mode.AIDED)
        assert (aligned > 9) == (away_s > LONG_ABSENCE_S)  # a solution a second, a level of 10 s
        last = solutions[-1]
        truth = voyage.truth.geodetic(
            np.array([(last.t_ns - voyage.t_ns[0]) * 1e-9 + voyage.t_imu[0]])
        )
        heading = (last.heading - truth.heading[0] + math.pi) % (2 * math.pi) - math.pi
        assert last.mode is Mode.AIDED
        assert abs(math.degrees(heading)) < 2.0
        assert abs(heading) < 3.5 * last.sd_attitude[2]
    assert np.sum(squares) < chi2.ppf(0.999, 2 * len(squares))


def test_without_inflation_it_would_claim_what_it_does_not_know():
    assert taken_up(0, 20.0, inflated=False)[0] > 100.0
