"""What the next worker begins with, after deaths of every kind; no process takes part."""

import pytest

from gateway.filter_process.backlog import Backlog
from gateway.filter_process.channel import Start, encode
from gateway.filter_process.progress import At
from gateway.filter_process.succession import IN_VAIN, Succession
from gateway.messages import Checkpoint, FilterCounts, SavedState, Stationary

MS = 1_000_000


def state(n: int) -> SavedState:
    """The state after input `n`."""
    return SavedState(n * MS, b"", b"", b"", 0, 0, 0, None)


def checkpoint(received: int, said: int) -> Checkpoint:
    return Checkpoint(state(received), received, said, 0, (0.0, 0.0, 0.0), (), {}, *[0] * 7)


class Line:
    """One worker after the other; inputs are numbered from 0, input n is of the nth ms."""

    def __init__(self, limit: int = 1000, resume: SavedState | None = None) -> None:
        self.succession = Succession(limit, resume)
        self.n = 0

    def give(self, count: int) -> None:
        """Send so many inputs."""
        for _ in range(count):
            self.succession.backlog.add(encode(Stationary((self.n + 1) * MS, "", 0.1)))
            self.n += 1
            self.succession.backlog.sent(1)

    def say(self, count: int) -> None:
        """Let the worker say so much."""
        for _ in range(count):
            assert self.succession.take(FilterCounts(*[0] * 9))

    def dies(self, at: At | None = None) -> tuple[Start, int]:
        """The orders of the next worker, and how many inputs it is sent; it is sent them."""
        self.succession.ended(at)
        orders = self.succession.orders()
        again = self.succession.backlog.waiting
        self.succession.backlog.sent(again)
        return orders, again


def test_all_is_given_again_until_there_is_a_checkpoint() -> None:
    line = Line()
    assert line.succession.orders() == Start()
    line.give(50)
    line.say(7)
    assert line.dies() == (Start(None, heard=7), 50)


def test_what_a_checkpoint_includes_is_not_given_nor_said_again() -> None:
    line = Line()
    line.succession.orders()
    line.give(50)
    line.say(7)
    at = checkpoint(received=30, said=4)
    assert not line.succession.take(at)
    line.say(1)
    assert line.dies() == (Start(at, heard=4), 20)
    line.say(3)  # beyond what was heard before
    assert line.dies() == (Start(at, heard=7), 20)


def test_an_input_that_two_died_of_is_left_out_and_what_they_said_of_it_is_void() -> None:
    line = Line()
    line.succession.orders()
    line.give(50)
    line.say(9)
    orders, again = line.dies(At(taken=20, said=5, count=25))  # one of these
    assert (orders, again) == (Start(None, heard=9, one_by_one=True), 50)
    orders, again = line.dies(At(taken=33, said=7, count=1))
    assert (orders, again) == (Start(None, heard=7), 49)
    assert line.succession.backlog.dropped == 1


def test_one_that_dies_elsewhere_or_of_nothing_of_its_own_costs_no_input() -> None:
    line = Line()
    line.succession.orders()
    line.give(50)
    for at in (At(33, 7, 1), None, At(12, 3, 1), At(33, 7, 1), None):
        assert line.dies(at)[1] == 50
    assert line.succession.backlog.dropped == 0


def test_a_suspect_that_a_checkpoint_includes_is_none() -> None:
    line = Line()
    line.succession.orders()
    line.give(50)
    assert line.dies(At(20, 0, 1))[0].one_by_one
    line.succession.take(checkpoint(received=30, said=0))
    assert not line.dies()[0].one_by_one


def test_numbers_go_on_where_the_checkpoint_was() -> None:
    line = Line()
    line.succession.orders()
    line.give(50)
    line.succession.take(checkpoint(received=30, said=0))
    line.dies()
    for again in (20, 19):
        assert line.dies(At(taken=5, said=0, count=1))[1] == again


def test_where_inputs_were_too_many_to_keep_the_newest_state_goes_on() -> None:
    line = Line(limit=100)
    line.succession.orders()
    line.give(150)
    line.say(3)
    assert line.succession.take(state(120))
    assert line.succession.backlog.forgotten == 50
    assert line.dies() == (Start(state(120)), 30)
    line.say(2)
    line.give(10)
    assert line.dies() == (Start(state(120), heard=2), 40)


def test_workers_in_vain_cost_the_inputs_and_then_the_state() -> None:
    line = Line(resume=state(5))
    line.succession.orders()
    line.give(50)
    line.succession.take(state(40))
    for _ in range(IN_VAIN - 1):
        assert line.dies() == (Start(state(5)), 50)
    assert line.dies() == (Start(state(40)), 0)
    assert line.succession.backlog.dropped == 10
    for _ in range(IN_VAIN - 1):
        assert line.dies()[0] == Start(state(40))
    assert line.dies()[0] == Start()


@pytest.mark.parametrize("older", [39, 40])
def test_a_state_that_is_worked_out_again_is_no_news(older: int) -> None:
    line = Line()
    assert line.succession.take(state(40))
    assert not line.succession.take(state(older))


def test_what_waits_for_the_first_worker_is_not_lost_and_memory_is_bounded_again_later() -> None:
    backlog = Backlog(10, at_first=100)
    for n in range(100):
        backlog.add(bytes([n]))
    assert (backlog.waiting, backlog.dropped) == (100, 0)
    assert backlog.next(1, 1000) == [bytes([0])]
    backlog.sent(100)
    backlog.add(b"later")
    assert (backlog.kept, backlog.forgotten) == (99, 1)  # the most there ever is
    backlog.cover(95)
    for _ in range(50):
        backlog.add(b"more")
    assert (backlog.kept + backlog.waiting, backlog.dropped) == (10, 41)


def test_beyond_what_is_kept_for_the_first_worker_the_oldest_go() -> None:
    backlog = Backlog(10, at_first=20)
    for n in range(25):
        backlog.add(bytes([n]))
    assert (backlog.waiting, backlog.dropped) == (20, 5)
