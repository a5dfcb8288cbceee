"""The track and the error ellipse drawn with the dots of Braille characters, north up."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from gateway.nav.earth import north_east
from gateway.outputs.schema import NavReport, TargetReport

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_BLANK = 0x2800
_ELLIPSE_POINTS = 120
NICE = (1.0, 2.0, 5.0)

Point = tuple[float, float]


def draw(
    track: Sequence[NavReport],
    width: int,
    height: int,
    targets: Iterable[TargetReport] = (),
) -> list[str]:
    """Draw the track with the newest solution's 1-sigma ellipse; the last line is the scale.

    A target is the first letter of its name, the vehicle a cross.

    Parameters
    ----------
    track
        Solutions, oldest first; at least one.
    width, height
        Characters.
    targets
        Where they were last; one that is lost is not drawn.
    """
    here = track[-1]
    ellipse = list(_ellipse(here))
    marks = [(target.name[:1], _seen(target)) for target in targets if target.state != "lost"]
    points = _way(track, here) + ellipse
    canvas = _Canvas(width, height - 1, points + [point for _, point in marks])
    for point in points[: len(track)]:
        canvas.dot(point)
    for point in ellipse:
        canvas.dot(point)
    lines = canvas.lines()
    for mark, point in (*marks, ("+", (0.0, 0.0))):
        column, row = canvas.cell(point)
        lines[row] = lines[row][:column] + mark + lines[row][column + 1 :]
    return [*lines, canvas.scale()]


class _Canvas:
    """Dots, two by four in a character; metres east and north of the newest place."""

    def __init__(self, width: int, height: int, points: Sequence[Point]) -> None:
        self._cells = [[0] * width for _ in range(height)]
        self._columns, self._rows = 2 * width, 4 * height
        east, north = zip(*points, strict=True)
        self._middle = (max(east) + min(east)) / 2, (max(north) + min(north)) / 2
        spans = (max(east) - min(east)) / self._columns, (max(north) - min(north)) / self._rows
        self._metres = max(*spans, 1e-3) * 1.08

    def dot(self, point: Point) -> None:
        """Set the dot at a point."""
        x, y = self._place(point)
        self._cells[y // 4][x // 2] |= _DOTS[y % 4][x % 2]

    def cell(self, point: Point) -> tuple[int, int]:
        """Column and row of the character at a point."""
        x, y = self._place(point)
        return x // 2, y // 4

    def lines(self) -> list[str]:
        """The picture."""
        return ["".join(chr(_BLANK + dots) for dots in row) for row in self._cells]

    def scale(self) -> str:
        """A bar of a round length."""
        longest = self._metres * self._columns * 0.5
        power = 10.0 ** math.floor(math.log10(longest))
        length = max(n * power for n in NICE if n * power <= longest)
        bar = max(round(length / self._metres / 2) - 2, 0)
        return f"├{'─' * bar}┤ {length:g} m, north up"

    def _place(self, point: Point) -> tuple[int, int]:
        x = self._columns / 2 + (point[0] - self._middle[0]) / self._metres
        y = self._rows / 2 - (point[1] - self._middle[1]) / self._metres
        return min(max(int(x), 0), self._columns - 1), min(max(int(y), 0), self._rows - 1)


def _way(track: Sequence[NavReport], here: NavReport) -> list[Point]:
    """Metres east and north of a place."""
    lat, lon = np.radians([(nav.lat_deg, nav.lon_deg) for nav in track]).T
    north, east = north_east(lat, lon, math.radians(here.lat_deg), math.radians(here.lon_deg))
    return list(zip(east.tolist(), north.tolist(), strict=True))


def _seen(target: TargetReport) -> Point:
    """Metres east and north of the vehicle."""
    bearing = math.radians(target.bearing_deg)
    return target.range_m * math.sin(bearing), target.range_m * math.cos(bearing)


def _ellipse(nav: NavReport) -> Iterable[Point]:
    """The 1-sigma ellipse about the newest place."""
    major, minor = nav.ellipse_major_m, nav.ellipse_minor_m
    if not (math.isfinite(major) and math.isfinite(minor)):
        return
    axis = math.radians(nav.ellipse_deg)
    for k in range(_ELLIPSE_POINTS):
        along = major * math.cos(2.0 * math.pi * k / _ELLIPSE_POINTS)
        across = minor * math.sin(2.0 * math.pi * k / _ELLIPSE_POINTS)
        yield (
            along * math.sin(axis) + across * math.cos(axis),
            along * math.cos(axis) - across * math.sin(axis),
        )
