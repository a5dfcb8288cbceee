"""Fixes that a topside has levelled, turned north or placed: the filter claims the errors it has.

The long form, 100 runs of each definition: ``pytest -m slow tests/consistency/test_topside.py``.
"""

import pytest

from tests.consistency.runs import statistics
from tests.consistency.test_consistency import report
from tests.consistency.topside import JUDGED_S, run
from tests.gateway.states import NAMES

BY_ITSELF = [("level", False), ("north", False)]
BY_US = [("level", True), ("north", True), ("place", True)]


@pytest.mark.parametrize("words", ["level", "north"])
def test_what_a_topside_turned_by_its_own_sensor_is_consistent(words):
    found = statistics([run(seed, words) for seed in range(4)], judged_s=JUDGED_S)
    assert report(found) == []


def test_a_filter_that_takes_the_sensor_for_three_times_as_bad_is_found_out():
    found = statistics([run(0, "north", sensor=3.0)], judged_s=JUDGED_S)
    (nis,) = [s for s in found if s.name == "NIS"]
    assert nis.value < nis.low


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("error", NAMES)
@pytest.mark.parametrize(("words", "follows"), BY_ITSELF + BY_US)
def test_every_definition_is_consistent_over_a_hundred_runs(words, follows, error):
    found = statistics(
        [run(seed, words, error, follows) for seed in range(1000, 1100)], judged_s=JUDGED_S
    )
    assert report(found) == []
