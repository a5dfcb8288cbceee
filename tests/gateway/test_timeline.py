"""The order law: whatever the order of arrival, the state is that of the run in order of time."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.fusion import initial
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.order import Refusal
from gateway.timeline import LOOK_BACK_S, MAX_WAITING, SLICE, UPDATE, Timeline
from tests.gateway.emulated import demo_data, make
from tests.gateway.states import same_memory
from tests.gateway.voyages import Voyage, configuration

RATE_HZ = 100.0
STEP_NS = 10_000_000
SECONDS = 6.0
T0 = 1_000_000_000_000


# --- the real filter -------------------------------------------------------------------------


@cache
def voyage():
    """Six seconds with a fix about every half second from three beacons."""
    data = demo_data() | {"duration_s": SECONDS, "seed": 9}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    data["devices"]["usbl0"] |= {"period_s": 0.45, "outliers": {}}
    data["beacons"] = {
        "1": {"lat_deg": 39.8, "lon_deg": 116.2, "height_m": -50.0},
        "2": {"lat_deg": 39.801, "lon_deg": 116.2, "height_m": -50.0, "turnaround_ms": 30.0},
        "3": {"lat_deg": 39.8, "lon_deg": 116.202, "height_m": -60.0, "travel": "one_way"},
    }
    found = Voyage(make(data))
    found.fixes[:] = [fix for fix in found.fixes if fix.t_ns <= found.t_ns[-1]]
    return found, configuration(found.scenario)


def begin(history_s=10.0):
    _, config = voyage()
    filter_ = Filter(initial.model(config), Memory(initial.initial_state(config)))
    return filter_, Timeline(filter_, RATE_HZ, history_s, slice_=None)


def key(fix):
    return f"{fix.beacon}/{fix.bearing}"


@cache
def in_order():
    """State and verdicts with every fix inserted before the samples reach it."""
    trip, _ = voyage()
    filter_, timeline = begin()
    for fix in trip.fixes:
        assert timeline.insert(fix, fix.t_ns, key(fix)) == []
    verdicts = []
    for k in range(len(trip.t_ns)):
        verdicts += timeline.extend(trip.t_ns[k : k + 1], trip.rows[k : k + 1])
    assert [v.t_ns for v in verdicts] == [f.t_ns for f in trip.fixes]
    assert timeline.counts.late == 0
    return filter_.memory, verdicts


N_FIXES = len(voyage()[0].fixes)
delays = st.lists(st.floats(-2.0, SECONDS), min_size=N_FIXES, max_size=N_FIXES)


@settings(max_examples=30, deadline=None)
@given(delays, st.integers(1, 70), st.lists(st.integers(0, N_FIXES - 1), max_size=4))
def test_any_order_of_arrival_gives_the_state_of_the_order_of_time(delays, block, repeated):
    """Early, late by up to the whole run, twice, between blocks of any length."""
    trip, _ = voyage()
    filter_, timeline = begin()
    arrivals = [
        (f.t_ns + d * 1e9, k) for k, (f, d) in enumerate(zip(trip.fixes, delays, strict=True))
    ]
    arrivals += [(arrivals[k][0] + 1e8, k) for k in repeated]
    arrivals.sort()
    verdicts, refused = [], 0

    def offer():
        nonlocal refused
        fix = trip.fixes[arrivals.pop(0)[1]]
        found = timeline.insert(fix, fix.t_ns, key(fix))
        refused += isinstance(found, Refusal)
        verdicts.extend([] if isinstance(found, Refusal) else found)

    for k in range(0, len(trip.t_ns), block):
        while arrivals and arrivals[0][0] <= trip.t_ns[k]:
            offer()
        verdicts += timeline.extend(trip.t_ns[k : k + block], trip.rows[k : k + block])
    while arrivals:
        offer()
    same_memory(filter_.memory, in_order()[0])
    assert refused == timeline.counts.duplicate == len(repeated)
    assert timeline.counts.too_late == 0
    assert sorted(v.t_ns for v in verdicts) == [f.t_ns for f in trip.fixes], "one verdict each"


def test_a_late_verdict_is_what_it_would_have_been():
    """All fixes after the last sample, newest first: the last one in tells the whole truth."""
    trip, _ = voyage()
    filter_, timeline = begin()
    timeline.extend(trip.t_ns, trip.rows)
    for fix in reversed(trip.fixes):
        (verdict,) = timeline.insert(fix, fix.t_ns, key(fix))
    assert timeline.counts.late == N_FIXES
    same_memory(filter_.memory, in_order()[0])
    assert verdict.nis == pytest.approx(in_order()[1][0].nis, rel=1e-9)


def test_the_track_says_where_the_ping_left():
    trip, _ = voyage()
    filter_, timeline = begin()
    timeline.extend(trip.t_ns, trip.rows)
    start = trip.t_ns[0]
    for t_s in (0.5, 1.234, 5.0):
        found = timeline.at(start + round(t_s * 1e9)) - timeline.at(start)
        moved = filter_.memory.state.r_e - trip.state(SECONDS).r_e  # the initial error
        truth = trip.state(t_s + trip.t_imu[0]).r_e - trip.state(trip.t_imu[0]).r_e
        np.testing.assert_allclose(found[:3], truth, atol=0.3 * t_s + np.linalg.norm(moved) * 0.01)


# --- an engine whose arithmetic is exact -----------------------------------------------------


class Ledger:
    """Adds up time in shares and notes when each measurement was applied."""

    def __init__(self):
        self.sum = 0.0
        self.seen = []

    def advance(self, rows, track):
        for row, mark in zip(rows, track, strict=True):
            self.sum += row[1]
            mark[:] = self.sum

    def advance_part(self, row, begin, end):
        assert 0.0 <= begin < end <= 1.0
        self.sum += (end - begin) * row[1]

    def mark(self, track):
        track[:] = self.sum

    def apply(self, measurement, track):
        self.seen.append((measurement, round(self.sum, 6)))
        return measurement

    def save(self):
        return self.sum, list(self.seen)

    def restore(self, saved):
        self.sum, self.seen = saved[0], list(saved[1])


def samples(first, n):
    """Rows whose second column counts one a sample."""
    t_ns = T0 + (np.arange(first, first + n) + 1) * STEP_NS
    rows = np.zeros((n, 8))
    rows[:, 0], rows[:, 1] = 0.01, 1.0
    return t_ns, rows


def at(samples_from_start):
    return T0 + round(samples_from_start * STEP_NS)


def ledger(history_s=2.0, slice_=None, **options):
    engine = Ledger()
    return engine, Timeline(engine, RATE_HZ, history_s, slice_=slice_, **options)


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


# --- measurements far ahead ------------------------------------------------------------------


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


# --- slices ----------------------------------------------------------------------------------


class Busy(Ledger):
    """Counts the samples it is carried over and the measurements it is given."""

    def __init__(self):
        super().__init__()
        self.work = 0

    def advance(self, rows, track):
        self.work += len(rows)
        super().advance(rows, track)

    def advance_part(self, row, begin, end):
        self.work += 1
        super().advance_part(row, begin, end)

    def apply(self, measurement, track):
        self.work += UPDATE
        return super().apply(measurement, track)

    def spent(self):
        work, self.work = self.work, 0
        return work


def busy(history_s=30.0, slice_=SLICE):
    engine = Busy()
    return engine, Timeline(engine, RATE_HZ, history_s, slice_=slice_)


def test_no_step_takes_long_though_much_is_run_again():
    """Late by 25 s: nothing at once, then a slice after each sample, the newest state going on."""
    engine, timeline = busy()
    timeline.extend(*samples(0, 3000))
    engine.spent()
    assert timeline.insert("m", at(500.5), "m") == []
    assert engine.spent() == 0
    verdicts, steps = [], 0
    while not verdicts or engine.seen == []:
        assert timeline.extend(*samples(3000 + steps, 1)) == []
        steps += 1
        assert engine.spent() == 1, "a solution waits for its sample only"
        assert engine.sum == pytest.approx(3000.0 + steps)
        verdicts += timeline.catch_up()
        assert engine.spent() <= SLICE + 5
    assert verdicts == ["m"]
    assert engine.seen == [("m", 500.5)]
    assert steps <= (2525 + UPDATE) / SLICE + 2
    assert timeline.catch_up() == []
    assert engine.spent() == 0


def test_a_slice_that_nobody_asked_for_is_run_before_the_next_sample():
    """Verdicts come one sample later, and the state is the same."""

    def run(asks):
        engine, timeline = busy()
        timeline.extend(*samples(0, 3000))
        timeline.insert("m", at(500.5), "m")
        out = []
        for k in range(3000, 3012):
            verdicts = timeline.extend(*samples(k, 1))
            out.append((verdicts + timeline.catch_up() if asks else verdicts, engine.sum))
        return out

    asked, unasked = run(asks=True), run(asks=False)
    assert [v for v, _ in asked[:-1]] == [v for v, _ in unasked[1:]]
    assert ["m"] in [v for v, _ in asked]
    assert [s for _, s in asked] == [s for _, s in unasked]


def test_what_fits_a_slice_is_run_at_once():
    engine, timeline = busy()
    timeline.extend(*samples(0, 3000))
    assert timeline.insert("m", at(2900.5), "m") == ["m"]
    assert engine.seen == [("m", 2900.5)]


def test_what_arrives_meanwhile_is_used_in_its_place():
    """Before and behind the rerun, on time, and ahead; one verdict each."""
    engine, timeline = busy()
    timeline.insert("ahead", at(3006.5), "ahead")
    timeline.extend(*samples(0, 3000))
    timeline.insert("first", at(1000.5), "first")
    verdicts = timeline.extend(*samples(3000, 2))
    for name, t in (("behind", 600.5), ("behind too", 900.5), ("before", 2800.5), ("new", 3001.5)):
        assert timeline.insert(name, at(t), name) == []
    assert timeline.insert("before", at(2800.5), "before") is Refusal.DUPLICATE
    for k in range(3002, 3040):
        verdicts += timeline.extend(*samples(k, 1))
    names = ["behind", "behind too", "first", "before", "new", "ahead"]
    assert [m for m, _ in engine.seen] == names
    assert [t for _, t in engine.seen] == [600.5, 900.5, 1000.5, 2800.5, 3001.5, 3006.5]
    assert sorted(verdicts) == sorted(names)
    assert verdicts[-2:] == ["behind", "behind too"], "in a second go"


@pytest.mark.parametrize("block", [2, 3, 50, 1000])
def test_slices_do_not_depend_on_blocks(block):
    """Verdicts come at the same sample, and the state there is the same, however fed."""

    def run(size):
        engine, timeline = busy()
        out = []
        for first in range(0, 9000, 1000):
            for k in range(first, first + 1000, size):
                n = min(size, first + 1000 - k)
                out += timeline.extend(*samples(k, n))
            out += timeline.insert(first, at(max(0.5, first - 1200.5)), str(first))
            out.append((engine.sum, list(engine.seen)))
        return out

    assert run(block) == run(1)


def test_late_ones_without_end_do_not_keep_the_newest_state_from_catching_up():
    """One with every second sample, each 20 s late: used at last within two goes, all of them."""
    engine, timeline = busy()
    timeline.extend(*samples(0, 3000))
    verdicts, behind = [], []
    for k in range(3000, 4000):
        if k % 2:
            t = k - 2000.5
            verdicts += timeline.insert(t, at(t), f"{t:09.1f}")
        verdicts += timeline.extend(*samples(k, 1))
        behind.append((k - 3000) // 2 - len(engine.seen))
    assert max(behind[500:]) < 400
    verdicts += timeline.finish()
    assert (
        [m for m, _ in engine.seen]
        == sorted(verdicts)
        == [k - 2000.5 for k in range(3001, 4000, 2)]
    )


def test_finishing_runs_what_is_left():
    engine, timeline = busy()
    timeline.extend(*samples(0, 3000))
    assert timeline.insert("m", at(500.5), "m") == []
    assert timeline.finish() == ["m"]
    assert engine.seen == [("m", 500.5)]
    assert engine.sum == pytest.approx(3000.0)
    assert timeline.finish() == []
