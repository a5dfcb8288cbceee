"""Unix time of a moment: whoever reads samples and questions in their order is told the same."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.clock.utc import DELAY_NS, KEPT, UtcHistory, UtcSample

S = 1_000_000_000
STEPS = st.tuples(
    st.integers(1, 2 * S),  # until the next thing happens
    st.booleans(),  # a sample, or a solution
    st.integers(-10 * S, 2 * S),  # the solution's time, against now
    st.integers(-5 * S, 5 * S),  # what the clock is set by
)


def test_without_samples_times_are_unix_times() -> None:
    assert UtcHistory().at(1_700_000_000 * S) == 0


def test_the_last_sample_in_force_holds() -> None:
    history = UtcHistory()
    history.note(UtcSample(10, 100))
    history.note(UtcSample(20, 200))
    assert [history.at(t) for t in (5, 10, 19, 20, 99)] == [100, 100, 100, 200, 200]


def test_a_sample_is_in_force_a_little_later() -> None:
    history = UtcHistory()
    history.note(UtcSample(0, 1))
    sample = history.sample(S, 7)
    assert sample == UtcSample(S + DELAY_NS, 7)
    assert [history.at(t) for t in (sample.t_ns - 1, sample.t_ns)] == [1, 7]


@given(st.lists(STEPS, max_size=60))
def test_a_recording_tells_what_was_told_live(steps: list[tuple[int, bool, int, int]]) -> None:
    """However clocks step and however early or late solutions are stamped."""
    live, recorded = UtcHistory(), UtcHistory()
    now, offset = 100 * S, 1_700_000_000 * S
    recorded.note(live.sample(now, offset))
    told = []
    for wait, is_sample, age, set_by in steps:
        now += wait
        if is_sample:
            offset += set_by
            recorded.note(live.sample(now, offset))
        else:
            told.append((now + age, live.at(now + age)))
    assert [recorded.at(t) for t, _ in told] == [utc for _, utc in told]


@given(st.lists(STEPS, max_size=60))
def test_a_reader_of_the_stream_knows_in_time(steps: list[tuple[int, bool, int, int]]) -> None:
    """A replay answers as it reads; live the filter's answer may come later, after more samples."""
    live, replayed = UtcHistory(), UtcHistory()
    now, offset = 100 * S, 1_700_000_000 * S
    replayed.note(live.sample(now, offset))
    asked = []
    for wait, is_sample, age, set_by in steps:
        now += wait
        if is_sample:
            offset += set_by
            replayed.note(live.sample(now, offset))
        else:
            t_ns = now + min(age, DELAY_NS)
            asked.append((t_ns, replayed.at(t_ns)))
    assert [live.at(t) for t, _ in asked] == [utc for _, utc in asked]


def test_samples_of_a_long_run_are_forgotten() -> None:
    history = UtcHistory()
    for n in range(5 * KEPT):
        history.sample(n * S, n)
    assert len(history._samples) < 2 * KEPT
    assert history.at(5 * KEPT * S) == 5 * KEPT - 1
