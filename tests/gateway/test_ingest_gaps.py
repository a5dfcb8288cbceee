"""Inertial frames that are lost, late, said twice or without their time; units that start anew."""

import numpy as np
import pytest

from drivers.records import DeviceStatus, Rejected, UsblRecord
from gateway.ingest.imu import QUEUE_S
from tests.gateway.ingested import ANGLE, PERIOD_NS, T0, VELOCITY, imu, microseconds, sample, taken


@pytest.mark.parametrize("silence_s", [0.6, 5.0])
def test_a_power_cycle_is_a_gap_of_the_time_that_passed(silence_s):
    """The counter begins at zero again: it leaps back, the vehicle's time does not."""
    ingest = imu(clock={"source": "device"})
    first = [sample(k, t_device_s=microseconds(k, 100_000_000)) for k in range(2000)]
    t_again = first[-1].t_rx_ns + round(silence_s * 1e9)
    again = [sample(k, t_again + k * PERIOD_NS, t_device_s=microseconds(k, 3)) for k in range(2000)]
    t_ns, rows = taken(ingest, first + again)
    assert rows[2000, 0] == pytest.approx(silence_s, rel=1e-3)
    assert rows[2000, 7] == pytest.approx(silence_s - 0.005, rel=1e-2)
    np.testing.assert_allclose(rows[2001:, 0], 0.005, rtol=1e-3)
    np.testing.assert_allclose(t_ns[2000:], [r.t_rx_ns for r in again], atol=100_000)
    assert ingest.counts.gaps == 1


def test_a_power_cycle_of_a_device_with_a_sequence():
    ingest = imu()
    first = [sample(k) for k in range(1000)]
    t_again = first[-1].t_rx_ns + 7_000_000_000
    again = [sample(k, t_again + k * PERIOD_NS) for k in range(1000)]
    t_ns, rows = taken(ingest, first + again)
    assert rows[1000, 0] == pytest.approx(7.0)
    np.testing.assert_allclose(t_ns[1000:], [r.t_rx_ns for r in again], atol=100_000)


def test_a_line_that_stalled_is_told_from_a_device_that_did():
    """Three seconds held back, then all at once: the device's own time says nothing is missing."""
    ingest = imu(clock={"source": "device"})
    arrival = [T0 + k * PERIOD_NS for k in range(4000)]
    arrival[2000:2600] = [arrival[2600]] * 600
    records = [sample(k, t, t_device_s=microseconds(k, 9)) for k, t in enumerate(arrival)]
    t_ns, rows = taken(ingest, records)
    np.testing.assert_allclose(t_ns, T0 + np.arange(4000) * PERIOD_NS, atol=100_000)
    np.testing.assert_allclose(rows[:, 0], 0.005, rtol=1e-3)
    assert ingest.counts.gaps == 0


def test_missing_frames_are_bridged_and_said():
    """Four of them lost: the sample after the gap stands in, and says for how long."""
    ingest = imu()
    records = [sample(k) for k in range(300) if not 200 <= k < 204]
    t_ns, rows = taken(ingest, records)
    np.testing.assert_array_equal(t_ns[200] - t_ns[199], 5 * PERIOD_NS)
    assert rows[200, 0] == pytest.approx(0.025)
    np.testing.assert_allclose(rows[200, 1:4], 5.0 * np.array(ANGLE))
    np.testing.assert_allclose(rows[200, 4:7], 5.0 * np.array(VELOCITY))
    assert rows[200, 7] == pytest.approx(0.020)
    np.testing.assert_array_equal(rows[201:, 7], 0.0)
    assert (ingest.counts.gaps, ingest.counts.missing) == (1, 4)


def test_a_gap_longer_than_the_count_is_told_by_the_time():
    ingest = imu()
    records = [sample(k) for k in range(500) if not 200 <= k < 350]
    t_ns, rows = taken(ingest, records)
    assert rows[200, 0] == pytest.approx(151 * 0.005)
    assert t_ns[200] - t_ns[199] == 151 * PERIOD_NS
    assert ingest.counts.missing == 150


def test_the_angle_and_the_velocity_of_a_gap_are_kept():
    """The sums over a steady turn are the same with frames lost as with all of them."""
    whole = taken(imu(), map(sample, range(256)))[1]
    lossy = taken(imu(), [sample(k) for k in range(256) if k % 7 or k == 0])[1]
    np.testing.assert_allclose(lossy[:, :7].sum(axis=0), whole[:, :7].sum(axis=0), rtol=1e-9)


def test_an_invalid_sample_is_a_missing_one():
    ingest = imu()
    records = [sample(k, valid=k != 5) for k in range(10)]
    _, rows = taken(ingest, records)
    assert len(rows) == 9
    assert rows[5, 7] == pytest.approx(0.005)
    assert ingest.counts.ignored["invalid"] == 1
    assert ingest.counts.records == 10


def test_a_repeated_frame_is_ignored():
    ingest = imu()
    records = [sample(0), sample(1), sample(1), sample(2)]
    t_ns, _ = taken(ingest, records)
    assert len(t_ns) == 3
    assert ingest.counts.ignored["repeated"] == 1


def test_times_strictly_increase_whatever_the_arrivals():
    rng = np.random.default_rng(3)
    late = np.maximum.accumulate(
        T0 + np.arange(3000) * PERIOD_NS + (50e6 * rng.exponential(size=3000)).astype(np.int64)
    )
    t_ns, rows = taken(imu(), [sample(k, int(t)) for k, t in enumerate(late)])
    assert np.all(np.diff(t_ns) > 0)
    assert np.all(rows[:, 0] > 0.0)


def test_what_is_no_sample_is_counted():
    ingest = imu()
    ingest.take(Rejected(t_rx_ns=T0, reason="checksum", data=b"1234"))
    ingest.take(DeviceStatus(t_rx_ns=T0, healthy=True))
    ingest.take(UsblRecord(t_rx_ns=T0, beacon="1"))
    assert ingest.flush() == []
    assert ingest.counts.rejected["checksum"] == 1
    assert ingest.counts.rejected_bytes == 4
    assert ingest.counts.ignored["not_imu"] == 2
    assert ingest.counts.records == 2


@pytest.mark.parametrize("counted", [True, False])
def test_what_comes_late_after_a_silence_is_not_added_twice(counted):
    """The line stalls for 1.4 s and hands over what waited, frame by frame, at the line's rate.

    Where the count turns over in less, and where there is none, nothing but their haste tells these
    frames from the present.
    """
    sequence = {} if counted else {"sequence": None}
    frames, stalled, line_ns = 2000, range(1000, 1280), 40_000
    left = T0
    records = []
    for k in range(frames):
        ready = T0 + (stalled.stop if k in stalled else k) * PERIOD_NS
        left = max(ready, left + line_ns)
        records.append(sample(k, left, **sequence))
    ingest = imu()
    t_ns, rows = taken(ingest, records)
    queue_s = 2 * QUEUE_S if counted else 1e-5  # as much as after any silence; the stall is 1.4 s
    assert rows[:, 0].sum() == pytest.approx(frames * 0.005, abs=queue_s)
    assert (t_ns[-1] - t_ns[0]) * 1e-9 == pytest.approx(frames * 0.005, abs=0.02)
    np.testing.assert_allclose(
        rows[:, 1:4].sum(axis=0), rows[:, 0].sum() / 0.005 * np.array(ANGLE), rtol=2e-3
    )
    told = ingest.counts
    assert told.records == told.measurements + told.ignored.total() == frames
    made_s = 0.005 * (told.measurements + told.missing)
    assert made_s == pytest.approx(frames * 0.005, abs=queue_s)


@pytest.mark.parametrize("source", ["device", "arrival"])
def test_a_sample_said_twice_is_used_once(source):
    ingest = imu(clock={"source": source}, codec="sbg-ecom")
    records = [
        sample(k, t_rx_ns=T0 + k * PERIOD_NS + again, sequence=None, t_device_s=k * 0.005)
        for k in range(400)
        for again in range(2 if 100 <= k < 170 else 1)
    ]
    _, rows = taken(ingest, records)
    assert ingest.counts.ignored == {"repeated": 70}
    np.testing.assert_allclose(rows[:, 1:4].sum(axis=0), 400 * np.array(ANGLE), rtol=1e-3)


def test_a_sample_that_lost_its_time_is_a_missing_one():
    """And a unit that stops telling it is placed by what it tells."""
    ingest = imu(clock={"source": "device"}, codec="anpp")

    def told(k):
        return None if k in (100, 150, 151) or k >= 600 else k * 0.005

    frames = 1000
    _, rows = taken(ingest, [sample(k, sequence=None, t_device_s=told(k)) for k in range(frames)])
    assert ingest.counts.ignored["untimed"] == 3 + 199
    assert ingest.clock_report().source == "frames"
    assert rows[:590, 0].sum() == pytest.approx((590 + 3) * 0.005, abs=1e-6)
