"""Checks across the blocks of the configuration file; each names its faults by their path.

They see a draft: a hole (see `gateway.schema.known`) stands where a fault has been named already.
"""

import math
from collections.abc import Iterator
from contextlib import suppress
from itertools import combinations

from drivers import registry
from gateway.config.block import Triple
from gateway.config.blocks import Config
from gateway.config.devices import GnssDevice, ImuDevice, ImuNoise, LblDevice, UsblDevice
from gateway.config.drafts import readable_devices
from gateway.config.lines import line_faults, sharing_faults
from gateway.config.outputs import output_faults
from gateway.config.ports import address_faults, port_faults
from gateway.schema import build, known

EARTH_RATE_DEG_H = 15.041
MAX_COMPASS_SIGMA_DEG = 10.0
"""A compass worse than this is none."""
COARSE_S = 0.05
"""A time told in longer steps says less than the arrival of the sentence."""


def cross_faults(config: Config) -> Iterator[str]:
    """Every fault that shows only where blocks meet."""
    for check in _CHECKS:
        yield from check(config)


def _one_imu(config: Config) -> Iterator[str]:
    if not known(config.devices):
        return
    imus = [name for name, device in config.devices.items() if isinstance(device, ImuDevice)]
    if len(imus) > 1:
        yield f"devices: {', '.join(imus)} are all of kind imu; exactly one is needed"
    elif not imus and known(*config.devices.values()):
        yield "devices: none is of kind imu; exactly one is needed"


def _one_of_a_kind(config: Config) -> Iterator[str]:
    for kind in ("usbl", "lbl", "gnss"):
        alike = [name for name, device in readable_devices(config).items() if device.kind == kind]
        if len(alike) > 1:
            yield f"devices: {', '.join(alike)} are all of kind {kind}; only one is available yet"


def _codecs(config: Config) -> Iterator[str]:
    for name, device in readable_devices(config).items():
        if not known(device.codec):
            continue
        try:
            codec = registry.lookup(device.codec)
        except (registry.UnknownCodecError, registry.CodecImportError) as error:
            yield f"devices.{name}.codec: {error}"
            continue
        if device.kind not in codec.kinds:
            fitting = [other.name for other in registry.all_codecs() if other.kind == device.kind]
            kinds = " and ".join(codec.kinds)
            wrong = f"{codec.name} is of kind {kinds}, the device of kind {device.kind}"
            yield f"devices.{name}.codec: {wrong}; one of: {', '.join(fitting)}"
        elif known(device.options):
            faults: list[str] = []
            build(codec.options, device.options, faults, f"devices.{name}.options")
            yield from faults


def _beacons(config: Config) -> Iterator[str]:
    if not known(config.beacons):
        return
    for name, device in readable_devices(config).items():
        if not config.beacons and isinstance(device, UsblDevice | LblDevice):
            yield f"beacons: missing; devices.{name} needs at least one"
            return
        if isinstance(device, LblDevice) and known(device.beacons):
            for n, beacon in enumerate(device.beacons):
                if beacon not in config.beacons:
                    yield f'devices.{name}.beacons[{n}]: no beacon is called "{beacon}"'
                elif beacon in config.targets:
                    place = f"devices.{name}.beacons[{n}]"
                    yield f'{place}: "{beacon}" is a target; ranges need a place'
    yield from _names_of_targets(config)


def _names_of_targets(config: Config) -> Iterator[str]:
    """A target's name is a key on Zenoh: two cannot share it."""
    first: dict[str, str] = {}
    for address, target in config.targets.items():
        if known(target.name):
            other = first.setdefault(target.name, address)
            if other != address:
                yield f"beacons.{address}.name: beacons.{other} has this name"


def _shared_constants(config: Config) -> Iterator[str]:
    """Lever arm and latency are estimated for one acoustic device, of which there may be two."""
    acoustic = {
        name: device
        for name, device in readable_devices(config).items()
        if isinstance(device, UsblDevice | LblDevice)
    }
    if len(acoustic) < 2:
        return
    for name, device in acoustic.items():
        prior = device.prior
        if not known(prior):
            continue
        for key, sigma in (("lever_arm_m", prior.lever_arm_m), ("latency_ms", prior.latency_ms)):
            if known(sigma) and sigma > 0.0:
                yield (
                    f"devices.{name}.prior.{key}: estimated for one acoustic device only;"
                    f" there are {' and '.join(acoustic)}"
                )


def _latencies(config: Config) -> Iterator[str]:
    if not known(config.filter) or not known(config.filter.history_s):
        return
    for name, device in readable_devices(config).items():
        if not known(device.clock) or not known(device.clock.latency_ms):
            continue
        if device.clock.latency_ms >= 1000 * config.filter.history_s:
            yield (
                f"devices.{name}.clock.latency_ms: {device.clock.latency_ms:g} ms is not within "
                f"filter.history_s ({config.filter.history_s:g} s); all its data would be too late"
            )


def _alignment(config: Config) -> Iterator[str]:
    """What is neither given nor found, and a compass that the gyros cannot be."""
    first = config.initial
    if not known(first) or not known(first.align):
        return
    if first.align is None or first.align.heading == "config":
        if first.attitude_deg is None:
            yield "initial.attitude_deg: missing; or let align find it"
        if known(first.sigma) and first.sigma.attitude_deg is None:
            yield "initial.sigma.attitude_deg: missing"
    elif first.align.heading == "gyrocompass" and known(first.lat_deg):
        for name, device in readable_devices(config).items():
            if isinstance(device, ImuDevice) and known(device.noise):
                yield from _no_compass(name, device.noise, first.lat_deg)
    elif first.align.heading == "gnss_course" and known(config.devices):
        devices = config.devices.values()
        if known(*devices) and not any(isinstance(device, GnssDevice) for device in devices):
            yield "initial.align.heading: gnss_course needs a device of kind gnss"


def _no_compass(name: str, noise: ImuNoise, lat_deg: float) -> Iterator[str]:
    if not known(noise.gyro_bias_deg_h):
        return
    rate_deg_h = EARTH_RATE_DEG_H * math.cos(math.radians(lat_deg))
    sigma_deg = math.degrees(noise.gyro_bias_deg_h / max(rate_deg_h, 1e-9))
    if sigma_deg > MAX_COMPASS_SIGMA_DEG:
        yield (
            f"initial.align.heading: gyrocompass needs better gyros than devices.{name}"
            f" (noise.gyro_bias_deg_h: {noise.gyro_bias_deg_h:g}): where the Earth turns at"
            f" {rate_deg_h:.2g} deg/h about north the heading would be worse than"
            f" {MAX_COMPASS_SIGMA_DEG:g} deg"
        )


def _clock_sources(config: Config) -> Iterator[str]:
    """A device's time that says nothing, or less than the arrival of what tells it."""
    for name, device in readable_devices(config).items():
        if not known(device.clock) or not known(device.codec) or device.kind == "imu":
            continue
        path = f"devices.{name}.clock.source"
        if device.clock.source != "arrival" and device.codec in registry.names():
            with suppress(registry.CodecImportError):
                step_s = registry.lookup(device.codec).counting.time_step_s
                if step_s is None:
                    yield f"{path}: {device.codec} tells no time; use arrival"
                elif step_s > COARSE_S:
                    yield f"{path}: {device.codec} tells its time to {step_s:g} s only; use arrival"


def _array(config: Config) -> Iterator[str]:
    for name, device in readable_devices(config).items():
        if not isinstance(device, UsblDevice):
            continue
        path, limits = f"devices.{name}", device.range_limits_m
        if known(limits) and limits is not None and limits[0] >= limits[1]:
            yield f"{path}.range_limits_m: the shortest range is not below the longest"
        if not known(device.direction, device.elements_m) or device.direction == "told":
            continue
        if _on_one_line(device.elements_m):
            yield (
                f"{path}.elements_m: direction by differences needs three elements or more that"
                " are not on one line"
            )


def _on_one_line(elements: tuple[Triple, ...]) -> bool:
    """Whether the elements, seen from above, span no plane."""
    ways = [(x - elements[0][0], y - elements[0][1]) for x, y, _ in elements[1:]]
    return all(math.isclose(a * d, b * c) for (a, b), (c, d) in combinations(ways, 2))


def _recording(config: Config) -> Iterator[str]:
    block = config.recording
    if block is None or not known(block) or not known(block.max_file_mb, block.quota_mb):
        return
    if block.quota_mb < 2.0 * block.max_file_mb:
        yield (
            f"recording.quota_mb: {block.quota_mb:g} MB are less than two files of"
            f" recording.max_file_mb ({block.max_file_mb:g} MB)"
        )


def _pulses(config: Config) -> Iterator[str]:
    for name, device in readable_devices(config).items():
        if not known(device.clock) or not known(device.clock.source, device.clock.pulses):
            continue
        path, clock = f"devices.{name}.clock", device.clock
        if clock.source != "pps":
            if clock.pulses is not None:
                yield f"{path}.pulses: only with source: pps"
        elif device.kind != "gnss":
            yield f"{path}.source: pps is for devices of kind gnss; the pulse of no other is read"
        elif clock.pulses is None:
            yield f"{path}.pulses: missing; such as /sys/class/pps/pps0/assert"


_CHECKS = (
    _one_imu,
    _one_of_a_kind,
    _codecs,
    _beacons,
    _shared_constants,
    _latencies,
    _clock_sources,
    _alignment,
    port_faults,
    sharing_faults,
    address_faults,
    line_faults,
    output_faults,
    _pulses,
    _array,
    _recording,
)
