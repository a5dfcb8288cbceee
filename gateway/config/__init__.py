"""The configuration file: its blocks, and `load`, which names every fault at once with its path."""

from pathlib import Path

import msgspec

from drivers import registry
from drivers.codec import Codec
from gateway.config.blocks import (
    Align,
    Beacon,
    Config,
    Filter,
    Initial,
    InitialSigma,
    Output,
    Realtime,
    Recording,
    StateFile,
    Target,
)
from gateway.config.checks import cross_faults
from gateway.config.devices import (
    Clock,
    DepthDevice,
    DepthNoise,
    Device,
    DeviceKind,
    DvlDevice,
    DvlNoise,
    GnssDevice,
    GnssNoise,
    HeadingDevice,
    HeadingNoise,
    ImuDevice,
    ImuNoise,
    LblDevice,
    LblNoise,
    LblPrior,
    UsblDevice,
    UsblNoise,
    UsblPrior,
)
from gateway.config.doubts import doubts
from gateway.config.nmea import NmeaOutput
from gateway.config.zenoh import MapOrigin, ZenohOutput, ZenohRos, ZenohTls
from gateway.errors import ConfigError
from gateway.schema import build, draft, known, read_yaml

__all__ = [
    "Align",
    "Beacon",
    "Clock",
    "Config",
    "DepthDevice",
    "DepthNoise",
    "Device",
    "DeviceKind",
    "DvlDevice",
    "DvlNoise",
    "Filter",
    "GnssDevice",
    "GnssNoise",
    "HeadingDevice",
    "HeadingNoise",
    "ImuDevice",
    "ImuNoise",
    "Initial",
    "InitialSigma",
    "LblDevice",
    "LblNoise",
    "LblPrior",
    "MapOrigin",
    "NmeaOutput",
    "Output",
    "Realtime",
    "Recording",
    "StateFile",
    "Target",
    "UsblDevice",
    "UsblNoise",
    "UsblPrior",
    "ZenohOutput",
    "ZenohRos",
    "ZenohTls",
    "doubts",
    "load",
    "wire_format",
]


def load(path: Path) -> Config:
    """Read, validate and cross-check a configuration file.

    Raises
    ------
    ConfigError
        With every fault found, each with its path in the file.
    """
    data = read_yaml(path)
    faults: list[str] = []
    config = draft(Config, data, faults)
    if known(config):
        faults.extend(cross_faults(config))
    if faults:
        raise ConfigError(faults, path)
    return config


def wire_format(device: Device) -> tuple[Codec, msgspec.Struct]:
    """Codec of a checked device, and its options as the codec's own Struct."""
    codec = registry.lookup(device.codec)
    faults: list[str] = []
    options = build(codec.options, device.options, faults, "options")
    if options is None:
        raise ConfigError(faults)
    return codec, options
