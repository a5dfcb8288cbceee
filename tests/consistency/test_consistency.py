"""The filter claims the errors it has: NEES and NIS inside their chi-squared bounds.

The long form, 100 runs of each error definition: ``pytest -m slow tests/consistency``.
"""

import pytest

from tests.consistency.runs import run, statistics
from tests.gateway.states import NAMES

RUNS = 25


def report(found):
    for s in found:
        print(f"{s.name:26s} {s.value:7.3f}   {s.low:.3f} .. {s.high:.3f}")
    return [s.name for s in found if not s.inside]


def test_a_matched_filter_is_consistent():
    found = statistics([run(seed) for seed in range(RUNS)])
    assert report(found) == []


def test_a_filter_that_trusts_its_angles_too_much_is_found_out():
    """A third of the true angle noise: every statistic leaves its bounds, upwards."""
    found = statistics([run(seed, angle_factor=1.0 / 3.0) for seed in range(10)])
    assert len(report(found)) == len(found)
    assert all(s.value > s.high for s in found)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("error", NAMES)
def test_every_definition_is_consistent_over_a_hundred_runs(error):
    found = statistics([run(seed, error) for seed in range(1000, 1100)])
    assert report(found) == []
