"""What each kind of instrument of a scenario says, as one stream of bytes."""

import heapq
from collections.abc import Iterable, Iterator
from operator import attrgetter

from gateway.emulator.acoustics import lbl_stream, usbl_stream
from gateway.emulator.aiding import aiding_stream
from gateway.emulator.faults.wire import faulty
from gateway.emulator.imu import imu_stream
from gateway.emulator.ports import paced
from gateway.emulator.scenario import (
    AnyPort,
    DepthModel,
    DeviceModel,
    DvlModel,
    GnssModel,
    HeadingModel,
    ImuModel,
    LblModel,
    Scenario,
    UsblModel,
)
from gateway.emulator.streams import Emission
from gateway.emulator.trajectory import Trajectory


def emissions(
    scenario: Scenario, trajectory: Trajectory, start_unix_s: float, block_s: float
) -> Iterator[Emission]:
    """All devices' bytes as they reach their ports, in the order of time.

    Devices with the same port share its line: each frame waits for those before it.
    """
    lines: dict[AnyPort, list[Iterator[Emission]]] = {}
    for name, model in scenario.devices.items():
        said = stream(scenario, name, model, trajectory, start_unix_s, block_s)
        lines.setdefault(model.port, []).append(faulty(said, name, scenario))
    return _in_order(paced(_in_order(said), port) for port, said in lines.items())


def _in_order(streams: Iterable[Iterator[Emission]]) -> Iterator[Emission]:
    return heapq.merge(*streams, key=attrgetter("t"))


def stream(
    scenario: Scenario,
    name: str,
    model: DeviceModel,
    trajectory: Trajectory,
    start_unix_s: float,
    block_s: float,
) -> Iterator[Emission]:
    """Frames of a device in the order they leave it, computed about ``block_s`` at a time."""
    match model:
        case ImuModel():
            return imu_stream(scenario, name, model, trajectory, start_unix_s, block_s)
        case UsblModel():
            return usbl_stream(scenario, name, model, trajectory, start_unix_s)
        case GnssModel() | DepthModel() | DvlModel() | HeadingModel():
            return aiding_stream(scenario, name, model, trajectory, start_unix_s, block_s)
        case LblModel():
            return lbl_stream(scenario, name, model, trajectory, start_unix_s)
