"""Weights, qualities and learnt noise against what their definitions say of drawn innovations."""

import numpy as np
import pytest
from scipy import stats

from gateway.fusion import robust
from gateway.fusion.kalman import Linearised


@pytest.mark.parametrize("rows", [1, 3])
def test_a_likely_innovation_keeps_its_weight(rows):
    likely = stats.chi2.ppf(0.9, rows)
    assert robust.inflation("none", 1e6, rows) == 1.0
    assert robust.inflation("huber", likely, rows) == 1.0
    assert robust.inflation("student_t", float(rows), rows) == 1.0


@pytest.mark.parametrize("kind", ["huber", "student_t"])
def test_the_influence_of_an_outlier_is_bounded(kind):
    """Noise times f divides the correction of a certain state by f: its length must not grow."""
    lengths = [d / robust.inflation(kind, d * d, 1) for d in np.linspace(0.1, 1e3, 400)]
    assert max(lengths) < 2.5
    assert robust.inflation(kind, 16.0, 1) > 1.5


def test_student_t_gives_up_on_what_is_far_off():
    assert 1e3 / robust.inflation("student_t", 1e6, 1) < 0.01
    assert 1e3 / robust.inflation("huber", 1e6, 1) == pytest.approx(1.96, abs=0.01)


def test_quality_of_a_beacon_as_declared_is_one():
    rng = np.random.default_rng(1)
    quality = (0, 0.0)
    found = []
    for nis in rng.chisquare(3, 4000):
        quality = robust.updated_quality(quality, nis, 3)
        found.append(quality[1])
    assert np.mean(found[50:]) == pytest.approx(1.0, abs=0.05)
    quality = robust.updated_quality(quality, 1e9, 3)
    assert quality[1] < 7.0  # one echo does not condemn a beacon
    for _ in range(60):
        quality = robust.updated_quality(quality, 27.0, 3)
    assert quality[1] > 7.0


def test_the_first_fix_is_the_whole_mean():
    assert robust.updated_quality((0, 0.0), 6.0, 3) == (1, 2.0)
    assert robust.updated_quality((1, 2.0), 0.0, 3) == (2, 1.0)


def innovations(rng, true_sigma, explained, n):
    """Rows of variance `explained` by the state and a noise that is not the declared one."""
    S = np.diag(explained + true_sigma**2)
    for _ in range(n):
        yield rng.multivariate_normal(np.zeros(len(true_sigma)), S), explained


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.5])
def test_noise_is_learnt_in_its_rows(factor):
    rng = np.random.default_rng(2)
    declared = np.array([0.2, 1.0])
    true = declared * np.array([factor, 1.0])
    noise: dict[str, float] = {}
    means = []
    for nu, explained in innovations(rng, true, 0.3 * declared**2, 3000):
        z = Linearised(nu, np.zeros((2, 15)), np.diag(declared**2), ("bearing_deg", "range_m"))
        z = robust.rescaled(z, "usbl0", noise)
        robust.learn_noise(noise, "usbl0", z, np.diag(explained) + z.R)
        means.append([noise["usbl0/bearing_deg"], noise["usbl0/range_m"]])
    found = np.mean(means[500:], axis=0)
    assert found[0] == pytest.approx(factor**2, rel=0.15)
    assert found[1] == pytest.approx(1.0, rel=0.15)


def test_learnt_noise_is_bounded():
    noise: dict[str, float] = {}
    for nu, bound in ((1e3, 9.0), (0.0, 1.0 / 9.0)):
        for _ in range(400):
            z = Linearised(np.array([nu]), np.zeros((1, 15)), np.eye(1), ("range_m",))
            z = robust.rescaled(z, "usbl0", noise)
            robust.learn_noise(noise, "usbl0", z, z.R)
        assert noise["usbl0/range_m"] == pytest.approx(bound)


def test_an_uncertain_state_says_nothing_of_the_noise():
    noise: dict[str, float] = {}
    z = Linearised(np.array([50.0]), np.zeros((1, 15)), np.eye(1), ("range_m",))
    robust.learn_noise(noise, "usbl0", z, np.eye(1) * 1e4)
    assert noise["usbl0/range_m"] == pytest.approx(1.0, abs=1e-4)
