"""Records to measurements: axes, units, times of validity, gaps, and what is counted."""

import math
from itertools import groupby
from operator import attrgetter

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drivers import registry
from drivers.records import DeviceStatus, ImuRecord, Rejected, TimeDifference, UsblRecord
from gateway.config import Config, ImuDevice, UsblDevice
from gateway.ingest import Intake, intakes
from gateway.ingest.imu import QUEUE_S, ImuIngest
from gateway.ingest.uncounted import in_doubt_s
from gateway.ingest.usbl import UsblIngest
from gateway.messages import UsblFix
from gateway.schema import build
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import configuration

T0 = 5_000_000_000
PERIOD_NS = 5_000_000
ANGLE, VELOCITY = (1e-3, -2e-3, 3e-3), (0.01, 0.02, -0.05)
NOISE = {
    "angle_random_walk_deg_sqrt_h": 0.002,
    "gyro_bias_deg_h": 0.02,
    "velocity_random_walk_ug_sqrt_hz": 20,
    "accel_bias_ug": 50,
}
UDP = {"type": "udp", "bind": "127.0.0.1", "port": 7001}
SERIAL = {"type": "serial", "port": "/dev/ttyUSB0", "baud": 9600}


def made(kind, data):
    faults: list[str] = []
    block = build(kind, data, faults)
    assert block is not None, faults
    return block


def imu(**changes):
    data = {"kind": "imu", "codec": "kvh1750", "link": UDP, "rate_hz": 200, "noise": NOISE}
    return ImuIngest(made(ImuDevice, data | changes))


def usbl(**changes):
    noise = {"bearing_deg": 1.0, "elevation_deg": 1.0, "range_m": 0.2}
    data = {"kind": "usbl", "codec": "tracklink-lxt", "link": SERIAL, "noise": noise}
    return UsblIngest("usbl0", made(UsblDevice, data | changes), 1500.0)


def sample(k, t_rx_ns=None, **changes):
    """Frame `k` of a healthy IMU, arriving when it is ready."""
    fields = {"delta_angle_rad": ANGLE, "delta_velocity_m_s": VELOCITY, "sequence": k % 128}
    t = T0 + k * PERIOD_NS if t_rx_ns is None else t_rx_ns
    return ImuRecord(t_rx_ns=t, **(fields | changes))


def taken(ingest, records):
    """Times and rows of what became of the records; those with one stamp were one chunk."""
    for _, chunk in groupby(records, key=attrgetter("t_rx_ns")):
        for record in chunk:
            ingest.take(record)
        ingest.end_of_chunk()
    blocks = ingest.flush()
    t_ns = np.concatenate([np.frombuffer(b.t_ns, dtype=np.int64) for b in blocks])
    rows = np.concatenate([np.frombuffer(b.rows).reshape(-1, 8) for b in blocks])
    return t_ns, rows


# --- the IMU: axes and units -----------------------------------------------------------------


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


# --- the IMU: time ---------------------------------------------------------------------------


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


def microseconds(k, offset_us=0):
    return ((offset_us + 5000 * k) % (1 << 32)) * 1e-6


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


# --- the IMU: what is missing ----------------------------------------------------------------


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


# --- acoustic fixes --------------------------------------------------------------------------


HERE = {"bearing_deg": None, "elevation_deg": None, "slant_range_m": None}
HERE |= {"lat_deg": float(np.degrees(0.5)), "lon_deg": float(np.degrees(-1.2)), "depth_m": 40.0}
"""A beacon's place on the Earth, and nothing of how it is seen."""


def sighting(**changes):
    fields = {"beacon": "1", "bearing_deg": 90.0, "elevation_deg": -30.0, "slant_range_m": 87.0}
    return UsblRecord(t_rx_ns=T0, **(fields | changes))


def test_degrees_become_radians_and_the_stamp_the_replys_arrival():
    """500 ms latency and 60 bytes at 9600 baud before the first byte was seen."""
    ingest = usbl(clock={"source": "arrival", "latency_ms": 500})
    ingest.take(sighting(line_bytes=60))
    (fix,) = ingest.flush()
    assert fix.t_ns == T0 - 500_000_000 - round(60 * 10 * 1e9 / 9600)
    assert (fix.device, fix.beacon, fix.slant_range) == ("usbl0", "1", 87.0)
    assert fix.bearing == pytest.approx(np.pi / 2.0)
    assert fix.elevation == pytest.approx(-np.pi / 6.0)
    assert ingest.flush() == []
    assert ingest.counts.measurements == 1


@pytest.mark.parametrize(
    ("pause_s", "changes", "expected_s"),
    [
        (0.0, {}, 0.5),
        (0.1, {}, 0.0),
        (0.0, {"link": UDP}, 0.0),
        (0.0, {"clock": {"source": "device"}}, 0.0),
    ],
    ids=["at once", "after a pause", "packets", "told its time"],
)
def test_what_stood_on_the_line_before_a_sentence_may_have_held_it_up(pause_s, changes, expected_s):
    """480 bytes at 9600 baud, in two pieces, that are no sentence's."""
    ingest = usbl(codec="evologics", **changes)
    byte_s = 10 / 9600
    begin_s = 240 * byte_s
    for k in (1, 2):
        t_ns = T0 + round((k * begin_s - 200 * byte_s) * 1e9)
        junk = Rejected(t_rx_ns=t_ns, line_bytes=40, reason="unknown", data=bytes(240))
        ingest.take(junk)
    t_ns = T0 + round((2 * begin_s + pause_s + 60 * byte_s) * 1e9)
    ingest.take(msgspec.structs.replace(sighting(line_bytes=60, t_device_s=1.0), t_rx_ns=t_ns))
    (fix,) = ingest.flush()
    assert fix.t_sd_s == pytest.approx(expected_s, abs=1e-6)


def test_what_a_sentence_does_not_carry_stays_missing():
    ingest = usbl()
    ingest.take(sighting(bearing_deg=None, elevation_deg=None))
    ingest.take(sighting(slant_range_m=None))
    fixes = ingest.flush()
    assert [(f.bearing is None, f.slant_range is None) for f in fixes] == [
        (True, False),
        (False, True),
    ]


CROSS = [[0.1, 0, 0], [-0.1, 0, 0], [0, 0.1, 0], [0, -0.1, 0]]


def plane_wave(forward, starboard):
    """Time differences that a wave with these direction cosines makes, against the first element.

    An element so far ahead towards the beacon hears so much earlier.
    """
    at = np.array(CROSS)[:, :2] - CROSS[0][:2]
    later = -at @ [forward, starboard] / 1500.0
    return tuple(TimeDifference(element=str(k + 1), than="1", delay_s=later[k]) for k in (1, 2, 3))


def test_angles_by_time_differences_with_the_range_of_another_sentence():
    ingest = usbl(direction="differences", elements_m=CROSS)
    ingest.take(sighting())
    nothing_told = {"bearing_deg": None, "elevation_deg": None, "slant_range_m": None}
    ingest.take(sighting(**nothing_told, differences=plane_wave(0.3, -0.4)))
    ranged, seen = ingest.flush()
    assert (ranged.bearing, ranged.elevation, ranged.slant_range) == (None, None, 87.0)
    assert seen.bearing == pytest.approx(math.atan2(-0.4, 0.3))
    assert seen.elevation == pytest.approx(-math.acos(0.5))
    assert seen.slant_range is None


def test_differences_that_contradict_are_no_fix_but_their_rate_is_used():
    ingest = usbl(direction="differences", elements_m=CROSS)
    ingest.take(sighting(differences=plane_wave(0.8, 0.7), range_rate_m_s=1.5))
    (rate,) = ingest.flush()
    assert rate.rates == (1.5,)
    assert dict(ingest.counts.ignored) == {"no_direction": 1}


def test_a_range_out_of_its_limits_is_no_fix():
    ingest = usbl(range_limits_m=[90.0, 500.0])
    ingest.take(sighting())
    assert ingest.flush() == []
    assert dict(ingest.counts.ignored) == {"range": 1}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"valid": False, "error_code": "32"}, "32"),
        ({"valid": False}, "invalid"),
        (HERE, "place"),
        ({"bearing_deg": None, "slant_range_m": None}, "no_sighting"),
    ],
)
def test_a_record_that_is_no_fix_says_why(changes, reason):
    ingest = usbl()
    ingest.take(sighting(**changes))
    assert ingest.flush() == []
    assert dict(ingest.counts.ignored) == {reason: 1}


@pytest.mark.parametrize("axes", ["array", "level", "north"])
def test_a_fix_keeps_the_axes_in_which_it_is_told(axes):
    ingest = usbl()
    ingest.take(sighting(axes=axes))
    (fix,) = ingest.flush()
    assert (fix.axes, fix.bearing) == (axes, pytest.approx(np.pi / 2.0))


def test_a_place_told_by_our_own_solution_is_a_fix():
    ingest = usbl(navigates_by="gateway")
    ingest.take(sighting(**HERE))
    (fix,) = ingest.flush()
    assert (fix.beacon, fix.lat, fix.lon) == ("1", pytest.approx(0.5), pytest.approx(-1.2))


def test_what_is_said_again_in_other_words_is_one_fix():
    """A topside that tells each fix by the bow, by north and on the Earth, every second."""
    ingest = usbl(navigates_by="gateway")
    for second in range(3):
        for k, words in enumerate(({"axes": "level"}, {"axes": "north"}, HERE)):
            for beacon in ("1", "2"):
                told = sighting(**words, beacon=beacon)
                t_rx_ns = T0 + second * 1_000_000_000 + k * 80_000_000
                ingest.take(msgspec.structs.replace(told, t_rx_ns=t_rx_ns))
    assert [f.axes for f in ingest.flush()] == ["level"] * 6
    assert dict(ingest.counts.ignored) == {"repeated": 12}


def test_a_topside_may_change_its_words():
    ingest = usbl()
    for second, axes in enumerate(("level", "level", "north", "north")):
        told = sighting(axes=axes)
        ingest.take(msgspec.structs.replace(told, t_rx_ns=T0 + second * 1_000_000_000))
    assert [f.axes for f in ingest.flush()] == ["level", "level", "north", "north"]


def test_a_rate_alone_is_a_measurement():
    ingest = usbl()
    ingest.take(sighting(bearing_deg=None, slant_range_m=None, range_rate_m_s=-1.5))
    assert [type(m).__name__ for m in ingest.flush()] == ["RadialRate"]
    assert not ingest.counts.ignored


def test_an_imu_record_is_no_fix():
    ingest = usbl()
    ingest.take(sample(0))
    assert dict(ingest.counts.ignored) == {"not_usbl": 1}


# --- the whole way in ------------------------------------------------------------------------


def test_one_intake_for_each_device_of_a_configuration():
    config = configuration(make(demo_data()))
    assert isinstance(config, Config)
    ways = intakes(config)
    assert set(ways) == {"imu0", "usbl0"}
    ways["usbl0"].feed(b"no sentence at all\r\n", T0)
    ways["usbl0"].close()
    counts = ways["usbl0"].counts
    assert counts.bytes == counts.rejected_bytes == 20
    codec = registry.lookup("tracklink-lxt")
    options = build(codec.options, {}, [], "options")
    ways = intakes(config)
    ways["usbl0"].feed(codec.encode(sighting(xyz_m=None), options), T0)
    (fix,) = ways["usbl0"].flush()
    assert isinstance(fix, UsblFix)
    assert fix.bearing == pytest.approx(np.pi / 2.0, abs=1e-3)


# --- the IMU: a silence and then all at once -------------------------------------------------


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


# --- the IMU: a line that says things twice, or loses half of them ---------------------------


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
