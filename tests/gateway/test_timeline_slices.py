"""History run again in slices: no step takes long, and the result does not depend on them."""

import pytest

from gateway.order import Refusal
from gateway.timeline import SLICE, UPDATE, Timeline
from tests.gateway.ledgers import RATE_HZ, Ledger, at, samples


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
        assert timeline.owes
        verdicts += timeline.catch_up()
        assert engine.spent() <= SLICE + 5 and not timeline.owes
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
