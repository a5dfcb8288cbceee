"""Histograms of latencies against numpy's order statistics."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.latency import SLICE_S, SLICES, Histogram, Passage, Stages

WIDTH = 1 / 16


def filled(durations: list[int]) -> Histogram:
    histogram = Histogram()
    for duration in durations:
        histogram.add(duration)
    return histogram


@given(st.lists(st.integers(0, 2**39), min_size=1, max_size=300))
def test_quantiles_are_the_order_statistics_to_the_width_of_a_bucket(durations: list[int]) -> None:
    spread = filled(durations).since_start()
    assert spread.count == len(durations)
    assert spread.max_us == max(durations) / 1e3
    for q, value in ((0.5, spread.p50_us), (0.99, spread.p99_us), (0.999, spread.p99_9_us)):
        truth = np.quantile(durations, q, method="inverted_cdf") / 1e3
        assert value is not None
        assert truth <= value <= truth * (1 + WIDTH) + 0.001


def test_a_normal_live_distribution() -> None:
    durations = np.random.default_rng(1).lognormal(np.log(3e5), 0.5, 20_000).astype(int)
    spread = filled(durations.tolist()).recent()
    want = np.quantile(durations, [0.5, 0.99, 0.999]) / 1e3
    np.testing.assert_allclose([spread.p50_us, spread.p99_us, spread.p99_9_us], want, rtol=WIDTH)


@pytest.mark.parametrize("duration", [-5, 2**45, 2**70])
def test_what_cannot_be_still_counts(duration: int) -> None:
    assert filled([duration]).recent().count == 1


def test_nothing_has_no_quantiles() -> None:
    spread = Histogram().recent()
    assert (spread.count, spread.p50_us, spread.max_us) == (0, None, None)


def test_a_minute_forgets_and_the_whole_does_not() -> None:
    stages = Stages()
    stages.turn(0.0)
    stages.add("decode", "imu0", 7_000_000)
    for n in range(1, SLICES + 1):
        stages.turn(n * SLICE_S)
        stages.add("decode", "imu0", 1_000)
    (row,) = stages.report()
    assert (row.stage, row.of, row.recent.count, row.recent.max_us) == (
        "decode",
        "imu0",
        SLICES + 1,
        7000.0,
    )
    stages.turn((SLICES + 1) * SLICE_S)
    (row,) = stages.report()
    assert (row.recent.count, row.recent.max_us) == (SLICES, 1.0)
    assert (row.since_start.count, row.since_start.max_us) == (SLICES + 1, 7000.0)


def test_a_solution_is_timed_from_the_block_that_held_its_sample() -> None:
    stages = Stages()
    passage = Passage(stages)
    passage.solved(5, 1_000)  # nothing is known of its arrival
    passage.published("udp", 3_000)
    for t_ns, t_rx_ns in ((10, 100_000), (20, 200_000), (30, 300_000)):
        passage.entered(t_ns, t_rx_ns, t_rx_ns + 1_000)
    for t_ns, now_ns in ((10, 105_000), (13, 207_000), (20, 215_000), (31, 400_000)):
        passage.solved(t_ns, now_ns)
        passage.published("udp", now_ns + 2_000)
    rows = {row.stage: row.recent for row in stages.report()}
    assert rows["filter"].count == rows["total"].count == 3
    assert rows["filter"].max_us == 14.0  # 201 to 215
    assert rows["total"].max_us == 17.0  # 200 to 217
    assert (rows["publish"].count, rows["publish"].max_us) == (5, 2.0)
