"""A scenario file and the gateway configuration that matches it: one truth for both."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np

from gateway.config.blocks import Beacon, Config
from gateway.config.checks import cross_faults
from gateway.config.devices import Device, DeviceKind
from gateway.emulator import acoustics
from gateway.emulator.aiding import aiding_faults
from gateway.emulator.imu import imu_faults
from gateway.emulator.scenario import (
    AnyPort,
    DeviceModel,
    ImuModel,
    LblModel,
    Mobile,
    PtyPort,
    Scenario,
    SerialPort,
    TcpServerPort,
    Track,
    UdpPort,
    UsblModel,
    Waypoints,
)
from gateway.emulator.scenario.faults import BeaconDead, BeaconMoved
from gateway.emulator.streams import generator
from gateway.emulator.tracks import way_of
from gateway.emulator.trajectory import Trajectory
from gateway.emulator.waypoints import read_waypoints
from gateway.errors import ConfigError
from gateway.nav import earth
from gateway.schema import build, read_yaml

DEMO = Path(__file__).parent / "scenarios" / "demo.yaml"
"""The packaged scenario of the demo."""

_FIRST_UDP_PORT = 7001
_BLOCKS: dict[DeviceKind, type[Device]] = {block.kind: block for block in get_args(Device)}


def load(path: Path) -> Scenario:
    """Read a scenario file; it is sound when the configuration that matches it is.

    Raises
    ------
    ConfigError
        With every fault found, each with its path in the file.
    """
    return sound(read_yaml(path), path)


def sound(data: Any, path: Path | None = None) -> Scenario:
    """Make a scenario of plain data, as `load` does of a file."""
    faults: list[str] = []
    scenario = build(Scenario, data, faults)
    if scenario is None:
        raise ConfigError(faults, path)
    scenario = _with_waypoints(scenario, path.parent if path else Path(), faults)
    faults.extend(_missing(scenario))
    if faults:
        raise ConfigError(faults, path)
    config = build(Config, gateway_config(scenario), faults)
    if config is not None:
        faults.extend(cross_faults(config))
    faults.extend(_impossible(scenario))
    if not faults:
        faults.extend(_unsayable(scenario))
    if faults:
        raise ConfigError(faults, path)
    return scenario


def _impossible(scenario: Scenario) -> Iterator[str]:
    """Faults that come at no time, or to nobody."""
    for k, fault in enumerate(scenario.faults):
        if (fault.at_s is None) == (fault.per_hour is None):
            yield f"faults[{k}]: expected either at_s or per_hour"
        if isinstance(fault, BeaconDead | BeaconMoved):
            if fault.beacon not in scenario.beacons:
                yield f'faults[{k}].beacon: no beacon is called "{fault.beacon}"'
            elif isinstance(fault, BeaconMoved) and fault.beacon in scenario.mobile:
                yield f'faults[{k}].beacon: "{fault.beacon}" moves by its own trajectory'
        elif fault.device not in scenario.devices:
            yield f"faults[{k}].device: no device is called {fault.device}"


def _with_waypoints(scenario: Scenario, folder: Path, faults: list[str]) -> Scenario:
    """The scenario with the points of its files, and whether a way leads past each of them."""

    def read(track: Track, path: str) -> Track:
        found = list[str]()
        if isinstance(track, Waypoints) and track.file is not None:
            if track.points:
                found.append("points: there is a file as well")
            points = read_waypoints(folder / track.file, scenario.surface_height_m, found)
            track = msgspec.structs.replace(track, file=None, points=points)
        if not found:
            try:
                way_of(track, 0.0)
            except ValueError as error:
                found.append(str(error))
        faults.extend(f"{path}.{fault}" for fault in found)
        return track

    moving = {
        n: msgspec.structs.replace(b, trajectory=read(b.trajectory, f"beacons.{n}.trajectory"))
        for n, b in scenario.mobile.items()
    }
    return msgspec.structs.replace(
        scenario,
        trajectory=read(scenario.trajectory, "trajectory"),
        beacons=scenario.beacons | moving,
    )


def _missing(scenario: Scenario) -> Iterator[str]:
    """What one of several keys must say."""
    for name, model in scenario.devices.items():
        if isinstance(model, ImuModel) and model.noise is None and model.grade is None:
            yield f"devices.{name}.noise: missing; or name a grade"


def _unsayable(scenario: Scenario) -> Iterator[str]:
    """What the devices' formats could never say."""
    for name, model in scenario.devices.items():
        if isinstance(model, ImuModel):
            yield from (f"devices.{name}.{fault}" for fault in imu_faults(model))
        elif isinstance(model, UsblModel | LblModel):
            yield from acoustics.faults(scenario, name, model)
        else:
            yield from (f"devices.{name}.{fault}" for fault in aiding_faults(scenario, model))


def gateway_config(scenario: Scenario) -> dict[str, Any]:
    """Plain data in the shape of the gateway's ``config.yaml``, without outputs.

    The devices, links and beacons are the scenario's; the first state is the truth at t = 0 with
    errors drawn from its sigma by the scenario's seed.
    """
    config = {
        "vehicle": scenario.vehicle,
        "devices": {name: _device(scenario, model) for name, model in scenario.devices.items()},
        "beacons": {n: _beacon(b) for n, b in scenario.beacons.items()},
        "sound_speed_m_s": scenario.sound_speed_m_s,
        "initial": _initial(scenario),
    }
    plain: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(config))
    return plain


def for_capture(scenario: Scenario) -> Scenario:
    """The same scenario with every device on UDP, as a capture file holds it.

    What is on another kind of port gets the next free UDP port of 127.0.0.1 from 7001 on.
    """
    ports = {model.port for model in scenario.devices.values()}
    taken = {port.port for port in ports if isinstance(port, UdpPort)}
    free = (port for port in range(_FIRST_UDP_PORT, 65536) if port not in taken)
    lines: dict[AnyPort, UdpPort] = {}
    devices: dict[str, DeviceModel] = {}
    for name, model in scenario.devices.items():
        if not isinstance(model.port, UdpPort) and model.port not in lines:
            lines[model.port] = UdpPort(port=next(free))
        port = lines.get(model.port, model.port)
        devices[name] = msgspec.structs.replace(model, port=port)
    return msgspec.structs.replace(scenario, devices=devices)


def _device(scenario: Scenario, model: DeviceModel) -> dict[str, Any]:
    """Every key of the configuration's block that the scenario has too."""
    whole = {"surface_height_m": scenario.surface_height_m, **msgspec.to_builtins(model)}
    if isinstance(model, ImuModel):
        whole["noise"] = msgspec.to_builtins(model.sheet.noise)
    shared = [key for key in _BLOCKS[whole["kind"]].__struct_fields__ if key in whole]
    block = {"kind": whole["kind"], "link": _link(model.port)}
    block |= {key: whole[key] for key in shared}
    block["noise"] = {k: v for k, v in block["noise"].items() if v is not None}
    return block


def _beacon(beacon: Beacon | Mobile) -> dict[str, Any]:
    """Of what moves the gateway is not told how."""
    block: dict[str, Any] = msgspec.to_builtins(beacon)
    block.pop("trajectory", None)
    return block


def _link(port: AnyPort) -> dict[str, Any]:
    match port:
        case UdpPort():
            return {"type": "udp", "bind": port.host, "port": port.port}
        case TcpServerPort():
            return {"type": "tcp", "host": port.bind, "port": port.port}
        case PtyPort():
            return {"type": "serial", "port": port.symlink, "baud": port.baud}
        case SerialPort():
            return {"type": "serial", "port": port.port, "baud": port.baud}


def _initial(scenario: Scenario) -> dict[str, Any]:
    truth = Trajectory(scenario.trajectory, scenario.duration_s).geodetic(np.zeros(1))
    sigma = scenario.initial.sigma
    draw = generator(scenario.seed, "initial").standard_normal(9)
    north, east, down = np.array(sigma.position_m) * draw[:3]
    velocity = truth.v_eb_n[0] + sigma.velocity_m_s * draw[3:6]
    euler = np.rad2deg([truth.roll[0], truth.pitch[0], truth.heading[0]])
    attitude = euler + np.array(sigma.attitude_deg) * draw[6:]
    R_M, R_N = earth.radii(truth.lat[0])
    h = truth.h[0]
    return {
        "lat_deg": float(np.rad2deg(truth.lat[0] + north / (R_M + h))),
        "lon_deg": float(np.rad2deg(truth.lon[0] + east / ((R_N + h) * np.cos(truth.lat[0])))),
        "height_m": float(h - down),
        "velocity_ned_m_s": velocity.tolist(),
        "attitude_deg": attitude.tolist(),
        "sigma": msgspec.to_builtins(sigma),
    }
