"""The update against least squares, solved in one go."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from gateway.fusion.errors import FAMILY
from gateway.fusion.kalman import Linearised, innovation_covariance, normalised_square, update
from gateway.fusion.state import ATT, N_FULL
from tests.gateway.states import NAMES, ORIGIN, error_map, random_state


def covariance(rng, n, sigma=1.0):
    """A random, fully correlated covariance."""
    L = rng.normal(0.0, 1.0, (n, n))
    return sigma**2 * (L @ L.T / n + 0.1 * np.eye(n))


def measurement(rng, m=3, sigma=0.5):
    names = tuple(f"row_{i}" for i in range(m))
    H = rng.normal(0.0, 1.0, (m, N_FULL))
    return Linearised(rng.normal(0.0, 1.0, m), H, covariance(rng, m, sigma), names)


def least_squares(P, H, R, residual):
    """Error xi that explains ``residual = H xi - noise`` with prior P, and its covariance."""
    prior, weight = np.linalg.inv(np.linalg.cholesky(P)), np.linalg.inv(np.linalg.cholesky(R))
    stacked = np.vstack([prior, weight @ H])
    right = np.concatenate([np.zeros(len(P)), weight @ residual])
    xi = np.linalg.lstsq(stacked, right)[0]
    return xi, np.linalg.inv(stacked.T @ stacked)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_one_update_is_least_squares_in_the_coordinates_of_the_error(name, seed):
    rng = np.random.default_rng(seed)
    definition, state = FAMILY[name], random_state(rng)
    T = error_map(definition, state)
    P = covariance(rng, N_FULL, 0.1)
    state.P[:] = T @ P @ T.T
    z = measurement(rng)
    xi, P_after = least_squares(P, z.H @ T, z.R, z.residual)
    before = state.copy()
    update(state, z, definition, ORIGIN)
    found = definition.boxminus(state, before, ORIGIN)
    np.testing.assert_allclose(found, -xi, rtol=1e-6, atol=3e-8)
    after = np.linalg.inv(error_map(definition, state))
    scale = np.sqrt(np.outer(P_after.diagonal(), P_after.diagonal()))
    np.testing.assert_allclose(after @ state.P @ after.T / scale, P_after / scale, atol=1e-6)


def test_many_updates_are_one_batch():
    """A linear problem: attitude unmeasured and uncorrelated, twenty fixes of three rows."""
    rng = np.random.default_rng(4)
    state = random_state(rng)
    state.P[:] = covariance(rng, N_FULL)
    state.P[ATT, 3:] = state.P[3:, ATT] = 0.0
    prior, start = state.P.copy(), state.copy()
    truth = rng.normal(0.0, 1.0, N_FULL)  # estimate minus truth, before any update
    truth[ATT] = 0.0
    rows, noises, covariances = [], [], []
    for _ in range(20):
        z = measurement(rng)
        H = z.H
        H[:, ATT] = 0.0
        noise = np.linalg.cholesky(z.R) @ rng.normal(0.0, 1.0, 3)
        moved = FAMILY["additive"].boxminus(state, start, ORIGIN)
        z = replace(z, residual=H @ (truth + moved) - noise)
        update(state, z, FAMILY["additive"], ORIGIN)
        rows.append(H)
        noises.append(noise)
        covariances.append(z.R)
    H = np.vstack(rows)
    R = np.zeros((60, 60))
    for i, block in enumerate(covariances):
        R[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    xi, P_after = least_squares(prior, H, R, H @ truth - np.concatenate(noises))
    moved = FAMILY["additive"].boxminus(state, start, ORIGIN)
    np.testing.assert_allclose(moved, -xi, rtol=1e-7, atol=2e-8)
    np.testing.assert_allclose(state.P, P_after, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_covariance_stays_symmetric_and_positive(name):
    """The same direction to 1 mm over and over, from 1 km: where P - K H P would go negative."""
    rng = np.random.default_rng(5)
    state = random_state(rng)
    sigma = np.repeat([1e-2, 1.0, 1e3, 1e-8, 1e-4, 1e-2, 1e-2, 1.0, 1e-2], [3] * 8 + [1])
    state.P[:] = np.diag(sigma**2)
    H = np.zeros((1, N_FULL))
    H[0, 6:9] = (0.6, 0.0, 0.8)
    z = Linearised(np.zeros(1), H, np.array([[1e-6]]), ("along_m",))
    for _ in range(50):
        update(state, z, FAMILY[name], ORIGIN)
        np.testing.assert_array_equal(state.P, state.P.T)
        assert np.all(state.P.diagonal() > 0.0)
        assert np.linalg.eigvalsh(state.P / np.outer(sigma, sigma)).min() > -1e-15


@pytest.mark.parametrize("name", NAMES)
def test_definitions_agree_to_first_order(name):
    """The same small update in any coordinates: what differs is of second order in the step."""
    rng = np.random.default_rng(6)
    start = random_state(rng)
    start.P[:] = covariance(rng, N_FULL, 1e-4)
    z = measurement(rng)
    z = replace(z, residual=1e-4 * z.residual, R=1e-8 * z.R)
    reference, other = start.copy(), start.copy()
    update(reference, z, FAMILY["additive"], ORIGIN)
    update(other, z, FAMILY[name], ORIGIN)
    step = np.abs(FAMILY["additive"].boxminus(reference, start, ORIGIN)).max()
    apart = FAMILY["additive"].boxminus(other, reference, ORIGIN)
    lever = np.linalg.norm(start.r_e - ORIGIN)
    assert np.abs(apart).max() < lever * step**2
    assert step > 1e-5


def test_without_residual_only_the_covariance_changes():
    rng = np.random.default_rng(7)
    state = random_state(rng)
    state.P[:] = covariance(rng, N_FULL)
    before = state.copy()
    z = measurement(rng)
    update(state, replace(z, residual=np.zeros(3)), FAMILY["right_invariant"], ORIGIN)
    np.testing.assert_allclose(state.x, before.x, rtol=0.0, atol=2e-9)
    assert np.all(state.P.diagonal() <= before.P.diagonal())
    assert state.P.trace() < before.P.trace()


def test_normalised_square_is_chi_squared():
    rng = np.random.default_rng(8)
    P = covariance(rng, N_FULL)
    z = measurement(rng)
    S = innovation_covariance(P, z)
    np.testing.assert_allclose(S, z.H @ P @ z.H.T + z.R, rtol=1e-12)
    L = np.linalg.cholesky(P), np.linalg.cholesky(z.R)
    n = 4000
    residuals = (
        z.H @ L[0] @ rng.normal(0.0, 1.0, (N_FULL, n)) - L[1] @ rng.normal(0.0, 1.0, (3, n))
    ).T
    squares = [normalised_square(r, S) for r in residuals]
    low, high = chi2.ppf([0.001, 0.999], 3 * n) / n
    assert low < np.mean(squares) < high
    assert np.mean(np.array(squares) > chi2.ppf(0.95, 3)) == pytest.approx(0.05, abs=0.012)
