"""Inertial records to rows of increments: axes, units, and times of validity."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drivers import registry
from drivers.records import ImuRecord
from gateway.config import ImuDevice
from gateway.ingest import Intake
from gateway.ingest.uncounted import in_doubt_s
from tests.gateway.ingested import (
    ANGLE,
    NOISE,
    PERIOD_NS,
    T0,
    UDP,
    VELOCITY,
    imu,
    made,
    microseconds,
    sample,
    taken,
)


def test_a_healthy_device_gives_one_row_a_frame():
    t_ns, rows = taken(imu(), map(sample, range(400)))
    np.testing.assert_array_equal(t_ns, T0 + np.arange(400) * PERIOD_NS)
    np.testing.assert_allclose(rows[:, 0], 0.005, atol=1e-15)
    np.testing.assert_array_equal(rows[:, 1:4], np.tile(ANGLE, (400, 1)))
    np.testing.assert_array_equal(rows[:, 4:7], np.tile(VELOCITY, (400, 1)))
    np.testing.assert_array_equal(rows[:, 7], 0.0)


@pytest.mark.parametrize("mounting", [(0, 0, 90), (180, 0, 0), (10, -20, 30)])
def test_sensor_axes_are_turned_into_the_body(mounting):
    """C_bs = Rz(heading) Ry(pitch) Rx(roll), against scipy's Euler angles."""
    _, rows = taken(imu(mounting_deg=mounting), [sample(0)])
    C_bs = Rotation.from_euler("ZYX", mounting[::-1], degrees=True).as_matrix()
    np.testing.assert_allclose(rows[0, 1:4], C_bs @ ANGLE, atol=1e-16)
    np.testing.assert_allclose(rows[0, 4:7], C_bs @ VELOCITY, atol=1e-16)


def test_a_sensor_turned_to_starboard_sees_ahead_on_its_port_side():
    _, rows = taken(imu(mounting_deg=(0, 0, 90)), [sample(0, delta_velocity_m_s=(0.0, -1.0, 0.0))])
    np.testing.assert_allclose(rows[0, 4:7], (1.0, 0.0, 0.0), atol=1e-15)


def test_rates_become_increments_of_the_interval():
    rates = {
        "rate_rad_s": tuple(200.0 * a for a in ANGLE),
        "specific_force_m_s2": tuple(200.0 * v for v in VELOCITY),
    }
    records = [ImuRecord(t_rx_ns=T0 + k * PERIOD_NS, sequence=k, **rates) for k in range(5)]
    _, rows = taken(imu(), records)
    np.testing.assert_allclose(rows[:, 1:4], np.tile(ANGLE, (5, 1)), rtol=1e-12)
    np.testing.assert_allclose(rows[:, 4:7], np.tile(VELOCITY, (5, 1)), rtol=1e-12)


def test_a_drifting_devices_rates_are_integrated_over_true_time():
    """The device takes 1000 ppm longer than it says: dt, and what rates make of it, follow."""
    rates = {"rate_rad_s": (0.2, 0.0, 0.0), "specific_force_m_s2": (0.0, 0.0, -9.8)}
    records = [
        ImuRecord(t_rx_ns=T0 + round(k * PERIOD_NS * 1.001), sequence=k % 128, **rates)
        for k in range(4000)
    ]
    t_ns, rows = taken(imu(), records)
    np.testing.assert_allclose(rows[-100:, 0], 0.005005, rtol=1e-6)
    np.testing.assert_allclose(rows[-100:, 1], 0.2 * 0.005005, rtol=1e-6)
    np.testing.assert_allclose(np.diff(t_ns[-100:]), 5_005_000, atol=2)


@pytest.mark.parametrize("accel", ["g", "delta_v_m_s", "delta_v_ft_s"])
@pytest.mark.parametrize("gyro", ["delta_angle_rad", "delta_angle_deg", "rate_rad_s", "rate_deg_s"])
def test_bytes_go_all_the_way_to_si(gyro, accel):
    """Frames of the codec under each reading of its numbers."""
    codec = registry.lookup("kvh1750")
    data = {"kind": "imu", "codec": "kvh1750", "link": UDP, "rate_hz": 200, "noise": NOISE}
    given = {"gyro": gyro, "accel": accel}
    options = made(codec.options, given)
    intake = Intake({"imu0": made(ImuDevice, data | {"options": given})})
    rates = {
        "rate_rad_s": tuple(200.0 * a for a in ANGLE),
        "specific_force_m_s2": tuple(200.0 * v for v in VELOCITY),
    }
    for k in range(3):
        intake.feed(codec.encode(sample(k, **rates), options), T0 + k * PERIOD_NS)
    (block,) = intake.flush()
    rows = np.frombuffer(block.rows).reshape(-1, 8)
    np.testing.assert_allclose(rows[:, 1:4], np.tile(ANGLE, (3, 1)), rtol=1e-6)
    np.testing.assert_allclose(rows[:, 4:7], np.tile(VELOCITY, (3, 1)), rtol=1e-6)
    assert intake.counts.bytes == 3 * 36
    assert intake.counts.records == intake.counts.measurements == 3


def test_latency_is_taken_off():
    t_ns, _ = taken(imu(clock={"source": "arrival", "latency_ms": 1.5}), map(sample, range(3)))
    np.testing.assert_array_equal(t_ns, T0 + np.arange(3) * PERIOD_NS - 1_500_000)


def test_serial_line_time_is_taken_off():
    """36 bytes of 10 bits at 921600 baud before the chunk was stamped."""
    link = {"type": "serial", "port": "/dev/ttyUSB0", "baud": 921600}
    t_ns, _ = taken(imu(link=link), [sample(0, line_bytes=36)])
    assert t_ns[0] == T0 - round(36 * 10 * 1e9 / 921600)


def test_a_packet_link_has_no_line_time():
    t_ns, _ = taken(imu(), [sample(0, line_bytes=36)])
    assert t_ns[0] == T0


def test_frames_of_one_chunk_spread_out():
    """Ten frames every 50 ms, all with the chunk's stamp."""
    records = [sample(k, T0 + (k // 10 * 10 + 9) * PERIOD_NS) for k in range(4000)]
    t_ns, rows = taken(imu(), records)
    settled = slice(2000, None)
    np.testing.assert_allclose(t_ns[settled], T0 + np.arange(2000, 4000) * PERIOD_NS, atol=100_000)
    assert np.all(np.diff(t_ns) > 0)
    np.testing.assert_allclose(rows[:, 0], 0.005, rtol=0.01)


def test_a_device_without_a_count_is_stamped_by_arrival():
    """Two lost: the third after them makes sure of it, and stands in for them."""
    records = [sample(k, sequence=None) for k in range(10)]
    del records[4:6]
    t_ns, rows = taken(imu(), records)
    np.testing.assert_array_equal((t_ns - T0) / PERIOD_NS, [0, 1, 2, 3, 4, 5, 8, 9])
    np.testing.assert_allclose(rows[:, 0].cumsum(), (t_ns - T0) * 1e-9 + 0.005)
    assert rows[6, 0] == pytest.approx(0.015)
    assert rows[6, 7] == pytest.approx(in_doubt_s(0.010))


def test_a_microsecond_counter_wraps():
    ingest = imu(clock={"source": "device"})
    begin = (1 << 32) - 50 * 5000
    records = [sample(k, t_device_s=microseconds(k, begin), sequence=None) for k in range(100)]
    t_ns, rows = taken(ingest, records)
    np.testing.assert_allclose(np.diff(t_ns), PERIOD_NS, atol=2)
    np.testing.assert_allclose(rows[:, 0], 0.005, rtol=1e-9)
    assert ingest.counts.gaps == 0


def test_the_devices_time_is_believed_under_jitter():
    rng = np.random.default_rng(1)
    late = np.maximum.accumulate(
        T0 + np.arange(20_000) * PERIOD_NS + (3e6 * rng.exponential(size=20_000)).astype(np.int64)
    )
    records = [sample(k, int(t), t_device_s=microseconds(k, 77)) for k, t in enumerate(late)]
    t_ns, _ = taken(imu(clock={"source": "device"}), records)
    error = (t_ns - T0 - np.arange(20_000) * PERIOD_NS)[12_000:]
    assert np.sqrt(np.mean(error.astype(float) ** 2)) < 200_000
