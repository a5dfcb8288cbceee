"""A clock outlives its process: exactly, or with what an absence or a power cycle leaves."""

from itertools import groupby
from math import inf
from operator import itemgetter

import msgspec
import numpy as np
import pytest

from drivers import registry
from drivers.records import ImuRecord
from gateway.clock import NEVER, ClockMemory, DeviceClock, aged
from gateway.clock.memory import ABSENCE_S, OUTAGE_S
from gateway.config import GnssDevice, ImuDevice
from gateway.ingest import Intake
from tests.gateway.device_clocks import IMU_NOISE, device

T0_NS = 1_000_000_000_000
HZ = 200.0
MICROSECONDS = 1e-6, 1 << 32
DRIFT = 50e-6
KILLED = 8000
"""Of the frames heard, after 40 s."""


def frames(rng, n, drift=DRIFT, jitter_s=5e-3):
    """True times (s) of counted frames, and when the chunks of up to twenty came (ns)."""
    true_s = np.arange(n) / HZ * (1.0 + drift)
    ready = np.maximum.accumulate(true_s + jitter_s * rng.exponential(size=n))
    ends = np.minimum(np.cumsum(rng.integers(1, 21, size=n)), n) - 1
    return true_s, T0_NS + np.rint(ready[ends[np.searchsorted(ends, np.arange(n))]] * 1e9).astype(
        int
    )


def placed(clock, counts, t_arrival_ns):
    """Ticks of counts as they came, chunk by chunk."""
    pairs = zip(counts.tolist(), t_arrival_ns.tolist(), strict=True)
    return [tick for _, chunk in groupby(pairs, itemgetter(1)) for tick in clock.take(list(chunk))]


def errors_s(ticks, true_s):
    return np.array([tick.t_ns - T0_NS for tick in ticks]) * 1e-9 - true_s


def rms_ms(error_s):
    return 1e3 * np.sqrt(np.mean(np.square(error_s)))


def through_the_file(memory):
    return msgspec.msgpack.decode(msgspec.msgpack.encode(memory), type=ClockMemory)


def taken_up(memory, now_ns, kind=MICROSECONDS):
    """A clock of the next process, if it begins at such a time."""
    clock = DeviceClock(*kind)
    clock.resume(aged(through_the_file(memory), now_ns))
    return clock


def run(seed, away_s=0.0, **line):
    """A clock that died after 40 s; counts, true times, arrivals; from which on they are heard."""
    true_s, t_ns = frames(np.random.default_rng(seed), KILLED + round((away_s + 30.0) * HZ), **line)
    counts, clock = np.arange(true_s.size) * 5000 + 77, DeviceClock(*MICROSECONDS)
    placed(clock, counts[:KILLED], t_ns[:KILLED])
    back = int(np.searchsorted(t_ns, t_ns[KILLED - 1] + away_s * 1e9, "right"))
    return clock.memory(), (counts, true_s, t_ns), back


@pytest.mark.parametrize("seed", range(4))
def test_one_that_was_not_away_goes_on_with_the_last_bit(seed):
    rng = np.random.default_rng(seed)
    _, t_ns = frames(rng, 6000)
    counts, cut = np.arange(6000) * 5000, int(rng.integers(2500, 5000))
    cut = int(np.searchsorted(t_ns, t_ns[cut]))  # between two chunks
    whole, first, second = (DeviceClock(*MICROSECONDS) for _ in range(3))
    said = placed(whole, counts, t_ns)
    placed(first, counts[:cut], t_ns[:cut])
    second.resume(through_the_file(first.memory()))
    assert placed(second, counts[cut:], t_ns[cut:]) == said[cut:]
    assert second.report("time") == whole.report("time")


@pytest.mark.parametrize("away_s", [2.0, 30.0])
@pytest.mark.parametrize("seed", range(3))
def test_after_an_absence_the_first_frames_are_placed_as_well_as_the_last_before(seed, away_s):
    memory, (counts, true_s, t_ns), back = run(seed, away_s)
    clock = taken_up(memory, int(t_ns[back]))
    claimed_ms = clock.report("time").sigma_ms
    assert clock.state == "locked"
    error = errors_s(placed(clock, counts[back:], t_ns[back:]), true_s[back:])
    assert rms_ms(error) < 0.2
    assert 1e3 * abs(error[0]) < 4.0 * claimed_ms < 1.0
    assert clock.resets == 0


def test_a_process_that_knows_nothing_is_late_by_the_queues_of_its_first_second():
    first, error_s = round(HZ), {"taken up": [], "cold": []}
    for seed in range(6):
        memory, (counts, true_s, t_ns), back = run(seed, away_s=2.0)
        heard = slice(back, back + first)
        clocks = {"taken up": taken_up(memory, int(t_ns[back])), "cold": DeviceClock(*MICROSECONDS)}
        for name, clock in clocks.items():
            error_s[name] += [errors_s(placed(clock, counts[heard], t_ns[heard]), true_s[heard])]
    assert rms_ms(error_s["cold"]) > 5.0 * rms_ms(error_s["taken up"])


def test_the_longer_nobody_listened_the_less_is_claimed():
    memory, (_, _, t_ns), _ = run(0)
    heard = int(t_ns[KILLED - 1])
    claims = [taken_up(memory, heard + round(s * 1e9)).report("time").sigma_ms for s in (0, 10, 50)]
    assert claims == sorted(claims)
    assert claims[2] == pytest.approx(np.hypot(claims[0], 0.15), rel=0.01)  # 3 ppm of 50 s


@pytest.mark.parametrize("again", ["at zero", "behind", "ahead", "between"])
def test_a_power_cycle_meanwhile_is_found_out(again):
    """The count begins anew anywhere; where it looks like a queue, within a second of arrivals."""
    memory, (counts, true_s, t_ns), back = run(1, away_s=20.0)
    jump = {
        "at zero": -counts[back],
        "behind": -25_000_000,
        "ahead": 4_000_000,
        "between": -8_000_000,
    }
    clock = taken_up(memory, int(t_ns[back]))
    error = errors_s(placed(clock, counts[back:] + jump[again], t_ns[back:]), true_s[back:])
    assert clock.resets == 1
    assert rms_ms(error[round(1.2 * HZ) if again == "between" else 0 :]) < 5.0
    assert rms_ms(error[round(15.0 * HZ) :]) < 0.2
    assert clock.drift == pytest.approx(DRIFT, abs=3e-6)


@pytest.mark.parametrize("why", ["another boot", "too long", "a quick count"])
def test_the_drift_outlives_what_the_offset_does_not(why):
    memory, (counts, true_s, t_ns), back = run(2, away_s=20.0)
    heard, kind = int(t_ns[KILLED - 1]), MICROSECONDS
    now_ns = {"another boot": None, "too long": heard + round((ABSENCE_S + 1) * 1e9)}.get(why)
    if why == "a quick count":
        now_ns, kind = heard + round((OUTAGE_S + 0.1) * 1e9), (1.0 / HZ, 128)
        memory = msgspec.structs.replace(memory, unit_s=kind[0], modulus=kind[1])
        counts = np.arange(counts.size) % 128
    clock = taken_up(memory, now_ns, kind)
    assert (clock.state, clock.report("time").offset_s) == ("silent", None)
    assert clock.drift == 0.0 or clock.drift == memory.before.drift
    error = errors_s(placed(clock, counts[back:], t_ns[back:]), true_s[back:])
    assert clock.drift == pytest.approx(DRIFT, abs=3e-6)
    assert rms_ms(error[round(10.0 * HZ) :]) < 0.2
    assert clock.resets == 0
    assert taken_up(clock.memory(), int(t_ns[-1]), kind).state == "locked"


def test_a_drift_is_handed_on_by_a_process_that_heard_nothing():
    memory, _, _ = run(3)
    silent = taken_up(memory, None)
    again = silent.memory()
    assert again.placed is None
    assert again.before == memory.before
    assert DeviceClock(*MICROSECONDS).memory() is None


def test_the_memory_of_another_count_is_of_no_use():
    memory, _, _ = run(0)
    for kind in ((1e-3, 1 << 32), (1e-6, NEVER)):
        assert taken_up(memory, T0_NS, kind).memory() is None


# --- through the intake, with bytes ----------------------------------------------------------


def kvh(data):
    link = {"type": "udp", "port": 7001}
    common = {"kind": "imu", "codec": "kvh1750", "link": link, "rate_hz": HZ, "noise": IMU_NOISE}
    return Intake({"imu0": device(ImuDevice, common | data)})


def feed_kvh(intake, form, counts, t_ns):
    """Frames of the real codec; gives the times of validity (ns)."""
    codec = registry.lookup("kvh1750")
    options = device(codec.options, {"format": form})
    for chunk_ns, chunk in groupby(zip(counts.tolist(), t_ns.tolist(), strict=True), itemgetter(1)):
        records = [
            ImuRecord(
                t_rx_ns=0,
                sequence=count // 5000 % 128,
                t_device_s=count * 1e-6 % 2**32,
                delta_angle_rad=(0.0, 0.0, 0.0),
                specific_force_m_s2=(0.0, 0.0, -9.8),
            )
            for count, _ in chunk
        ]
        intake.feed(b"".join(codec.encode(record, options) for record in records), chunk_ns)
    return np.concatenate([np.frombuffer(block.t_ns, dtype=np.int64) for block in intake.flush()])


@pytest.mark.parametrize(("form", "source"), [("b", "device"), ("a", "arrival")])
def test_an_imu_goes_on_after_its_gateway_did(form, source):
    """By its own time as before; by a number of seven bits with the drift alone."""
    rng = np.random.default_rng(4)
    true_s, t_ns = frames(rng, 4000)
    counts = np.arange(4000) * 5000
    data = {"clock": {"source": source}}
    before, after, cold = kvh(data), kvh(data), kvh(data)
    feed_kvh(before, form, counts[:2400], t_ns[:2400])
    memory = before.clock_memory()["imu0"]
    (told,) = memory
    assert told == {"device": "time", "arrival": "sequence"}[source]
    back = int(np.searchsorted(t_ns, t_ns[3000]))
    left = {told: aged(through_the_file(memory[told]), int(t_ns[back]))}
    after.ingests["imu0"].resume(left)
    assert after.clock_memory()["imu0"] == left  # until it hears something
    errors = [
        (feed_kvh(intake, form, counts[back:], t_ns[back:]) - T0_NS) * 1e-9 - true_s[back:]
        for intake in (after, cold)
    ]
    report = after.clock_report()
    assert (report.source, report.resets) == (told, 0)
    if source == "device":
        assert rms_ms(errors[0]) < 0.2 < 0.5 * rms_ms(errors[1])
        assert report.state == "locked"
    else:
        assert (report.state, cold.clock_report().state) == ("warming", "warming")
        assert report.drift_ppm == pytest.approx(before.clock_report().drift_ppm, abs=3.0)


def test_what_is_placed_by_its_arrival_has_no_clock():
    link = {"type": "udp", "port": 7002}
    noise = {"position_m": [1.5, 1.5, 3.0], "velocity_m_s": 0.1}
    data = {"kind": "gnss", "codec": "nmea-gnss", "link": link, "noise": noise}
    intake = Intake({"gnss0": device(GnssDevice, data | {"clock": {"source": "arrival"}})})
    intake.ingests["gnss0"].resume({"time": ClockMemory(1e-3, 86_400_000, (0.0, inf, 0.0, 0), 0.0)})
    assert intake.clock_memory() == {"gnss0": {}}
