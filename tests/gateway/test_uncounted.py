"""Frames that neither count nor time themselves: lost, delayed, or waiting in a queue."""

import numpy as np
import pytest

from gateway.ingest.uncounted import in_doubt_s
from gateway.nav.lie import exp_so3
from tests.gateway.ingested import ANGLE, PERIOD_NS, T0, imu, sample, taken

PERIOD_S = PERIOD_NS * 1e-9
FRAMES = 3000
LATE = range(1500, 2250)
"""Frames that come late, where some do."""


def swaying(k):
    """Increments of a vehicle that rolls, pitches and is held up."""
    t = k * PERIOD_S
    turn = np.array([0.09 * np.sin(1.1 * t), 0.06 * np.cos(0.9 * t), 0.02])
    force = np.array([0.3 * np.sin(t), 0.2 * np.cos(0.7 * t), -9.8])
    return {
        "delta_angle_rad": tuple(turn * PERIOD_S),
        "delta_velocity_m_s": tuple(force * PERIOD_S),
    }


def gone(rows):
    """Attitude (3, 3) and velocity (3,) of increments."""
    C, v = np.eye(3), np.zeros(3)
    for row in rows:
        v += C @ (row[4:7] + 0.5 * np.cross(row[1:4], row[4:7]))
        C = C @ exp_so3(np.ascontiguousarray(row[1:4]))
    return C, v


def all_of_them(frames):
    """Rows of frames none of which was late."""
    return taken(imu(), [sample(k, sequence=None, **swaying(k)) for k in range(frames)])[1]


def test_jitter_loses_nothing():
    """Of one in two thousand the delay is more than three intervals."""
    rng = np.random.default_rng(3)
    ready = T0 + np.arange(20_000) * PERIOD_NS
    late = ready + (2e6 * rng.exponential(size=ready.size)).astype(np.int64)
    left = np.maximum.accumulate(late)
    left += np.arange(left.size)  # each a chunk of its own
    ingest = imu()
    t_ns, rows = taken(ingest, [sample(k, int(t), sequence=None) for k, t in enumerate(left)])
    assert (ingest.counts.gaps, ingest.counts.missing) == (0, 0)
    assert ingest.clock_report().resets == 0
    np.testing.assert_allclose(rows[:, 1:4].sum(axis=0), ready.size * np.array(ANGLE))
    assert np.abs(t_ns[2000:] - ready[2000:]).max() < 1e6


@pytest.mark.parametrize("line_ns", [40_000, 2_500_000])
def test_a_queue_that_empties_loses_nothing(line_ns):
    """Held up for a second, then handed over by a slow line or a quick one."""
    held, left, records = range(1000, 1200), T0 - line_ns, []
    for k in range(FRAMES):
        ready = T0 + (held.stop if k in held else k) * PERIOD_NS
        left = max(ready, left + line_ns)
        records.append(sample(k, left, sequence=None))
    ingest = imu()
    t_ns, rows = taken(ingest, records)
    assert (ingest.counts.gaps, ingest.clock_report().resets) == (0, 0)
    assert len(rows) == FRAMES
    np.testing.assert_allclose(t_ns, T0 + np.arange(FRAMES) * PERIOD_NS, atol=1_000)


@pytest.mark.parametrize("delay_ms", [7, 183, 300])
def test_what_was_taken_for_lost_and_comes_is_exchanged(delay_ms):
    """Late for 3.75 s by the same: they look like the ones behind a gap until the delay ends."""
    late_ns = [1_000_000 * delay_ms if k in LATE else 0 for k in range(FRAMES)]
    left = np.maximum.accumulate(T0 + np.arange(FRAMES) * PERIOD_NS + late_ns)
    left += np.arange(FRAMES)
    ingest = imu()
    records = [sample(k, int(t), sequence=None, **swaying(k)) for k, t in enumerate(left)]
    t_ns, rows = taken(ingest, records)
    bridged = ingest.counts.missing
    assert bridged == ingest.counts.ignored["overdue"] == delay_ms // 5
    assert ingest.clock_report().resets == 0
    np.testing.assert_allclose(t_ns[-1], T0 + (FRAMES - 1) * PERIOD_NS, atol=10_000)
    assert rows[:, 0].sum() == pytest.approx(FRAMES * PERIOD_S)
    C, v = gone(rows)
    whole = gone(all_of_them(FRAMES))
    turned_by = bridged * PERIOD_S * 0.09
    np.testing.assert_allclose(C, whole[0], atol=0.05 * turned_by)
    np.testing.assert_allclose(v, whole[1], atol=0.05 * turned_by * 9.8 * len(LATE) * PERIOD_S)


def test_what_is_lost_stays_bridged():
    """And says how little is known meanwhile: it might have been late."""
    ingest = imu()
    records = [sample(k, sequence=None) for k in range(FRAMES) if not 1000 <= k < 1020]
    t_ns, rows = taken(ingest, records)
    assert (ingest.counts.gaps, ingest.counts.missing) == (1, 20)
    assert ingest.counts.ignored["overdue"] == 0
    np.testing.assert_allclose(rows[:, 1:4].sum(axis=0), FRAMES * np.array(ANGLE))
    assert t_ns[-1] == pytest.approx(T0 + (FRAMES - 1) * PERIOD_NS, abs=1_000)
    (m,) = rows[rows[:, 7] > 0.0, 7]
    assert 0.05 * np.sqrt(m**3 / 3.0) == pytest.approx(0.06 * 0.1)
    assert in_doubt_s(0.0) == 0.0
    assert in_doubt_s(20.0) == 20.0


def test_jitter_behind_a_gap_hides_it_for_no_longer_than_itself():
    """The first frame is late by jitter as well: the third looks as if a queue ran empty."""
    ingest, gap = imu(), range(1000, 1240)
    late_ns = {gap.stop: PERIOD_NS * 7 // 10, gap.stop + 1: PERIOD_NS // 10}
    frames = [k for k in range(FRAMES) if k not in gap]
    records = [sample(k, T0 + k * PERIOD_NS + late_ns.get(k, 0), sequence=None) for k in frames]
    t_ns, rows = taken(ingest, records)
    assert (ingest.counts.gaps, ingest.counts.missing) == (1, len(gap))
    noticed = t_ns[np.argmax(rows[:, 7] > 0.0)]
    assert noticed <= T0 + (gap.stop + 4) * PERIOD_NS
    assert ingest.clock_report().resets == 0
    np.testing.assert_allclose(t_ns[-1], T0 + (FRAMES - 1) * PERIOD_NS, atol=10_000)
