"""From a scenario's track to where it leads: a curve, a depth along it, a pace along it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.flyby import course_past
from gateway.emulator.ramps import Change, Ramps, Smooth, Steps
from gateway.emulator.routes import CircularRoute, Route, StraightRoute, lawnmower, legs
from gateway.emulator.scenario import (
    Circle,
    Lawnmower,
    Legs,
    Line,
    Spiral,
    Track,
    Transit,
    Waypoint,
    Waypoints,
)
from gateway.nav import earth

Array = NDArray[np.float64]
_SPARE_S = 60.0


@dataclass(frozen=True)
class Way:
    """A track in the frame north, east, down, fixed to the Earth at its origin.

    Attributes
    ----------
    r0_e, C_et
        (3,) m and (3, 3) of the origin and the frame there.
    route, depth, pace
        Curve over the way (m), metres below the origin over the way, way over time (s).
    """

    r0_e: Array
    C_et: Array
    route: Route
    depth: Smooth
    pace: Smooth


def way_of(track: Track, duration_s: float) -> Way:
    """Lay out a track.

    Raises
    ------
    ValueError
        If it cannot be laid out, with the key that is to blame.
    """
    if isinstance(track, Waypoints):
        return _past(track, duration_s)
    lat, lon = np.deg2rad([track.lat_deg, track.lon_deg])
    depth: Smooth
    match track:
        case Spiral():
            depth = _descent(track)
        case Transit():
            depth = _dive(track)
        case _:
            depth = Ramps(track.descent)
    pace = _there(track) if isinstance(track, Transit) else _pace(track.speed_m_s, track.ramp_s)
    r0_e = earth.lla_to_ecef(lat, lon, track.height_m)
    return Way(r0_e, earth.C_en(lat, lon), _route(track, duration_s), depth, pace)


def _route(track: Circle | Line | Lawnmower | Legs | Spiral | Transit, duration_s: float) -> Route:
    length = track.speed_m_s * (duration_s + _SPARE_S)
    match track:
        case Circle() | Spiral():
            turn = 1 if track.turn == "starboard" else -1
            return CircularRoute(track.radius_m, np.deg2rad(track.start_bearing_deg), turn)
        case Line() | Transit():
            return StraightRoute(np.deg2rad(track.course_deg))
        case Lawnmower():
            return lawnmower(np.deg2rad(track.course_deg), track.leg_m, track.spacing_m, length)
        case Legs():
            turns = np.deg2rad(track.turns_deg).tolist()
            return legs(np.deg2rad(track.course_deg), track.leg_m, turns, track.turn_m, length)


def _pace(speed: float, ramp: float) -> Ramps:
    """Under way from the start, or from rest."""
    return Ramps(speed) if ramp == 0.0 else Ramps(0.0, [Change(0.0, ramp, speed)])


def _descent(track: Spiral) -> Ramps:
    """Down, or up, turn by turn, beginning and ending within a quarter of a circle."""
    down = track.height_m - track.to_height_m
    slope = np.sign(down) * track.pitch_m / (2.0 * np.pi * track.radius_m)
    if down == 0.0:
        return Ramps(0.0)
    end = down / slope
    over = min(0.5 * np.pi * track.radius_m, end)
    return Ramps(0.0, [Change(0.0, over, slope), Change(end, over, 0.0)])


def _dive(track: Transit) -> Steps:
    """Down to the cruise and up again to where it began."""
    if track.cruise_height_m is None:
        return Steps([0.0], [0.0])
    down = track.height_m - track.cruise_height_m
    if 2.0 * track.dive_m >= track.distance_m:
        raise ValueError("dive_m: expected less than half of distance_m")
    knots = [0.0, track.dive_m, track.distance_m - track.dive_m, track.distance_m]
    return Steps(knots, [0.0, down, down, 0.0])


def _there(track: Transit) -> Ramps:
    """From rest to the speed, and to rest where the distance ends."""
    speed, ramp = track.speed_m_s, track.ramp_s
    if speed <= 0.0:
        raise ValueError("speed_m_s: expected a number > 0")
    arrive = track.wait_s + track.distance_m / speed
    if arrive < track.wait_s + ramp:
        raise ValueError(f"distance_m: less than it takes to reach {speed:g} m/s and to stop")
    return Ramps(0.0, [Change(track.wait_s, ramp, speed), Change(arrive, ramp, 0.0)])


def _past(track: Waypoints, duration_s: float) -> Way:
    """Past waypoints, through the air line between their heights."""
    points = track.points
    if len(points) < 2:
        raise ValueError("points: expected two or more")
    if any(point.speed_m_s <= 0.0 for point in points[:-1]):
        raise ValueError("points: the vehicle would stop before the last; let speeds be > 0")
    lat, lon = np.deg2rad([[p.lat_deg, p.lon_deg] for p in points]).T
    r_e = earth.lla_to_ecef(lat, lon, np.array([p.height_m for p in points]))
    C_et = earth.C_en(lat[0], lon[0])
    r_t = (r_e - r_e[0]) @ C_et
    onward_m = points[-1].speed_m_s * (duration_s + _SPARE_S) + 1e3
    course = course_past(r_t[:, :2], track.turn_m, onward_m)
    passed = course.passed.tolist()
    depth = Steps(passed, r_t[:, 2].tolist())
    return Way(r_e[0], C_et, course.route, depth, _paces(track, points, passed))


def _paces(track: Waypoints, points: tuple[Waypoint, ...], passed: list[float]) -> Ramps:
    """At each waypoint the speed changes to the one it states."""
    speed = 0.0 if track.from_rest else points[0].speed_m_s
    first, changes, t = speed, list[Change](), 0.0
    for k, point in enumerate(points):
        mean = 0.5 * (speed + point.speed_m_s)
        leg = passed[k + 1] - passed[k] if k + 1 < len(points) else np.inf
        over = min(track.ramp_s, leg / mean if mean > 0.0 else np.inf)
        changes.append(Change(t, over, point.speed_m_s))
        speed = point.speed_m_s
        if k + 1 < len(points):
            t += over + (leg - mean * over) / speed
    return Ramps(first, changes)
