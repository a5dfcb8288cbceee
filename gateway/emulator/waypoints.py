"""The file of waypoints: one a line, as comma-separated values with a heading."""

import csv
from pathlib import Path

from gateway.config.block import Block, Latitude, Longitude, NonNegative
from gateway.emulator.scenario import Waypoint
from gateway.schema import build
from gateway.yamlfile import read_value

_PLACE = {"lat_deg", "lon_deg", "speed_m_s"}
_FORMS = (_PLACE | {"height_m"}, _PLACE | {"depth_m"})


class _Dive(Block, frozen=True):
    """A line of a file that tells depths."""

    lat_deg: Latitude
    lon_deg: Longitude
    depth_m: float
    speed_m_s: NonNegative


def read_waypoints(path: Path, surface_height_m: float, faults: list[str]) -> tuple[Waypoint, ...]:
    """Read a file of ``lat_deg``, ``lon_deg``, ``height_m`` or ``depth_m``, and ``speed_m_s``.

    Parameters
    ----------
    surface_height_m
        Of the surface from which depths count.
    faults
        Each fault found is appended, with the file's name and the line.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            rows = [(reader.line_num, row) for row in reader]
            columns = set(reader.fieldnames or ())
    except (OSError, UnicodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else "no comma-separated values"
        faults.append(f"file: {path}: {str(reason).lower()}")
        return ()
    if columns not in _FORMS:
        wanted = "lat_deg, lon_deg, height_m or depth_m, speed_m_s"
        faults.append(f"file: {path}: line 1: expected the columns {wanted}")
        return ()
    points: list[Waypoint] = []
    for line, row in rows:
        cells = {str(k): read_value(v) if isinstance(v, str) else v for k, v in row.items()}
        place = f"file: {path}: line {line}"
        if "height_m" in columns:
            point = build(Waypoint, cells, faults, place)
        else:
            dive = build(_Dive, cells, faults, place)
            point = None if dive is None else _surfaced(dive, surface_height_m)
        points += [] if point is None else [point]
    return tuple(points)


def _surfaced(dive: _Dive, surface_height_m: float) -> Waypoint:
    return Waypoint(
        lat_deg=dive.lat_deg,
        lon_deg=dive.lon_deg,
        height_m=surface_height_m - dive.depth_m,
        speed_m_s=dive.speed_m_s,
    )
