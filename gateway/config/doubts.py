"""Values that are possible and yet most likely a slip: another unit, a sign, a place far away."""

import math
from collections.abc import Iterator

from gateway.config.blocks import Config
from gateway.config.devices import ImuNoise, LblDevice, UsblDevice

FAR_KM = 100.0
"""Sound does not carry so far: a beacon beyond is not where the vehicle begins."""
ABOVE_M = 20.0
"""Of a beacon over the place where the vehicle begins: a depth without its minus."""
LONG_LEVER_M = 100.0
"""A ship is that long; written in millimetres any arm is."""
PROMPT_MS = 5.0
"""No topside says a reply sooner than its pulse has passed; written in seconds any would."""
PROMPT_TURNAROUND_MS = 1.0
POOR_HEADING_DEG = 1.0
"""Known worse at first, a heading is what the filter finds."""
GREAT_SCALE = 0.05
"""1 sigma of the sound speed in the whole range from ice to the tropics."""

_IMU_SPANS = {
    "angle_random_walk_deg_sqrt_h": (1e-5, 20.0),
    "gyro_bias_deg_h": (1e-5, 2000.0),
    "velocity_random_walk_ug_sqrt_hz": (0.1, 5000.0),
    "accel_bias_ug": (0.1, 100_000.0),
}
"""From the best unit that is sold to one of a telephone; 0 is a bias that is known."""

_EARTH_KM = 6371.0


def doubts(config: Config) -> Iterator[str]:
    """What of a sound configuration its writer should look at once more, each with its path."""
    yield from _lever_arms(config)
    yield from _times(config)
    yield from _noise(config)
    yield from _beacons(config)
    yield from _filter(config)


def _lever_arms(config: Config) -> Iterator[str]:
    for name, device in config.devices.items():
        length = math.hypot(*getattr(device, "lever_arm_m", ()))
        if length > LONG_LEVER_M:
            yield f"devices.{name}.lever_arm_m: {length:.0f} m from the IMU; it is in metres"


def _times(config: Config) -> Iterator[str]:
    for name, device in config.acoustic.items():
        clock = device.clock
        if clock.source == "arrival" and 0.0 < clock.latency_ms < PROMPT_MS:
            yield (
                f"devices.{name}.clock.latency_ms: {clock.latency_ms:g} ms is sooner than a"
                " reply's pulse has passed; it is in milliseconds"
            )
    for address, beacon in config.beacons.items():
        if 0.0 < beacon.turnaround_ms < PROMPT_TURNAROUND_MS:
            yield (
                f"beacons.{address}.turnaround_ms: {beacon.turnaround_ms:g} ms is very prompt;"
                " it is in milliseconds"
            )


def _noise(config: Config) -> Iterator[str]:
    name, imu = config.imu
    yield from _imu_noise(f"devices.{name}.noise", imu.noise)
    for name, device in config.acoustic.items():
        assert isinstance(device, UsblDevice | LblDevice)
        if device.prior.range_scale > GREAT_SCALE:
            yield (
                f"devices.{name}.prior.range_scale: {device.prior.range_scale:g} is"
                f" {100 * device.prior.range_scale:g} % of the sound speed; 0.002 is 3 m/s"
            )


def _imu_noise(path: str, noise: ImuNoise) -> Iterator[str]:
    for key, (best, worst) in _IMU_SPANS.items():
        value = getattr(noise, key)
        if value and not best <= value <= worst:
            yield f"{path}.{key}: {value:g} is of no IMU; they have {best:g} to {worst:g}"


def _beacons(config: Config) -> Iterator[str]:
    begin = config.initial
    hears_above = any(array.looks == "up" for array in config.usbl.values())
    for address, beacon in config.moored.items():
        path = f"beacons.{address}"
        way_km = _way_km(beacon.lat_deg, beacon.lon_deg, begin.lat_deg, begin.lon_deg)
        above_m = beacon.height_m - begin.height_m
        if way_km > FAR_KM:
            yield (
                f"{path}: {way_km:.0f} km from initial;"
                " exchanged latitude and longitude, or a wrong sign?"
            )
        if above_m > ABOVE_M and config.usbl and not hears_above:
            yield (
                f"{path}.height_m: {above_m:.0f} m above where the vehicle begins;"
                " heights under water are negative"
            )


def _filter(config: Config) -> Iterator[str]:
    """One beacon tells no heading: the vehicle may have turned about it, as its place may.

    A filter whose error is not the right-invariant one finds some all the same.
    """
    error, begin = config.filter.error, config.initial
    sees_north = any(device.kind in ("gnss", "heading") for device in config.devices.values())
    known = begin.align is None or begin.align.heading in ("config", "gyrocompass")
    sigma = begin.sigma.attitude_deg
    poor = not known or (sigma is not None and sigma[2] >= POOR_HEADING_DEG)
    if error != "right_invariant" and len(config.moored) == 1 and poor and not sees_north:
        yield (
            f"filter.error: {error} claims a heading that one beacon does not tell;"
            " right_invariant does not"
        )


def _way_km(lat1: float, lon1: float, lat2: float, lon2: float) -> float:
    """Great circle (deg)."""
    lat1, lat2, east = math.radians(lat1), math.radians(lat2), math.radians(lon2 - lon1)
    half = (
        math.sin(0.5 * (lat2 - lat1)) ** 2
        + math.cos(lat1) * math.cos(lat2) * math.sin(0.5 * east) ** 2
    )
    return 2.0 * _EARTH_KM * math.asin(min(1.0, math.sqrt(half)))
