"""The vehicle's true motion."""

from typing import Literal

from gateway.config.block import Block, Latitude, Longitude, NonNegative, Positive


class Wave(Block, frozen=True):
    """``amplitude`` sin(2 pi t / period + phase); amplitude in deg, of a displacement in m."""

    amplitude: NonNegative
    period_s: Positive
    phase_deg: float = 0.0


class Sway(Block, frozen=True):
    """What waves add to the smooth path; each is a sum of oscillations, heave upward."""

    roll: tuple[Wave, ...] = ()
    pitch: tuple[Wave, ...] = ()
    yaw: tuple[Wave, ...] = ()
    heave: tuple[Wave, ...] = ()
    north: tuple[Wave, ...] = ()
    east: tuple[Wave, ...] = ()


class _Moving(Block, frozen=True, kw_only=True):
    """``pitches``: whether the bow points along the slope; without, the vehicle stays level."""

    pitches: bool = False
    sway: Sway = Sway()


class _Track(_Moving, frozen=True, kw_only=True):
    """Where a vehicle goes; ``ramp_s``: time to reach the speed from rest; 0 starts under way."""

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float = 0.0
    speed_m_s: NonNegative
    ramp_s: NonNegative = 0.0


class _Sloping(_Track, frozen=True, kw_only=True):
    """``descent``: metres down for each metre of way, without an end."""

    descent: float = 0.0


class Circle(_Sloping, frozen=True, kw_only=True, tag_field="type", tag="circle"):
    """Round and round the given point, starting on the given bearing from it."""

    radius_m: Positive
    start_bearing_deg: float = 0.0
    turn: Literal["starboard", "port"] = "starboard"


class Line(_Sloping, frozen=True, kw_only=True, tag_field="type", tag="line"):
    """Straight from the given point."""

    course_deg: float = 0.0


class Lawnmower(_Sloping, frozen=True, kw_only=True, tag_field="type", tag="lawnmower"):
    """Parallel legs from the given point, the first turn to starboard, until the time is over."""

    course_deg: float = 0.0
    leg_m: Positive
    spacing_m: Positive


class Legs(_Sloping, frozen=True, kw_only=True, tag_field="type", tag="legs"):
    """Legs of one length from the given point, a turn (positive to starboard) after each.

    Every turn takes the way ``turn_m``; the leg after the last one goes on.
    """

    course_deg: float = 0.0
    leg_m: Positive
    turn_m: Positive
    turns_deg: tuple[float, ...] = ()


class Spiral(_Track, frozen=True, kw_only=True, tag_field="type", tag="spiral"):
    """Round the given point, ``pitch_m`` down a turn, and round and round at ``to_height_m``."""

    radius_m: Positive
    pitch_m: Positive
    to_height_m: float
    start_bearing_deg: float = 0.0
    turn: Literal["starboard", "port"] = "starboard"


class Transit(_Track, frozen=True, kw_only=True, tag_field="type", tag="transit"):
    """From rest at the given point straight to rest at ``distance_m``.

    It departs after ``wait_s`` and takes ``ramp_s`` to reach its speed, and to stop. With
    ``cruise_height_m`` it goes there within the way ``dive_m``, and comes back at the end.
    """

    distance_m: Positive
    ramp_s: Positive = 30.0
    wait_s: NonNegative = 0.0
    course_deg: float = 0.0
    cruise_height_m: float | None = None
    dive_m: Positive = 100.0


class Waypoint(Block, frozen=True, kw_only=True):
    """A place, and the speed from there on; 0 at the last one is the end of the way."""

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float = 0.0
    speed_m_s: NonNegative


class Waypoints(_Moving, frozen=True, kw_only=True, tag_field="type", tag="waypoints"):
    """Past waypoints, of a ``file`` or as ``points``, corners rounded within the way ``turn_m``.

    The file is looked for beside the scenario's. Speeds change within ``ramp_s``, heights smoothly
    from waypoint to waypoint.
    """

    file: str | None = None
    points: tuple[Waypoint, ...] = ()
    turn_m: Positive = 20.0
    ramp_s: Positive = 10.0
    from_rest: bool = False


Track = Circle | Line | Lawnmower | Legs | Spiral | Transit | Waypoints
