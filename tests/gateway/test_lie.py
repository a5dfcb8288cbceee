"""SO(3): identities, and scipy's rotations as another opinion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from gateway.nav.lie import exp_so3, left_jacobian, log_so3, orthonormal, skew

patient = settings(deadline=None)
I3 = np.eye(3)
components = st.floats(-1.0, 1.0)
axes = (
    st.tuples(components, components, components)
    .map(np.array)
    .filter(lambda a: np.linalg.norm(a) > 1e-3)
    .map(lambda a: a / np.linalg.norm(a))
)
angles = st.one_of(
    st.floats(0.0, np.pi),
    st.floats(-12.0, 0.4971).map(lambda e: 10.0**e),  # every order of magnitude up to pi
    st.floats(-12.0, -1.0).map(lambda e: np.pi - 10.0**e),
    st.sampled_from([0.0, 1e-4, np.nextafter(1e-4, 0.0), np.pi]),
)


@patient
@given(axes, angles)
def test_exp_is_the_matrix_exponential(axis, angle):
    C = exp_so3(angle * axis)
    np.testing.assert_allclose(C, Rotation.from_rotvec(angle * axis).as_matrix(), atol=5e-16 * 4)
    np.testing.assert_allclose(C, expm(skew(angle * axis)), atol=1e-14)


@patient
@given(axes, angles)
def test_exp_is_a_rotation(axis, angle):
    C = exp_so3(angle * axis)
    np.testing.assert_allclose(C @ C.T, I3, atol=2e-15)
    assert np.linalg.det(C) == pytest.approx(1.0, abs=2e-15)
    np.testing.assert_allclose(C @ axis, axis, atol=2e-15)


def test_nothing_turns_nothing():
    zero = np.zeros(3)
    np.testing.assert_array_equal(exp_so3(zero), I3)
    np.testing.assert_array_equal(left_jacobian(zero), I3)
    np.testing.assert_array_equal(log_so3(I3), zero)


@patient
@given(axes, angles)
def test_log_undoes_exp(axis, angle):
    phi = angle * axis
    found = log_so3(exp_so3(phi))
    assert np.linalg.norm(found) <= np.pi * (1.0 + 1e-15)
    if np.pi - angle < 1e-6:  # both signs of the axis name (nearly) the same rotation
        phi = phi if phi @ found > 0.0 else -phi * (2.0 * np.pi / angle - 1.0)
    np.testing.assert_allclose(found, phi, atol=1e-14)


@patient
@given(axes, angles, axes)
def test_conjugation_turns_the_axis(axis, angle, other):
    C = exp_so3(angle * axis)
    np.testing.assert_allclose(exp_so3(C @ other), C @ exp_so3(other) @ C.T, atol=1e-14)


def mean_rotation(phi):
    """The integral of Exp(s phi) for s from 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    turns = Rotation.from_rotvec(np.outer(0.5 * (1.0 + nodes), phi)).as_matrix()
    return np.einsum("k,kij->ij", 0.5 * weights, turns)


@patient
@given(axes, angles)
def test_left_jacobian_is_the_mean_of_the_rotations_on_the_way(axis, angle):
    found = left_jacobian(angle * axis)
    np.testing.assert_allclose(found, mean_rotation(angle * axis), atol=1e-14)


def test_left_jacobian_cancels_no_digits_at_small_angles():
    for angle in np.logspace(-5.0, 0.0, 500):
        phi = angle * np.array([0.6, -0.48, 0.64])
        np.testing.assert_allclose(left_jacobian(phi), mean_rotation(phi), atol=2e-15)


@patient
@given(axes, st.floats(0.0, 3.0), axes)
def test_left_jacobian_is_the_derivative_of_exp(axis, angle, direction):
    phi, h = angle * axis, 1e-4
    ahead, behind = exp_so3(phi + h * direction), exp_so3(phi - h * direction)
    difference = log_so3(ahead @ behind.T) / (2.0 * h)
    np.testing.assert_allclose(left_jacobian(phi) @ direction, difference, atol=2e-8)


@patient
@given(axes, angles)
def test_left_jacobian_and_exp(axis, angle):
    """J(phi) [phi]x = Exp(phi) - I, and J(-phi) = J(phi)^T."""
    phi = angle * axis
    J = left_jacobian(phi)
    np.testing.assert_allclose(J @ skew(phi), exp_so3(phi) - I3, atol=1e-14)
    np.testing.assert_allclose(left_jacobian(-phi), J.T, atol=1e-15)


@patient
@given(axes, axes)
def test_skew_is_the_cross_product(a, b):
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-15)


@patient
@given(axes, angles, st.integers(0, 2**32 - 1))
def test_orthonormal_takes_rounding_off(axis, angle, seed):
    C = exp_so3(angle * axis)
    drifted = C + np.random.default_rng(seed).uniform(-1e-8, 1e-8, (3, 3))
    back = orthonormal(drifted)
    np.testing.assert_allclose(back @ back.T, I3, atol=1e-14)
    np.testing.assert_allclose(back, C, atol=2e-8)
