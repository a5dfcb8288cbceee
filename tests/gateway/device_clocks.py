"""Instruments with drifting clocks and the lines they are heard through, for the tests of time.

Bytes come from the real codecs and go through the real intake. A line delays each frame by an
exponential draw, never lets one overtake another, and hands over whole chunks of several frames.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np

from drivers import registry
from drivers.links import stamps
from drivers.records import GnssRecord, ImuRecord
from gateway.config import GnssDevice, ImuDevice
from gateway.ingest import Intake
from gateway.schema import build

T0_S = 5000.0
"""Host's monotonic time at the beginning."""
JITTER_S = 5e-3
LONGEST_CHUNK = 20
NTP_STEP_S = 3.0
IMU_NOISE = {
    "angle_random_walk_deg_sqrt_h": 0.002,
    "gyro_bias_deg_h": 0.02,
    "velocity_random_walk_ug_sqrt_hz": 20,
    "accel_bias_ug": 50,
}


@dataclass(frozen=True)
class Heard:
    """What the gateway made of a run: true times and errors (s) of its measurements.

    ``t_s`` counts from the run's beginning.
    """

    t_s: np.ndarray
    error_s: np.ndarray
    intake: Intake

    def rms_ms(self, *outside: tuple[float, float], since: float = 60.0) -> float:
        """Of all errors from `since` on, but for those in the spans `outside`."""
        used = self.t_s > since
        for begin, end in outside:
            used &= ~((self.t_s > begin) & (self.t_s < end))
        return float(1e3 * np.sqrt(np.mean(np.square(self.error_s[used]))))


class Wall:
    """The host's clocks: a wall clock that NTP sets once, and one that it does not touch."""

    def __init__(self, step_at_s: float) -> None:
        self.now_ns = 0
        self._step_at_ns = round((T0_S + step_at_s) * 1e9)

    def monotonic_ns(self) -> int:
        return self.now_ns

    def time_ns(self) -> int:
        return self.wall(self.now_ns)

    def wall(self, now_ns: int) -> int:
        """Unix time at a moment."""
        stepped = now_ns >= self._step_at_ns
        return now_ns + 1_790_000_000_000_000_000 + stepped * round(NTP_STEP_S * 1e9)


def device(kind: type, data: dict[str, Any]) -> Any:
    faults: list[str] = []
    block = build(kind, data, faults)
    assert block is not None, faults
    return block


def inertial(
    seed: int,
    *,
    source: str,
    seconds: float = 180.0,
    drift: float = 50e-6,
    wrap_at: float = 75.0,
    cycle_at: float = 90.0,
    step_at: float = 120.0,
    hz: float = 200.0,
) -> Heard:
    """A KVH by UDP: with its own time (`source` device, format B) or its sequence number alone.

    Its microseconds turn over at `wrap_at`, it is off for two seconds and begins anew at
    `cycle_at`, and at `step_at` NTP sets the host between a kernel's stamp and its reading.
    """
    rng = np.random.default_rng(seed)
    k = np.arange(int(seconds * hz))
    again = k >= round(cycle_at * hz)
    true_s = k / hz * (1.0 + drift) + 2.0 * again
    device_s = k / hz + np.where(again, 0.3 - cycle_at, 2**32 * 1e-6 - wrap_at)
    sequence = (k + 51 * again) % 128
    link = {"type": "udp", "port": 7001}
    options = {"format": "b" if source == "device" else "a"}
    data = {"kind": "imu", "codec": "kvh1750", "link": link, "rate_hz": hz, "noise": IMU_NOISE}
    intake = Intake({"imu0": device(ImuDevice, data | {"clock": {"source": source}})})
    codec = registry.lookup("kvh1750")
    options = device(codec.options, options)
    frames = [
        codec.encode(
            ImuRecord(
                t_rx_ns=0,
                sequence=int(sequence[n]),
                t_device_s=float(device_s[n]),
                delta_angle_rad=(0.0, 0.0, 0.0),
                specific_force_m_s2=(0.0, 0.0, -9.8),
            ),
            options,
        )
        for n in k
    ]
    arrival_s = true_s + JITTER_S * rng.exponential(size=k.size)
    feed(intake, rng, frames, T0_S + arrival_s, Wall(step_at))
    blocks = intake.flush()
    t_ns = np.concatenate([np.frombuffer(block.t_ns, dtype=np.int64) for block in blocks])
    assert np.all(np.diff(t_ns) > 0)
    assert t_ns.size == k.size
    return Heard(true_s, t_ns * 1e-9 - T0_S - true_s, intake)


def feed(
    intake: Intake, rng: np.random.Generator, frames: list[bytes], ready_s: np.ndarray, wall: Wall
) -> None:
    """Datagrams of one to twenty frames, stamped by a kernel and read up to 10 ms later."""
    ready_s = np.maximum.accumulate(ready_s)
    with patch.object(stamps, "time", wall), patch.object(stamps, "now_ns", wall.monotonic_ns):
        wall.now_ns = round(T0_S * 1e9)
        socket = stamps.MonotonicStamps()
        for first, last in spans(rng, ready_s):
            stamped = round(ready_s[last - 1] * 1e9)
            wall.now_ns = max(wall.now_ns, stamped + round(1e7 * rng.random()))
            intake.feed(b"".join(frames[first:last]), socket.of_wall(wall.wall(stamped)))


def spans(rng: np.random.Generator, ready_s: np.ndarray) -> Iterator[tuple[int, int]]:
    """Runs of one to twenty frames that share a chunk; a silence ends it."""
    silences = {0, *(np.flatnonzero(np.diff(ready_s) > 0.5) + 1).tolist(), ready_s.size}
    first = 0
    while first < ready_s.size:
        longest = first + int(rng.integers(1, LONGEST_CHUNK + 1))
        last = min(longest, min(end for end in silences if end > first))
        yield first, last
        first = last


def sentences(
    seed: int,
    *,
    source: str = "device",
    seconds: float = 240.0,
    drift: float = 50e-6,
    period_s: float = 2.0,
    midnight_at: float = 75.0,
    step_at: float = 120.0,
) -> Heard:
    """GGA at 9600 baud every two seconds, 80 ms after its epoch; the receiver's clock drifts.

    Midnight falls into the run, and at `step_at` the clock is set ahead by three seconds.
    """
    rng = np.random.default_rng(seed)
    baud, latency_s = 9600, 0.08
    link = {"type": "serial", "port": "/dev/ttyS0", "baud": baud}
    clock = {"source": source, "latency_ms": 1e3 * latency_s}
    noise = {"position_m": [1.5, 1.5, 3.0], "velocity_m_s": 0.1}
    data = {"kind": "gnss", "codec": "nmea-gnss", "link": link, "clock": clock, "noise": noise}
    intake = Intake({"gnss0": device(GnssDevice, data)})
    codec = registry.lookup("nmea-gnss")
    options = device(codec.options, {})
    device_s = np.arange(0.0, seconds, period_s)
    true_s = device_s * (1.0 + drift)
    told_s = 86_400.0 - midnight_at + device_s + NTP_STEP_S * (device_s >= step_at)
    for epoch_s, t_s in zip(true_s, told_s, strict=True):
        record = GnssRecord(
            t_rx_ns=0,
            sentence="GGA",
            valid=True,
            t_device_s=float(t_s % 86_400.0),
            lat_deg=60.0,
            lon_deg=5.0,
            height_m=40.0,
            quality=1,
        )
        line = codec.encode(record, options)
        begun_s = T0_S + epoch_s + latency_s + JITTER_S * rng.exponential()
        cut = int(rng.integers(0, len(line)))  # a sentence comes in one chunk or in two
        for sent in {cut, len(line)} - {0}:
            part = line[:sent] if sent == cut else line[cut:]
            intake.feed(part, round((begun_s + sent * 10.0 / baud) * 1e9))
    fixes = intake.flush()
    assert len(fixes) == true_s.size
    return Heard(true_s, np.array([fix.t_ns for fix in fixes]) * 1e-9 - T0_S - true_s, intake)
