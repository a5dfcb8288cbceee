"""The compiled words of a state against those of the functions for arrays."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.nav import attitude, earth
from gateway.nav.geodetic import words

ANGLE = st.floats(-np.pi, np.pi)


def mean(lat, lon, h, euler, v_n):
    """A mean vector with that pose."""
    C_en = earth.C_en(lat, lon)
    x = np.zeros(40)
    x[:9] = (C_en @ attitude.C_from_euler(*euler)).ravel()
    x[9:12] = C_en @ v_n
    x[12:15] = earth.lla_to_ecef(lat, lon, h)
    return x


def covariance(seed):
    A = np.random.default_rng(seed).standard_normal((15, 15))
    return A @ A.T


def arc(P, block, down):
    """What (M.51) adds to a block."""
    variance = down @ P[:3, :3] @ down
    chord = P[block, :3] @ down / variance
    off = 1.5 - 2.0 * np.exp(-variance / 2.0) + np.exp(-2.0 * variance) / 2.0
    return off * np.outer(np.cross(down, chord), np.cross(down, chord))


@settings(max_examples=200, deadline=None)
@given(
    st.floats(-1.57, 1.57),
    ANGLE,
    st.floats(-1e4, 1e5),
    st.tuples(ANGLE, st.floats(-1.5, 1.5), ANGLE),
    st.integers(0, 1000),
)
def test_words_are_those_of_the_formulas(lat, lon, h, euler, seed):
    v_n, P = np.array([3.0, -2.0, 0.5]), covariance(seed)
    w = words(mean(lat, lon, h, euler, v_n), P)
    assert w[0] == pytest.approx(lat, abs=1e-14)
    assert np.exp(1j * w[1]) == pytest.approx(np.exp(1j * lon), abs=1e-14)
    assert w[2] == pytest.approx(h, abs=1e-7)
    np.testing.assert_allclose(w[3:6], v_n, atol=1e-13)
    np.testing.assert_allclose(np.exp(1j * w[6:9]), np.exp(1j * np.array(euler)), atol=1e-13)
    assert 0.0 <= w[8] <= 2.0 * np.pi
    C = earth.C_en(lat, lon)
    P_pos, P_vel = (C.T @ (P[s, s] + arc(P, s, C[:, 2])) @ C for s in (slice(6, 9), slice(3, 6)))
    E = np.linalg.inv(attitude.euler_error_map(euler[1], euler[2])) @ C.T
    P_att = E @ P[:3, :3] @ E.T
    for at, block in ((9, P_pos), (12, P_vel), (15, P_att)):
        np.testing.assert_allclose(w[at : at + 3], np.sqrt(block.diagonal()), rtol=1e-9)
    assert w[18] == pytest.approx(P_pos[0, 1], abs=1e-11)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_straight_up_and_down_have_numbers(pitch):
    w = words(mean(0.7, 0.3, 0.0, (0.4, pitch, 1.0), np.zeros(3)), covariance(1))
    assert np.isfinite(w).all()
    assert w[7] == pytest.approx(pitch)


def test_a_variance_that_rounding_made_negative_is_no_sigma_at_all():
    w = words(mean(0.7, 0.3, 0.0, (0.1, 0.2, 1.0), np.zeros(3)), -1e-20 * np.eye(15))
    assert (w[9:18] == 0.0).all()


def test_a_place_that_turns_with_the_heading_is_claimed_as_far_off_as_it_lies():
    """2 deg of heading, 800 m south of a beacon whose range is known: 1 m along the range."""
    lat, lon, sd, range_m = 0.7, 0.3, np.radians(2.0), 800.0
    x, C = mean(lat, lon, 0.0, (0.0, 0.0, 0.0), np.zeros(3)), earth.C_en(lat, lon)
    by_heading = np.concatenate([C[:, 2], np.zeros(3), range_m * C[:, 1]])
    P = sd**2 * np.outer(by_heading, by_heading)
    turned = sd * np.random.default_rng(1).standard_normal(20_000)
    off = range_m * np.column_stack([1.0 - np.cos(turned), np.sin(turned)])
    rms_m = np.sqrt((off**2).mean(axis=0))
    np.testing.assert_allclose(words(x, P)[9:11], rms_m, rtol=0.03)
    assert rms_m[0] > 0.8
    assert C[:, 0] @ P[6:9, 6:9] @ C[:, 0] < 1e-12
