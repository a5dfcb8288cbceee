"""The vehicle's true motion."""

from typing import Literal

from gateway.config.blocks import Latitude, Longitude, NonNegative, Positive
from gateway.emulator.scenario.block import Block


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


class _Track(Block, frozen=True, kw_only=True):
    """Where a vehicle goes.

    ``ramp_s``: time to reach the speed from rest; 0 starts under way. ``descent``: metres down for
    each metre of way, the vehicle staying level: a circle becomes a spiral.
    """

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float = 0.0
    speed_m_s: NonNegative
    ramp_s: NonNegative = 0.0
    descent: float = 0.0
    sway: Sway = Sway()


class Circle(_Track, frozen=True, kw_only=True, tag_field="type", tag="circle"):
    """Round and round the given point, starting on the given bearing from it."""

    radius_m: Positive
    start_bearing_deg: float = 0.0
    turn: Literal["starboard", "port"] = "starboard"


class Line(_Track, frozen=True, kw_only=True, tag_field="type", tag="line"):
    """Straight from the given point."""

    course_deg: float = 0.0


class Lawnmower(_Track, frozen=True, kw_only=True, tag_field="type", tag="lawnmower"):
    """Parallel legs from the given point, the first turn to starboard, until the time is over."""

    course_deg: float = 0.0
    leg_m: Positive
    spacing_m: Positive


class Legs(_Track, frozen=True, kw_only=True, tag_field="type", tag="legs"):
    """Legs of one length from the given point, a turn (positive to starboard) after each.

    Every turn takes the way ``turn_m``; the leg after the last one goes on.
    """

    course_deg: float = 0.0
    leg_m: Positive
    turn_m: Positive
    turns_deg: tuple[float, ...] = ()


Track = Circle | Line | Lawnmower | Legs
