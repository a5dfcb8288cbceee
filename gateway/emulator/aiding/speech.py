"""An aiding instrument's measurements as bytes, each when it leaves the instrument."""

import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from drivers import registry
from drivers.records import Record
from gateway.emulator.aiding.depth import DepthSensor
from gateway.emulator.aiding.dvl import DopplerLog
from gateway.emulator.aiding.gnss import Receiver
from gateway.emulator.aiding.heading import Compass
from gateway.emulator.aiding.sensing import Aboard, Array
from gateway.emulator.leaving import Leaving, tells_age
from gateway.emulator.scenario import (
    AidingModel,
    DepthModel,
    DvlModel,
    GnssModel,
    HeadingModel,
    Scenario,
    codec_options,
)
from gateway.emulator.streams import Emission, generator
from gateway.emulator.trajectory import Trajectory


class Instrument(Protocol):
    """What measures, in the order of time."""

    def say(self, t: Array) -> Iterator[tuple[Record, ...]]:
        """What it says about each of the moments (n,) s."""
        ...


def aiding_stream(
    scenario: Scenario,
    name: str,
    model: AidingModel,
    trajectory: Trajectory,
    start_unix_s: float,
    block_s: float,
) -> Iterator[Emission]:
    """Frames of an instrument in the order they leave it, computed ``block_s`` at a time.

    What its format cannot say is an emission without bytes.
    """
    codec, options = registry.lookup(model.codec), codec_options(model)
    instrument = _instrument(scenario, name, model, trajectory, start_unix_s)
    leaving = Leaving(model.clock.latency_ms + _age_ms(model), model.jitter_ms, scenario.seed, name)
    missed = generator(scenario.seed, name, "missed")
    for t in _moments(scenario, model, start_unix_s, block_s):
        is_said = missed.random(t.size) >= model.missed_probability
        said = zip(leaving.at(t).tolist(), instrument.say(t), is_said.tolist(), strict=True)
        for t_out, records, heard in said:
            for record in records if heard else ():
                try:
                    frame = codec.encode(record, options)
                except ValueError:
                    frame = b""
                yield Emission(t_out, name, frame)


def aiding_faults(scenario: Scenario, model: AidingModel) -> Iterator[str]:
    """What the instrument could never measure or its format never say, by its key."""
    if scenario.sea_bed_depth_m is None and _needs_bed(model):
        yield "kind: it measures the bottom; sea_bed_depth_m is missing"
        return
    codec, options = registry.lookup(model.codec), codec_options(model)
    trajectory = Trajectory(scenario.trajectory, 0.0)
    instrument = _instrument(scenario, "", model, trajectory, 0.0)
    try:
        frames = [codec.encode(r, options) for said in instrument.say(np.zeros(1)) for r in said]
    except ValueError as error:
        yield f"codec: {error}"
        return
    if _age_ms(model) > 0.0 and not tells_age(codec.decoder(options), frames):
        yield f"age_ms: {model.codec} does not say how old a ping is; use clock.latency_ms"


def _instrument(
    scenario: Scenario,
    name: str,
    model: AidingModel,
    trajectory: Trajectory,
    start_unix_s: float,
) -> Instrument:
    match model:
        case GnssModel():
            return Receiver(Aboard(scenario, name, model, trajectory, start_unix_s))
        case DepthModel():
            return DepthSensor(Aboard(scenario, name, model, trajectory, start_unix_s))
        case DvlModel():
            return DopplerLog(Aboard(scenario, name, model, trajectory, start_unix_s))
        case HeadingModel():
            return Compass(Aboard(scenario, name, model, trajectory, start_unix_s))


def _moments(
    scenario: Scenario, model: AidingModel, start_unix_s: float, block_s: float
) -> Iterator[Array]:
    """Times of measurements, block by block; those of a receiver at whole periods of UTC."""
    rate, first_s = model.rate_hz, 0.0
    if isinstance(model, GnssModel):
        first_s = math.ceil(start_unix_s * rate) / rate - start_unix_s
    total = max(0, math.ceil((scenario.duration_s - first_s) * rate))
    block = max(1, int(block_s * rate))
    for k in range(0, total, block):
        yield first_s + np.arange(k, min(k + block, total)) / rate


def _age_ms(model: AidingModel) -> float:
    return model.age_ms if isinstance(model, DvlModel) else 0.0


def _needs_bed(model: AidingModel) -> bool:
    sounder = getattr(codec_options(model), "measures", "depth") == "altitude"
    return isinstance(model, DvlModel) or sounder
