"""Kernel stamps of a wall clock that is set meanwhile: the monotonic time they were made."""

import struct
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.hosttime import now_ns
from drivers.links import stamps
from drivers.links.stamps import SO_TIMESTAMPNS, MonotonicStamps

MS = 1_000_000
WALL_NS = 1_790_000_000_000_000_000


class Clocks:
    """A host's two clocks, in place of those of the module under test."""

    def __init__(self) -> None:
        self.now = 1_000_000_000_000
        self.offset = WALL_NS

    def monotonic_ns(self) -> int:
        return self.now

    def time_ns(self) -> int:
        return self.now + self.offset


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    made = Clocks()
    monkeypatch.setattr(stamps, "time", made)
    monkeypatch.setattr(stamps, "now_ns", made.monotonic_ns)
    return made


@pytest.mark.parametrize("step_s", [3.0, -3.0, 0.5, 3600.0, -86400.0])
@pytest.mark.parametrize("silence_ms", [5, 2000, 60_000])
def test_a_step_between_stamp_and_reading_moves_nothing(
    clocks: Clocks, step_s: float, silence_ms: int
) -> None:
    made = MonotonicStamps()
    assert made.of_wall(clocks.time_ns()) == clocks.now
    clocks.now += silence_ms * MS
    stamped, at = clocks.time_ns(), clocks.now
    clocks.now += MS
    clocks.offset += round(step_s * 1e9)
    clocks.now += MS
    assert made.of_wall(stamped) == at
    assert made.of_wall(stamped + 1) == at + 1  # one more from before the step, read behind it
    clocks.now += 5 * MS
    stamped, at = clocks.time_ns(), clocks.now
    clocks.now += 3 * MS
    assert made.of_wall(stamped) == at


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 5000),  # silence, ms
            st.integers(0, 40),  # wait in the socket, ms
            st.sampled_from([0, 0, 0, 0, 3000, -3000, 200_000]),  # step, ms
            st.booleans(),  # the step before or after the stamp
        ),
        max_size=40,
    )
)
def test_no_step_moves_any_stamp(events: list[tuple[int, int, int, bool]]) -> None:
    clocks = Clocks()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stamps, "time", clocks)
        patch.setattr(stamps, "now_ns", clocks.monotonic_ns)
        made = MonotonicStamps()
        for silence, wait, step, early in events:
            clocks.now += (11_000 if step else silence) * MS  # steps do not come in a hail
            clocks.offset += step * MS * early
            stamped, at = clocks.time_ns(), clocks.now
            clocks.offset += step * MS * (not early)
            clocks.now += wait * MS
            assert made.of_wall(stamped) == at


def test_a_slewed_clock_is_no_stepped_one(clocks: Clocks) -> None:
    made = MonotonicStamps()
    for _ in range(100):
        clocks.now += 100 * MS
        stamped, at = clocks.time_ns(), clocks.now
        clocks.now += 2 * MS
        clocks.offset += MS // 20  # 500 ppm, as fast as NTP slews
        assert abs(made.of_wall(stamped) - at) <= MS // 20


def test_what_makes_no_sense_is_stamped_now(clocks: Clocks) -> None:
    made = MonotonicStamps()
    assert made.of_wall(clocks.time_ns() - 60_000 * MS) == clocks.now
    assert made.of_wall(clocks.time_ns() + 60_000 * MS) == clocks.now
    assert made.of(()) == clocks.now


def test_the_stamp_is_taken_from_the_control_messages() -> None:
    seconds, nanoseconds = divmod(time.time_ns() - 7 * MS, 1_000_000_000)
    message = (1, SO_TIMESTAMPNS, struct.pack("@ll", seconds, nanoseconds))
    before = now_ns()
    found = MonotonicStamps().of([(0, 0, b""), message])
    assert 0 <= before - found - 7 * MS + 2 * MS < 100 * MS


@pytest.mark.parametrize("step_s", [0.0, 3.0])
def test_what_came_while_the_process_stood_still_keeps_its_times(
    clocks: Clocks, step_s: float
) -> None:
    made = MonotonicStamps()
    made.emptied()
    waited = []
    for _ in range(30):
        clocks.now += 1000 * MS
        waited.append((clocks.time_ns(), clocks.now))
    clocks.offset += round(step_s * 1e9)
    assert [made.of_wall(stamped) for stamped, _ in waited] == [at for _, at in waited]
    made.emptied()
    clocks.now += MS
    assert made.of_wall(clocks.time_ns() - 20_000 * MS) == clocks.now  # a step that nobody saw
