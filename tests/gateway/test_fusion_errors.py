"""The error family against the group it is named for: 5 x 5 matrices and their exponential."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from gateway.fusion.errors import FAMILY
from gateway.fusion.state import ATT, N_FULL, POS, VEL
from gateway.nav.lie import skew
from tests.gateway.states import NAMES, ORIGIN, derivative, error_map, random_state

patient = settings(deadline=None)
seeds = st.integers(0, 2**32 - 1)
names = st.sampled_from(NAMES)


def group(state):
    """SE2(3) matrix of attitude, velocity and position from the local origin."""
    X = np.eye(5)
    X[:3, :3], X[:3, 3], X[:3, 4] = state.C_eb, state.v_eb_e, state.r_e - ORIGIN
    return X


def wedge(xi):
    W = np.zeros((5, 5))
    W[:3, :3], W[:3, 3], W[:3, 4] = skew(xi[ATT]), xi[VEL], xi[POS]
    return W


def random_error(rng, angle):
    xi = rng.normal(0.0, 1.0, N_FULL)
    xi[ATT] *= angle / np.linalg.norm(xi[ATT])
    xi[VEL] *= 3.0
    xi[POS] *= 100.0
    xi[9:] *= 0.1
    return xi


@patient
@given(seeds, st.floats(0.0, 3.1))
def test_right_invariant_is_the_exponential_on_the_left(seed, angle):
    rng = np.random.default_rng(seed)
    x, xi = random_state(rng), random_error(rng, angle)
    y = FAMILY["right_invariant"].boxplus(x, xi, ORIGIN)
    np.testing.assert_allclose(group(y), expm(wedge(xi)) @ group(x), atol=3e-8)


@patient
@given(seeds, st.floats(0.0, 3.1))
def test_left_invariant_is_the_exponential_on_the_right(seed, angle):
    rng = np.random.default_rng(seed)
    x, xi = random_state(rng), random_error(rng, angle)
    y = FAMILY["left_invariant"].boxplus(x, xi, ORIGIN)
    np.testing.assert_allclose(group(y), group(x) @ expm(wedge(xi)), atol=3e-8)


@patient
@given(seeds, st.floats(0.0, 3.1))
def test_additive_adds_and_turns_on_the_left(seed, angle):
    rng = np.random.default_rng(seed)
    x, xi = random_state(rng), random_error(rng, angle)
    y = FAMILY["additive"].boxplus(x, xi, ORIGIN)
    np.testing.assert_allclose(y.C_eb, expm(skew(xi[ATT])) @ x.C_eb, atol=1e-13)
    np.testing.assert_array_equal(y.v_eb_e, x.v_eb_e + xi[VEL])
    np.testing.assert_array_equal(y.r_e, x.r_e + xi[POS])


@patient
@given(names, seeds, st.one_of(st.just(0.0), st.floats(0.0, 3.1)))
def test_boxminus_undoes_boxplus(name, seed, angle):
    rng = np.random.default_rng(seed)
    x, xi = random_state(rng), random_error(rng, angle)
    back = FAMILY[name].boxminus(FAMILY[name].boxplus(x, xi, ORIGIN), x, ORIGIN)
    np.testing.assert_allclose(back[ATT], xi[ATT], atol=1e-12)
    np.testing.assert_allclose(back[VEL], xi[VEL], atol=1e-11)
    np.testing.assert_allclose(back[POS], xi[POS], atol=3e-8)
    np.testing.assert_allclose(back[9:], xi[9:], atol=1e-15)


@patient
@given(names, seeds)
def test_boxplus_undoes_boxminus(name, seed):
    """Between states that have nothing to do with each other."""
    rng = np.random.default_rng(seed)
    x, y = random_state(rng), random_state(rng)
    back = FAMILY[name].boxplus(x, FAMILY[name].boxminus(y, x, ORIGIN), ORIGIN)
    np.testing.assert_allclose(back.C_eb, y.C_eb, atol=1e-12)
    np.testing.assert_allclose(back.v_eb_e, y.v_eb_e, atol=1e-9)
    np.testing.assert_allclose(back.r_e, y.r_e, atol=1e-6)
    np.testing.assert_allclose(back.constants, y.constants, atol=1e-15)


@pytest.mark.parametrize("name", NAMES)
def test_constants_are_additive_and_alone(name):
    rng = np.random.default_rng(1)
    x = random_state(rng)
    xi = np.zeros(N_FULL)
    xi[9:] = rng.normal(0.0, 1.0, 16)
    y = FAMILY[name].boxplus(x, xi, ORIGIN)
    np.testing.assert_allclose(y.constants, x.constants + xi[9:], atol=1e-15)
    np.testing.assert_allclose(y.C_eb, x.C_eb, atol=1e-15)
    np.testing.assert_allclose(y.v_eb_e, x.v_eb_e, atol=1e-14)
    np.testing.assert_allclose(y.r_e, x.r_e, atol=2e-9)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(5))
def test_map_to_additive_is_the_derivative_at_zero(name, seed):
    """At phi = 0 with velocity and position far from zero, where a wrong T would show."""
    x = random_state(np.random.default_rng(seed))
    additive = FAMILY["additive"]
    T = derivative(lambda y: additive.boxminus(y, x, ORIGIN), x, FAMILY[name])
    np.testing.assert_allclose(T, error_map(FAMILY[name], x), rtol=1e-7, atol=3e-5)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("part", [VEL, POS])
def test_without_rotation_the_translation_stays(name, part):
    """phi = 0 exactly with v and r not 0: a small-angle branch must not drop the translation."""
    x = random_state(np.random.default_rng(2))
    xi = np.zeros(N_FULL)
    xi[part] = (1.0, -2.0, 0.5)
    y = FAMILY[name].boxplus(x, xi, ORIGIN)
    moved = x.C_eb @ xi[part] if name == "left_invariant" else xi[part]
    found = (y.v_eb_e - x.v_eb_e) if part is VEL else (y.r_e - x.r_e)
    np.testing.assert_allclose(found, moved, atol=1e-8)


def test_what_invariant_means():
    """The same motion applied to both states leaves the error alone: on the left or the right."""
    rng = np.random.default_rng(3)
    x, y, g = (random_state(rng) for _ in range(3))

    def moved(state, left):
        X = group(g) @ group(state) if left else group(state) @ group(g)
        out = state.copy()
        out.C_eb[:], out.v_eb_e[:], out.r_e[:] = X[:3, :3], X[:3, 3], ORIGIN + X[:3, 4]
        return out

    for name, left in (("left_invariant", True), ("right_invariant", False)):
        error = FAMILY[name].boxminus(y, x, ORIGIN)
        again = FAMILY[name].boxminus(moved(y, left), moved(x, left), ORIGIN)
        np.testing.assert_allclose(again, error, rtol=1e-9, atol=1e-7)
