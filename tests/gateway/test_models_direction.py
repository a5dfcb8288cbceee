"""Directions by time differences, against plane waves that cross an array."""

import numpy as np
import pytest

from gateway.fusion.direction_cosines import direction, in_range

SPEED = 1500.0
CROSS = np.array([[0.10, 0.0], [0.0, 0.12]])
ROUND = np.array([[0.10, 0.0], [0.05, 0.08], [-0.05, 0.08], [0.0, -0.12]])


def delays(baselines, elevation, bearing):
    """When a plane wave from there reaches the far elements: sooner by the path to the front."""
    towards = np.array([np.cos(bearing), np.sin(bearing)]) * np.cos(elevation)
    return -baselines @ towards / SPEED


@pytest.mark.parametrize("baselines", [CROSS, ROUND])
@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize("elevation_deg", [0.5, 30.0, 75.0])
@pytest.mark.parametrize("bearing_deg", [-170.0, -45.0, 0.0, 100.0])
def test_a_plane_wave_comes_from_where_it_came(baselines, below, elevation_deg, bearing_deg):
    elevation = np.radians(-elevation_deg if below else elevation_deg)
    heard = delays(baselines, elevation, np.radians(bearing_deg))
    found = direction(baselines, heard, SPEED, below=below)
    np.testing.assert_allclose(np.degrees(found), [np.degrees(elevation), bearing_deg], atol=1e-9)


def test_time_differences_that_contradict_each_other_are_no_direction():
    x, y = -CROSS.diagonal() / SPEED
    assert direction(CROSS, np.array([0.999999 * x, 0.0]), SPEED).elevation > -0.002
    assert direction(CROSS, np.array([0.8 * x, 0.7 * y]), SPEED) is None
    assert direction(CROSS, np.array([1.001 * x, 0.0]), SPEED) is None
    assert direction(CROSS, np.array([np.nan, 0.0]), SPEED) is None


def test_elements_on_one_line_give_no_direction():
    baselines = np.array([[0.1, 0.0], [0.2, 0.0]])
    assert direction(baselines, np.array([1e-5, 2e-5]), SPEED) is None


def test_straight_below_any_bearing_will_do():
    assert direction(CROSS, np.zeros(2), SPEED).elevation == pytest.approx(-np.pi / 2)


def test_ranges():
    assert in_range(100.0, 1.0, 500.0)
    assert not in_range(0.4, 1.0, 500.0)
    assert not in_range(501.0, 1.0, 500.0)
    assert not in_range(float("nan"), 1.0, 500.0)
