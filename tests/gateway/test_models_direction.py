"""Directions by time differences, against plane waves that cross an array."""

import numpy as np
import pytest

from gateway.fusion.direction_cosines import Baselines, Delays, direction, in_range

SPEED = 1500.0
BASELINES = Baselines(0.10, 0.12)


def delays(elevation, bearing):
    """When a plane wave from there reaches the elements: sooner by the path to the front of it."""
    towards = np.array(
        [np.cos(elevation) * np.cos(bearing), np.cos(elevation) * np.sin(bearing), 0.0]
    )
    ends = np.array([[BASELINES.x, 0.0, 0.0], [0.0, BASELINES.y, 0.0]])
    return Delays(*(ends @ towards / SPEED))


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize("elevation_deg", [0.5, 30.0, 75.0])
@pytest.mark.parametrize("bearing_deg", [-170.0, -45.0, 0.0, 100.0])
def test_a_plane_wave_comes_from_where_it_came(below, elevation_deg, bearing_deg):
    elevation = np.radians(-elevation_deg if below else elevation_deg)
    found = direction(delays(elevation, np.radians(bearing_deg)), BASELINES, SPEED, below=below)
    np.testing.assert_allclose(np.degrees(found), [np.degrees(elevation), bearing_deg], atol=1e-9)


def test_time_differences_that_contradict_each_other_are_no_direction():
    longest = Delays(BASELINES.x / SPEED, BASELINES.y / SPEED)
    assert direction(Delays(longest.x, 0.0), BASELINES, SPEED).elevation == pytest.approx(0.0)
    assert direction(Delays(0.8 * longest.x, 0.7 * longest.y), BASELINES, SPEED) is None
    assert direction(Delays(1.001 * longest.x, 0.0), BASELINES, SPEED) is None
    assert direction(Delays(float("nan"), 0.0), BASELINES, SPEED) is None


def test_straight_below_any_bearing_will_do():
    assert direction(Delays(0.0, 0.0), BASELINES, SPEED).elevation == pytest.approx(-np.pi / 2)


def test_ranges():
    assert in_range(100.0, 1.0, 500.0)
    assert not in_range(0.4, 1.0, 500.0)
    assert not in_range(501.0, 1.0, 500.0)
    assert not in_range(float("nan"), 1.0, 500.0)
