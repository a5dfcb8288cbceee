"""Euler angles against scipy's rotations and against hand-turned axes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gateway.nav.attitude import C_from_euler, euler_from_C

RNG = np.random.default_rng(2)
ROLL, HEADING = RNG.uniform(-np.pi, np.pi, (2, 1000))
PITCH = RNG.uniform(-1.57, 1.57, 1000)


def test_matrix_is_heading_then_pitch_then_roll():
    oracle = Rotation.from_euler("ZYX", np.column_stack([HEADING, PITCH, ROLL])).as_matrix()
    np.testing.assert_allclose(C_from_euler(ROLL, PITCH, HEADING), oracle, atol=1e-15)


def test_signs_in_words():
    forward, right = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    turned_east = C_from_euler(0.0, 0.0, np.pi / 2) @ forward
    np.testing.assert_allclose(turned_east, [0, 1, 0], atol=1e-15)
    assert (C_from_euler(0.0, 0.1, 0.0) @ forward)[2] < 0, "positive pitch lifts the bow"
    assert (C_from_euler(0.1, 0.0, 0.0) @ right)[2] > 0, "positive roll dips starboard"


def test_angles_come_back():
    roll, pitch, heading = euler_from_C(C_from_euler(ROLL, PITCH, HEADING))
    np.testing.assert_allclose(np.exp(1j * roll), np.exp(1j * ROLL), atol=1e-12)
    np.testing.assert_allclose(pitch, PITCH, atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * heading), np.exp(1j * HEADING), atol=1e-12)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_straight_up_or_down_keeps_the_rotation(pitch):
    C = Rotation.from_euler("ZYX", [0.7, pitch, 0.2]).as_matrix()
    C[0, 0] = C[1, 0] = C[2, 1] = C[2, 2] = 0.0
    roll, found_pitch, heading = euler_from_C(C)
    assert roll == 0.0
    assert found_pitch == pytest.approx(pitch)
    np.testing.assert_allclose(C_from_euler(roll, found_pitch, heading), C, atol=1e-12)
