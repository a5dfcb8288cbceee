"""Measurements in their place in time: split samples, ties, refusals, a history that is bounded."""

import pytest

from gateway.order import Refusal
from gateway.timeline import LOOK_BACK_S, MAX_WAITING
from tests.gateway.ledgers import RATE_HZ, at, ledger, samples


@pytest.mark.parametrize("early", [True, False])
def test_a_measurement_between_samples_splits_one(early):
    engine, timeline = ledger()
    if not early:
        timeline.extend(*samples(0, 100))
    for t in (30.25, 30.75, 31.0, 31.5):
        timeline.insert(f"m{t}", at(t), f"m{t}")
    if early:
        timeline.extend(*samples(0, 100))
    assert engine.seen == [(f"m{t}", t) for t in (30.25, 30.75, 31.0, 31.5)]
    assert engine.sum == pytest.approx(100.0)


def test_ties_do_not_depend_on_arrival():
    orders = []
    for keys in ("abc", "cab", "bca"):
        engine, timeline = ledger()
        timeline.extend(*samples(0, 60))
        for name in keys:
            timeline.insert(name, at(42.5), name)
        orders.append(engine.seen)
    assert orders[0] == [("a", 42.5), ("b", 42.5), ("c", 42.5)]
    assert orders[1] == orders[2] == orders[0]


def test_a_duplicate_is_counted_and_not_used_twice():
    engine, timeline = ledger()
    timeline.insert("m", at(70.0), "m")
    assert timeline.insert("m", at(70.0), "m") is Refusal.DUPLICATE
    timeline.extend(*samples(0, 100))
    assert timeline.insert("m", at(70.0), "m") is Refusal.DUPLICATE
    assert timeline.counts.duplicate == 2
    assert engine.seen == [("m", 70.0)]


def test_older_than_the_history_is_too_late():
    engine, timeline = ledger(history_s=2.0)
    timeline.extend(*samples(0, 1000))
    assert timeline.insert("old", at(799.0), "old") is Refusal.TOO_LATE
    assert timeline.insert("new", at(801.0), "new") == ["new"]
    assert (timeline.counts.too_late, timeline.counts.late) == (1, 1)
    assert engine.sum == pytest.approx(1000.0)


def test_before_the_first_sample_is_too_late_whenever_it_comes():
    engine, timeline = ledger()
    assert timeline.insert("waiting", at(-5.0), "waiting") == []
    timeline.extend(*samples(0, 10))
    assert timeline.insert("after", at(-4.0), "after") is Refusal.TOO_LATE
    timeline.extend(*samples(10, 10))
    assert timeline.counts.too_late == 2
    assert engine.seen == []


def test_a_measurement_at_the_head_is_used_at_once():
    engine, timeline = ledger()
    timeline.extend(*samples(0, 50))
    assert timeline.insert("m", at(50.0), "m") == ["m"]
    timeline.extend(*samples(50, 50))
    assert engine.seen == [("m", 50.0)]
    assert timeline.t_head_ns == at(100.0)


def test_a_verdict_is_given_once_though_history_runs_again():
    _, timeline = ledger()
    timeline.insert("b", at(60.0), "b")
    assert timeline.extend(*samples(0, 100)) == ["b"]
    assert timeline.insert("a", at(40.0), "a") == ["a"]
    assert timeline.insert("c", at(80.0), "c") == ["c"]


@pytest.mark.parametrize("block", [1, 7, 64, 999, 20_000])
def test_blocks_of_any_length_even_longer_than_the_history(block):
    """200 s through a history of 2 s: nothing lost, nothing used twice, in order."""
    engine, timeline = ledger(history_s=2.0)
    times = [k * 37.3 + 0.4 for k in range(530)]
    for t in times:
        timeline.insert(t, at(t), f"{t:012.3f}")
    verdicts = []
    for first in range(0, 20_000, block):
        verdicts += timeline.extend(*samples(first, min(block, 20_000 - first)))
    assert verdicts == times
    assert engine.sum == pytest.approx(20_000.0)
    assert [t for _, t in engine.seen] == pytest.approx(times, abs=1e-5)


def test_history_far_beyond_its_length_still_takes_late_measurements():
    """More than ten times what is kept, a late one each second."""
    engine, timeline = ledger(history_s=2.0)
    expected = []
    for second in range(200):
        timeline.extend(*samples(100 * second, 100))
        t = 100.0 * second + 100.0 - (37.5 if second < 2 else 150.25)
        assert timeline.insert(t, at(t), str(t)) == [t]
        expected.append(t)
    assert sorted(t for _, t in engine.seen) == sorted(expected)
    assert all(m == pytest.approx(t, abs=1e-5) for m, t in engine.seen)
    assert timeline.counts.late == 200


def test_memory_is_bounded():
    _, timeline = ledger(history_s=2.0)
    held = []
    for second in range(100):
        timeline.extend(*samples(100 * second, 100))
        timeline.insert(second, at(100.0 * second + 50.0), str(second))
        held.append((len(timeline._order), len(timeline._snapshots), timeline._history._rows.shape))
    assert max(h[0] for h in held) <= 4
    assert max(h[1] for h in held) <= 2.0 * 4 + 8
    assert len({h[2] for h in held}) == 1
    assert held[0][2][0] < 4 * (2.0 + LOOK_BACK_S) * RATE_HZ


def test_the_track_is_linear_between_samples_and_still_before_the_first():
    _, timeline = ledger()
    timeline.extend(*samples(0, 100))
    assert timeline.at(at(50.0))[0] == pytest.approx(50.0)
    assert timeline.at(at(50.3))[0] == pytest.approx(50.3)
    before = timeline.at(at(-20.0))
    assert before[0] == pytest.approx(-20.0), "the displacement goes on as it began"
    assert before[3] == 0.0, "the attitude does not"


def test_the_track_is_right_after_trimming():
    _, timeline = ledger(history_s=2.0)
    for first in range(0, 10_000, 100):
        timeline.extend(*samples(first, 100))
    for back in (0.0, 100.5, (2.0 + LOOK_BACK_S) * RATE_HZ):
        assert timeline.at(at(10_000.0 - back))[0] == pytest.approx(10_000.0 - back)


def test_too_far_ahead_is_refused_and_so_is_what_waits_with_too_many():
    engine, timeline = ledger(ahead_s=5.0)
    timeline.extend(*samples(0, 100))
    assert timeline.insert("far", at(601.0), "far") is Refusal.TOO_EARLY
    waiting = [600.0 - 0.04 * k for k in range(MAX_WAITING)]
    assert all(timeline.insert(t, at(t), str(t)) == [] for t in waiting)
    assert timeline.insert("one more", at(150.0), "one more") is Refusal.TOO_EARLY
    assert timeline.insert("late", at(50.0), "late") == ["late"], "does not wait"
    assert timeline.counts.too_early == 2
    timeline.extend(*samples(100, 501))
    assert [m for m, _ in engine.seen] == ["late", *reversed(waiting)]


def test_without_samples_few_wait():
    _, timeline = ledger(ahead_s=5.0)
    found = [timeline.insert(t, at(1000.0 * t), str(t)) for t in range(MAX_WAITING + 10)]
    assert found == [[]] * MAX_WAITING + [Refusal.TOO_EARLY] * 10
