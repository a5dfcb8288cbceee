"""The clock of arrivals: the lower edge against brute force, drift under jitter and bursts."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.clock import ArrivalClock, Unwrapper, lower_edge

points = st.lists(
    st.tuples(st.floats(0.0, 60.0), st.floats(0.0, 0.1)),
    min_size=2,
    max_size=15,
    unique_by=lambda p: round(p[0], 3),
).map(sorted)


def brute_force(points):
    """Of all lines through two points with none below, the highest at the mean abscissa."""
    middle = np.mean([x for x, _ in points])
    best = -np.inf
    for (x0, y0), (x1, y1) in combinations(points, 2):
        slope = (y1 - y0) / (x1 - x0)
        if all(y - (y0 + slope * (x - x0)) > -1e-9 * (1.0 + abs(slope)) for x, y in points):
            best = max(best, y0 + slope * (middle - x0))
    return middle, best


@settings(deadline=None)
@given(points)
def test_lower_edge_is_the_nearest_line_below(points):
    """Nearest on the whole: the sum of the distances is the height of the line at the mean."""
    intercept, slope = lower_edge(points)
    middle, best = brute_force(points)
    tolerance = 1e-8 * (1.0 + abs(slope))
    assert intercept + slope * middle == pytest.approx(best, abs=tolerance)
    assert all(y - (intercept + slope * x) > -tolerance for x, y in points)


def test_lower_edge_of_points_on_a_line_is_the_line():
    assert lower_edge([(x, 3.0 - 0.5 * x) for x in range(10)]) == pytest.approx((3.0, -0.5))


def chunks(rng, n, longest):
    """Index of the last frame of each frame's chunk."""
    last = np.empty(n, dtype=int)
    k = 0
    while k < n:
        end = min(n, k + rng.integers(1, longest + 1))
        last[k:end] = end - 1
        k = end
    return last


def stamped(seed, *, drift, jitter_s, longest, rate_hz=200.0, seconds=120.0):
    """Errors (s) of the stamps of a device that counts nominal seconds with a drifting clock."""
    rng = np.random.default_rng(seed)
    n = int(seconds * rate_hz)
    count = np.arange(n) / rate_hz
    true = 1000.0 + count * (1.0 + drift)
    ready = np.maximum.accumulate(true + jitter_s * rng.exponential(size=n))
    arrival = ready[chunks(rng, n, longest)]
    clock = ArrivalClock()
    stamps = [clock.stamp(c, round(a * 1e9)) for c, a in zip(count.tolist(), arrival, strict=True)]
    return true, (np.array(stamps) - np.rint(true * 1e9)) * 1e-9, clock


@pytest.mark.parametrize("drift", [50e-6, -50e-6, 0.0])
@pytest.mark.parametrize("seed", range(3))
def test_drift_is_followed_under_jitter_and_bursts(seed, drift):
    """50 ppm, 5 ms mean jitter, up to twenty frames a chunk: 0.2 ms RMS after a minute."""
    true, error, clock = stamped(seed, drift=drift, jitter_s=5e-3, longest=20)
    settled = true > true[0] + 60.0
    assert np.sqrt(np.mean(error[settled] ** 2)) < 2e-4
    assert clock.drift == pytest.approx(drift, abs=5e-6)


def test_a_quiet_line_is_stamped_exactly():
    _, error, _ = stamped(1, drift=30e-6, jitter_s=0.0, longest=1)
    assert np.abs(error).max() < 200e-6  # 30 ppm for the six seconds before a drift is believed
    assert np.abs(error[2000:]).max() < 1e-9


def test_a_frame_is_never_stamped_after_its_arrival():
    """Delay only adds: no stamp may claim more than the arrival says."""
    rng = np.random.default_rng(2)
    clock = ArrivalClock()
    t = 0.0
    for k in range(5000):
        t = max(t, 0.005 * k + 0.003 * rng.exponential())
        assert clock.stamp(0.005 * k, round(t * 1e9)) <= round(t * 1e9) + 1


def test_memory_of_a_clock_is_a_minute():
    _, _, clock = stamped(3, drift=0.0, jitter_s=1e-3, longest=1, rate_hz=20.0, seconds=300.0)
    assert len(clock._past) == 60


# --- counters --------------------------------------------------------------------------------


@given(st.lists(st.integers(1, 60), min_size=1, max_size=50), st.integers(0, 127))
def test_a_counter_that_wraps_is_unwrapped(steps, start):
    counter, value, total = Unwrapper(128), start, start
    assert counter.extend(start, 0.0) == start
    for step in steps:
        value, total = (value + step) % 128, total + step
        assert counter.extend(value, float(step)) == total


@given(st.integers(0, 127), st.integers(1, 5000), st.floats(-60.0, 60.0))
def test_whole_turns_come_from_the_time_that_passed(start, step, off):
    """A gap of any length, the expected step right to less than half a turn."""
    counter = Unwrapper(128)
    counter.extend(start, 0.0)
    found = counter.extend((start + step) % 128, step + off)
    assert found == start + step or (step + off < 0.0 and found > start)


def test_frames_of_one_chunk_count_on_without_time_passing():
    counter = Unwrapper(128)
    assert [counter.extend(k % 128, 0.0) for k in range(300)] == list(range(300))


def test_microseconds_wrap_after_71_minutes():
    counter = Unwrapper(1 << 32)
    begin = (1 << 32) - 10_000
    values = [(begin + 5000 * k) % (1 << 32) for k in range(6)]
    assert [counter.extend(v, 5000.0) - begin for v in values] == [5000 * k for k in range(6)]


def test_a_counter_that_begins_again_never_goes_back():
    counter = Unwrapper(128)
    counter.extend(100, 0.0)
    after = counter.extend(0, 1000.0)
    assert abs(after - 1100) <= 64
    assert counter.extend(1, 1.0) == after + 1
