"""The line below delays: against brute force over all lines, its sigma against its errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.clock.envelope import Before, Envelope, line_below

PRIOR = Before()
points = st.lists(
    st.tuples(st.floats(0.0, 60.0), st.floats(0.0, 0.1)),
    min_size=4,
    max_size=15,
    unique_by=lambda p: round(p[0], 3),
).map(sorted)


def brute_force(x, r, at):
    """Height at `at`, slope and sigma over a grid of lines, each weighed one by one.

    Delays e thin out as exp(-e/s)/s, and any scale s is as likely as any other: the product over
    all points, integrated over s, is the sum of the delays to the power of -n.
    """
    heights = np.linspace(-0.006, 0.0015, 1201)
    slopes = np.linspace(-250e-6, 250e-6, 401)
    a, b = np.meshgrid(heights, slopes, indexing="ij")
    e = r[:, None, None] - a - b * (x - at)[:, None, None]
    weight = np.where((e >= 0.0).all(axis=0), e.sum(axis=0), np.inf) ** -float(x.size)
    weight *= (1.0 + (b / PRIOR.scale) ** 2 / 3.0) ** -2
    weight /= weight.sum()
    height, slope = (weight * a).sum(), (weight * b).sum()
    return height, slope, np.sqrt((weight * (a - height) ** 2).sum())


@pytest.mark.parametrize("seed", range(4))
def test_the_line_is_the_mean_of_all_that_may_be(seed):
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(0.0, 30.0, 12))
    r = 20e-6 * (x - 30.0) + 0.001 * rng.exponential(size=x.size)
    line, _ = line_below(x, r, 30.0, PRIOR)
    height, slope, sigma = brute_force(x, r, 30.0)
    assert line.height == pytest.approx(height, abs=1e-5)
    assert line.slope == pytest.approx(slope, abs=1e-6)
    assert line.sigma == pytest.approx(sigma, rel=0.1)


@settings(deadline=None, max_examples=50)
@given(points, st.floats(0.0, 100.0))
def test_no_point_is_below_the_line(given_points, at):
    x, r = np.array(given_points).T
    line, jitter = line_below(x, r, at, PRIOR)
    assert np.all(r - (line.height + line.slope * (x - at)) > -1e-9)
    assert line.sigma > 0.0
    assert jitter > 0.0


@pytest.mark.parametrize("slope", [0.0, 50e-6, -900e-6])
def test_without_delays_the_line_is_the_truth(slope):
    x = np.arange(30.0)
    line, jitter = line_below(x, 3.0 + slope * x, 30.0, PRIOR)
    assert line.height == pytest.approx(3.0 + slope * 30.0, abs=1e-6)
    assert line.slope == pytest.approx(slope, abs=1e-7)
    assert line.sigma < 1e-6
    assert jitter < 2e-6


@pytest.mark.parametrize("n", [8, 30, 60])
def test_sigma_is_that_of_the_errors(n):
    """Over 300 seeds the squared error is on the mean that which is claimed."""
    rng = np.random.default_rng(n)
    ratios = []
    for _ in range(300):
        drift = 30e-6 * rng.standard_normal()
        x = 2.0 * np.arange(n)
        r = drift * x + 0.005 * rng.exponential(size=n)
        line, _ = line_below(x, r, x[-1], PRIOR)
        ratios.append((line.height - drift * x[-1]) / line.sigma)
    assert 0.7 < np.mean(np.square(ratios)) < 1.3


def test_a_stray_delay_does_not_blur_the_line():
    lines = []
    for stray in (0.0, 3.0):
        rng = np.random.default_rng(1)
        envelope = Envelope(PRIOR)
        for k in range(60):
            delay = 1e-3 * rng.exponential() + stray * (k == 30)
            envelope.add(2.0 * k, delay, delay - envelope.height(2.0 * k))
            if envelope.owes:
                envelope.fit()
        lines.append(envelope.line)
    assert lines[1].sigma < 1.2 * lines[0].sigma
    assert lines[1].height == pytest.approx(lines[0].height, abs=3.0 * lines[0].sigma)
