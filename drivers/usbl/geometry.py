"""Bearing, elevation and range of a point in x forward, y starboard, z down, and back."""

from math import atan2, cos, degrees, hypot, radians, sin, sqrt

from drivers.records import UsblRecord, Vec3


def polar(xyz_m: Vec3) -> tuple[float, float, float]:
    """Bearing to starboard (deg), elevation up (deg) and distance (m) of a point."""
    x, y, z = xyz_m
    horizontal = hypot(x, y)
    # Plus zero: there is no bearing and no elevation of minus zero.
    bearing_deg, elevation_deg = degrees(atan2(y, x)) + 0.0, degrees(atan2(-z, horizontal)) + 0.0
    return bearing_deg, elevation_deg, sqrt(horizontal * horizontal + z * z)


def cartesian(bearing_deg: float, elevation_deg: float, slant_range_m: float) -> Vec3:
    """Give the point (m) that lies so."""
    bearing, elevation = radians(bearing_deg), radians(elevation_deg)
    horizontal = slant_range_m * cos(elevation)
    return horizontal * cos(bearing), horizontal * sin(bearing), -slant_range_m * sin(elevation)


def place(record: UsblRecord) -> Vec3 | None:
    """Where a record says the beacon is: its xyz, or by its angles and range; None if neither."""
    if record.xyz_m is not None:
        return record.xyz_m
    polar_said = record.bearing_deg, record.elevation_deg, record.slant_range_m
    match polar_said:
        case (float(bearing_deg), float(elevation_deg), float(slant_range_m)):
            return cartesian(bearing_deg, elevation_deg, slant_range_m)
    return None
