"""The clock of a device: drift under jitter and bursts, wraps, resets, what it says of itself."""

from itertools import groupby
from operator import itemgetter

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gateway.clock.device import LOCKED_AFTER, NEVER, SLEW, DeviceClock
from gateway.clock.envelope import LATE_S

T0 = 1_000_000_000_000
HZ = 200.0


def chunks(rng, n, longest):
    """Index of the last frame of each frame's chunk."""
    last = np.empty(n, dtype=int)
    k = 0
    while k < n:
        end = min(n, k + rng.integers(1, longest + 1))
        last[k:end] = end - 1
        k = end
    return last


def arrivals(rng, true_s, jitter_s, longest):
    """When frames that were true then come, in order, whole chunks together (ns)."""
    ready = np.maximum.accumulate(true_s + jitter_s * rng.exponential(size=true_s.size))
    return T0 + np.rint(ready[chunks(rng, true_s.size, longest)] * 1e9).astype(np.int64)


def placed(clock, counts, t_arrival_ns):
    """Ticks of counts as they came, chunk by chunk."""
    pairs = zip(counts.tolist(), t_arrival_ns.tolist(), strict=True)
    return [tick for _, chunk in groupby(pairs, itemgetter(1)) for tick in clock.take(list(chunk))]


def errors(ticks, true_s):
    return np.array([tick.t_ns for tick in ticks]) * 1e-9 - (T0 * 1e-9 + true_s)


def rms(error):
    return np.sqrt(np.mean(np.square(error)))


# --- offset and drift ------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "drift"), [(0, 50e-6), (1, -50e-6), (2, 0.0)])
def test_drift_is_followed_under_jitter_and_bursts(seed, drift):
    """50 ppm, 5 ms mean jitter, up to twenty frames a chunk."""
    rng = np.random.default_rng(seed)
    clock, n = DeviceClock(1 / HZ, 128), 24_000
    true_s = np.arange(n) / HZ * (1.0 + drift)
    ticks = placed(clock, np.arange(n) % 128, arrivals(rng, true_s, 5e-3, 20))
    error = errors(ticks, true_s)
    assert rms(error[12_000:]) < 0.1e-3
    assert clock.drift == pytest.approx(drift, abs=3e-6)
    assert [tick.step_s for tick in ticks[1:]] == [1 / HZ] * (n - 1)
    report = clock.report("sequence")
    assert (report.source, report.state, report.resets) == ("sequence", "locked", 0)
    assert report.drift_ppm == pytest.approx(1e6 * drift, abs=3.0)
    assert abs(error[-1]) < 4e-3 * report.sigma_ms < 0.4e-3
    assert 0.05 < report.jitter_ms < 2.0


def test_a_quiet_line_is_stamped_exactly():
    clock = DeviceClock(1 / HZ, 128)
    true_s = np.arange(4000) / HZ * (1.0 + 30e-6)
    rng = np.random.default_rng(1)
    error = errors(placed(clock, np.arange(4000) % 128, arrivals(rng, true_s, 0.0, 1)), true_s)
    assert np.abs(error).max() < 150e-6  # 30 ppm for the four seconds before a drift is known
    assert np.abs(error[2000:]).max() < 1e-6


def test_nothing_is_placed_after_its_arrival():
    rng = np.random.default_rng(2)
    t_ns = arrivals(rng, np.arange(5000) / HZ, 3e-3, 20)
    ticks = placed(DeviceClock(1 / HZ, 128), np.arange(5000) % 128, t_ns)
    assert all(tick.t_ns <= t for tick, t in zip(ticks, t_ns.tolist(), strict=True))


def test_a_locked_clock_slews():
    """Up by no more than a millisecond a second; down at once only where an arrival proves it."""
    rng = np.random.default_rng(3)
    true_s = np.arange(20_000) / HZ
    t_ns = arrivals(rng, true_s, 20e-3, 20)
    ticks = placed(DeviceClock(1 / HZ, NEVER), np.arange(20_000), t_ns)
    locked = slice(int((LOCKED_AFTER + 1) * HZ), None)
    placed_ns = np.array([tick.t_ns for tick in ticks])[locked]
    rate = np.diff(placed_ns) * 1e-9 * HZ - 1.0
    assert rate.max() < 1.2 * SLEW
    proved = placed_ns[1:] == t_ns[locked][1:]
    assert rate[~proved].min() > -1.2 * SLEW
    assert 0 < proved.sum() < 30


def test_who_asks_to_learn_early_has_the_same_times():
    """The daemon does, when measurements are away; a replay leaves it to the next chunk."""
    t_ns = arrivals(np.random.default_rng(4), np.arange(6000) / HZ * (1.0 + 40e-6), 5e-3, 7)
    pairs = list(zip((np.arange(6000) % 128).tolist(), t_ns.tolist(), strict=True))
    early, late = DeviceClock(1 / HZ, 128), DeviceClock(1 / HZ, 128)
    learnt = 0
    for _, group in groupby(pairs, itemgetter(1)):
        chunk = list(group)
        assert early.take(chunk) == late.take(chunk)
        before = early.drift
        early.learn()
        learnt += early.drift != before
    assert learnt > 20
    assert early.memory() == late.memory()


def test_a_backlog_that_drains_as_a_stretch_ends():
    """At 20 Hz the frames of one chunk end the stretch and void it: the last one tells the time."""
    clock, late_ns = DeviceClock(0.05, NEVER), 300_000_000
    true_ns = T0 + 50_000_000 * np.arange(200)
    for k in range(20):
        clock.take([(k, int(true_ns[k]) + late_ns)])
    clock.take([(k, int(true_ns[25])) for k in range(20, 26)])
    ticks = placed(clock, np.arange(26, 200), true_ns[26:])
    assert np.abs(errors(ticks, (true_ns[26:] - T0) * 1e-9)).max() < 1e-5


def test_a_minute_is_remembered():
    clock = DeviceClock(0.05, NEVER)
    placed(clock, np.arange(6000), T0 + np.arange(6000) * 50_000_000)
    assert clock._envelope.stretches == 60


def test_a_clock_that_heard_nothing_claims_nothing():
    report = DeviceClock(1e-3, 86_400_000).report("time")
    assert (report.state, report.offset_s, report.sigma_ms) == ("silent", None, None)


def test_the_offset_is_the_hosts_time_at_count_zero():
    clock = DeviceClock(1e-3, 86_400_000)
    for k in range(20):
        clock.take([((86_395_000 + 1000 * k) % 86_400_000, T0 + k * 1_000_000_000)])
    assert clock.report("time").offset_s == pytest.approx(T0 * 1e-9 - 86_395.0, abs=1e-5)


# --- wraps -----------------------------------------------------------------------------------


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 127), st.lists(st.integers(1, 150), min_size=1, max_size=60))
def test_a_sequence_wraps_anywhere_and_gaps_are_known(first, steps):
    """Gaps of any length, more than a turn of 128 among them, on a line that delays nothing."""
    clock, count = DeviceClock(1 / HZ, 128), first
    clock.take([(first, T0)])
    for step in steps:
        count += step
        (tick,) = clock.take([(count % 128, T0 + (count - first) * 5_000_000)])
        assert tick.step_s == pytest.approx(step / HZ)
    assert clock.resets == 0


@pytest.mark.parametrize(("unit_s", "modulus"), [(1e-6, 1 << 32), (1e-3, 86_400_000), (5e-3, 128)])
@pytest.mark.parametrize("seed", range(3))
def test_a_wrap_under_jitter_moves_nothing(unit_s, modulus, seed):
    """Microseconds turn over after 71 minutes, the time of day at midnight."""
    rng = np.random.default_rng(seed)
    true_s = np.arange(4000) / HZ
    counts = np.rint(true_s / unit_s).astype(np.int64) - round(rng.uniform(5.0, 15.0) / unit_s)
    t_ns = arrivals(rng, true_s, 5e-3, 20)
    wrapping, endless = DeviceClock(unit_s, modulus), DeviceClock(unit_s, NEVER)
    assert placed(wrapping, counts % modulus, t_ns) == placed(endless, counts + 2**40, t_ns)
    assert wrapping.resets == endless.resets == 0


def test_older_counts_are_placed_but_do_not_go_on():
    clock = DeviceClock(1 / HZ, 128)
    ticks = [clock.take([(k, T0 + 5_000_000 * at)])[0] for at, k in enumerate([0, 1, 3, 2, 3, 4])]
    assert [round(tick.step_s * HZ) for tick in ticks] == [0, 1, 2, -1, 0, 1]
    assert ticks[3].t_ns < ticks[2].t_ns
    assert clock.resets == 0


# --- resets ----------------------------------------------------------------------------------


def begun_again(unit_s, modulus, at, again, silence_s):
    """Counts and true times (s) of 40 s at 50 Hz, the count at `again` after a silence."""
    k = np.arange(2000)
    counts = np.rint(k / 50.0 / unit_s).astype(np.int64) + 10_000_000
    counts = np.where(k < at, counts, counts - counts[at] + again)
    return counts % modulus, k / 50.0 + silence_s * (k >= at)


@settings(deadline=None, max_examples=30)
@given(
    st.sampled_from([(1e-6, 1 << 32), (1e-3, 86_400_000), (5e-3, NEVER)]),
    st.integers(1, 900),
    st.floats(0.0, 1.0),
    st.floats(0.0, 20.0),
)
def test_a_reset_anywhere_is_a_gap_of_the_time_that_passed(counter, at, fraction, silence_s):
    """Whatever the count begins again with, the times are right at once."""
    unit_s, modulus = counter
    turn = min(modulus, 1 << 32)
    last = 10_000_000 + round((at - 1) / 50.0 / unit_s)
    # Between the last count and what it would be now it looks like a queue; near by, like a backlog
    # at the start or like reordering.
    ahead, behind = round((silence_s + 2.0) / unit_s), round(2.0 / unit_s)
    again = (last + ahead + round(fraction * (turn - ahead - behind))) % turn
    counts, true_s = begun_again(unit_s, modulus, at, again, silence_s)
    clock = DeviceClock(unit_s, modulus)
    ticks = placed(clock, counts, T0 + np.rint(true_s * 1e9).astype(np.int64))
    assert np.abs(errors(ticks, true_s)).max() < 1e-5
    assert sum(tick.step_s for tick in ticks) == pytest.approx(true_s[-1], abs=1e-4)
    assert clock.resets == 1


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 900), st.integers(0, 127), st.floats(0.3, 20.0))
@example(222, 0, 0.375)  # as if behind a backlog that ended in its fifth second
@example(238, 29, 0.717)
def test_a_sequence_that_begins_again_is_right_in_the_end(at, again, silence_s):
    """A short one leaves open how many turns it missed: that is seen when all stay late."""
    counts, true_s = begun_again(1 / 50.0, 128, at, again, silence_s)
    clock = DeviceClock(1 / 50.0, 128)
    ticks = placed(clock, counts, T0 + np.rint(true_s * 1e9).astype(np.int64))
    error = errors(ticks, true_s)
    assert error.max() < 1e-6
    assert np.abs(error[:at]).max() < 1e-5
    assert np.abs(error[at + 900 :]).max() < LATE_S
    assert clock.resets <= 2


def test_the_drift_outlives_a_power_cycle():
    """It is the same crystal: ten seconds later the clock is as good as before."""
    rng = np.random.default_rng(5)
    k = np.arange(20_000)
    true_s = k / HZ * (1.0 + 50e-6) + 3.0 * (k >= 14_000)
    counts = np.where(k < 14_000, 5000 * k + 1_000_000, 5000 * (k - 14_000))
    clock = DeviceClock(1e-6, 1 << 32)
    error = errors(placed(clock, counts, arrivals(rng, true_s, 5e-3, 20)), true_s)
    assert clock.resets == 1
    assert rms(error[16_000:]) < 0.1e-3


@pytest.mark.parametrize("step_s", [3.0, -3.0, -0.3, 0.1])
def test_a_device_whose_time_is_set_is_followed(step_s):
    """A topside's clock that NTP sets: at once where the count leaps, else after five sentences."""
    rng = np.random.default_rng(6)
    true_s = 2.0 * np.arange(100)
    counts = np.rint(1e3 * (true_s + step_s * (true_s >= 120.0))).astype(np.int64) + 40_000_000
    clock = DeviceClock(1e-3, 86_400_000, 1.0)
    error = errors(placed(clock, counts, arrivals(rng, true_s, 5e-3, 1)), true_s)
    assert clock.resets == 1
    assert rms(error[75:]) < 2e-3
    assert np.abs(error[60:]).max() < abs(step_s) + 0.05


def test_a_queue_of_seconds_is_no_reset():
    """The line stalls for three seconds, then all comes at once: nothing moves."""
    true_s = np.arange(6000) / HZ
    t_ns = T0 + np.rint(true_s * 1e9).astype(np.int64)
    t_ns[3000:3600] = t_ns[3600]
    clock = DeviceClock(1e-6, 1 << 32)
    error = errors(placed(clock, (5000 * np.arange(6000)), t_ns), true_s)
    assert np.abs(error).max() < 1e-5
    assert clock.resets == 0
