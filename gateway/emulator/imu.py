"""An inertial unit's frames: its samples with its own counter, time and temperature."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from drivers import registry
from drivers.imu.anpp import AnppOptions
from drivers.records import ImuRecord
from gateway.emulator.faults.clocks import ImuClock
from gateway.emulator.faults.inertial import saturated
from gateway.emulator.leaving import Leaving, tells_age
from gateway.emulator.scenario import ImuModel, Scenario, codec_options
from gateway.emulator.sensors import ImuSensor, increments
from gateway.emulator.streams import Emission
from gateway.emulator.trajectory import Trajectory
from gateway.nav.attitude import C_from_euler

DAY_S, WEEK_S = 86_400.0, 604_800.0
GPS_EPOCH_UNIX_S = 315_964_800.0
LEAP_S = 18.0
"""By how much GPS time is ahead of UTC, since 2017."""


def imu_stream(
    scenario: Scenario,
    name: str,
    model: ImuModel,
    trajectory: Trajectory,
    start_unix_s: float,
    block_s: float,
) -> Iterator[Emission]:
    """Frames of an IMU in the order they leave it, computed ``block_s`` at a time.

    What it says of itself when it is switched on stands before its first sample.
    """
    dt, sensor = 1.0 / model.rate_hz, ImuSensor(model, scenario.seed, name)
    latency_ms = model.clock.latency_ms + model.age_ms
    leaving = Leaving(latency_ms, model.jitter_ms, scenario.seed, name)
    C_bs = C_from_euler(*np.deg2rad(model.mounting_deg))
    frames = Frames(model, start_unix_s)
    clock = ImuClock(
        scenario,
        name,
        registry.lookup(model.codec).counting,
        model.rate_hz,
        uptime_s=model.uptime_s,
        shown_s=_shown_at_start(model, start_unix_s),
    )
    said = registry.lookup(model.codec).powered_up(codec_options(model))
    power_ups = clock.power_ups if said else []
    total = int(scenario.duration_s * model.rate_hz)
    block = max(1, int(block_s * model.rate_hz))
    for first in range(0, total, block):
        k = np.arange(first, min(first + block, total))
        t_end = np.asarray((k + 1) * dt, dtype=np.float64)
        exact = increments(trajectory, t_end, dt).reshape(-1, 2, 3) @ C_bs
        sensed, within = sensor.sense(exact.reshape(-1, 6))
        sensed, within = saturated(scenario, name, t_end, dt, sensed, within)
        leaves = leaving.at(t_end)
        stamps = zip(t_end.tolist(), *clock.tell(t_end), strict=True)
        rows = zip(sensed.tolist(), within.tolist(), strict=True)
        for t_out, stamp, row in zip(leaves.tolist(), stamps, rows, strict=True):
            frame = frames.encode(Stamp(*stamp), *row)
            if power_ups and stamp[0] > power_ups[0]:
                power_ups = [t for t in power_ups if t >= stamp[0]]
                frame = said + frame
            yield Emission(t_out, name, frame)


def imu_faults(model: ImuModel) -> Iterator[str]:
    """What the unit's format could never say, by its key."""
    try:
        frame = Frames(model, 0.0).encode(Stamp(0.0, 0, 0.0), [0.0] * 6, valid=True)
    except ValueError as error:
        yield f"options: {error}"
        return
    if model.age_ms > 0.0:
        decoder = registry.lookup(model.codec).decoder(codec_options(model))
        if not tells_age(decoder, [frame]):
            yield f"age_ms: {model.codec} does not say how old a sample is; use clock.latency_ms"


class Stamp(NamedTuple):
    """When a sample ended (s after the start), and the number and time the unit puts on it."""

    t: float
    number: int
    told_s: float


class Frames:
    """Samples as bytes in the device's own format."""

    def __init__(self, model: ImuModel, start_unix_s: float) -> None:
        self._codec = registry.lookup(model.codec)
        self._options = codec_options(model)
        self._start_unix_s = start_unix_s
        self._model = model

    def encode(self, stamp: Stamp, row: list[float], valid: bool) -> bytes:
        """One frame; the record says every form of the sample, the codec's options choose one.

        Parameters
        ----------
        row
            Increments over the sample: angle (rad) and velocity (m/s), sensor axes.
        valid
            Whether the unit could measure them.
        """
        x, y, z, u, v, w = row
        hz = self._model.rate_hz
        record = ImuRecord(
            t_rx_ns=0,
            age_s=1e-3 * self._model.age_ms,
            sequence=stamp.number,
            t_device_s=stamp.told_s,
            valid=valid,
            delta_angle_rad=(x, y, z),
            rate_rad_s=(hz * x, hz * y, hz * z),
            delta_velocity_m_s=(u, v, w),
            specific_force_m_s2=(hz * u, hz * v, hz * w),
            interval_s=1.0 / hz,
            since_pulse_s=(self._start_unix_s % 1.0 + stamp.t) % 1.0,
            temperature_c=self._temperature(stamp.t),
        )
        return self._codec.encode(record, self._options)

    def _temperature(self, t: float) -> float:
        warming = self._model.warming
        if warming is None:
            return self._model.temperature_c
        warmed = 1.0 - float(np.exp(-t / warming.time_s))
        return self._model.temperature_c + warming.by_c * warmed


def _shown_at_start(model: ImuModel, start_unix_s: float) -> float | None:
    """What the unit's clock shows at t = 0; None if it counts from its power-up."""
    match model.codec, codec_options(model):
        case "novatel-span", _:
            return (start_unix_s - GPS_EPOCH_UNIX_S + LEAP_S) % WEEK_S
        case "stdbin", _:
            return start_unix_s % DAY_S
        case "anpp", AnppOptions(time="unix"):
            return start_unix_s
    return None
