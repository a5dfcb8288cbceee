"""The past that queries ask for: bounds in time and memory, and ranges as Zenoh writes them."""

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.outputs.zenoh.past import Past, time_range

NOW = int(datetime(2026, 5, 1, 12, tzinfo=UTC).timestamp()) * 10**9
S = 10**9


def test_what_is_older_than_asked_for_goes() -> None:
    past = Past(10.0)
    for n in range(100):
        past.add(n * S, b"%d" % n)
    assert [t_ns // S for t_ns, _ in past.between(0, 200 * S)] == list(range(89, 100))
    assert past.last == (99 * S, b"99")


def test_memory_is_bounded_whatever_the_rate() -> None:
    past = Past(3600.0, limit_bytes=1000)
    for n in range(10_000):
        past.add(n, bytes(100))
    assert [t_ns for t_ns, _ in past.between(0, 10_000)] == list(range(9_990, 10_000))


def test_the_last_stays_without_history() -> None:
    past = Past(0.0, limit_bytes=1)
    assert past.last is None
    past.add(1, b"first")
    past.add(2, b"second")
    assert past.last == (2, b"second")
    assert past.between(0, 10) == [(2, b"second")]


def test_a_clock_set_back_bounds_memory_still() -> None:
    past = Past(1.0, limit_bytes=1000)
    for n in range(1_000):
        past.add(-n * S, bytes(100))
    assert len(past.between(-(10**15), 10**15)) == 10


@pytest.mark.parametrize(
    ("text", "first", "last"),
    [
        ("[now(-2m)..]", NOW - 120 * S, 2**63 - 1),
        ("[now(-2m)..now()]", NOW - 120 * S, NOW),
        ("[..now(-1.5h)]", -(2**63), NOW - 5400 * S),
        ("]now(-1d)..now(-250ms)[", NOW - 86_400 * S + 1, NOW - S // 4 - 1),
        ("[now(-10s);5s]", NOW - 10 * S, NOW - 5 * S),
        ("[2026-05-01T11:59:00Z..2026-05-01T11:59:30.5Z]", NOW - 60 * S, NOW - 29 * S - S // 2),
        ("[2026-05-01T14:00:00+02:00..]", NOW, 2**63 - 1),
        ("[..]", -(2**63), 2**63 - 1),
    ],
)
def test_ranges_of_zenoh(text: str, first: int, last: int) -> None:
    assert time_range(text, NOW) == (first, last)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("120", "'120' is no range of times such as"),
        ("[now(-2x)..]", "'-2x' is no duration"),
        ("[yesterday..]", "'yesterday' is neither now"),
        ("[now();]", "'' is no duration"),
        ("", "'' is no range"),
    ],
)
def test_what_is_no_range(text: str, said: str) -> None:
    with pytest.raises(ValueError, match="is n") as error:
        time_range(text, NOW)
    assert str(error.value).startswith(said)


PARTS = [
    "[",
    "]",
    "..",
    ";",
    "now(",
    ")",
    "-",
    "2m",
    "1.5h",
    "9" * 400,
    "w",
    "2026-05-01",
    "T12:00Z",
]


@given(st.lists(st.sampled_from(PARTS), max_size=8).map("".join))
def test_any_text_is_a_range_or_one_clear_line(text: str) -> None:
    try:
        first, last = time_range(text, NOW)
    except ValueError as error:
        assert "\n" not in str(error)
    else:
        assert isinstance(first, int)
        assert isinstance(last, int)
