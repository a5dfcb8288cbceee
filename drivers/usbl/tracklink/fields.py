"""Fields the TrackLink outputs share: targets, angles, clocks, axes and their agreement.

None of the outputs has a checksum, so a number is taken only if it looks exactly like one and lies
where the instrument could have put it.
"""

import re
from math import asin, atan2, degrees, dist, hypot
from typing import Literal

import msgspec

from drivers.framing import UnreadableError
from drivers.records import Vec3

Reference = Literal["bow", "north"]

_TARGET = re.compile(r"\d{1,3}")


class PositionOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the topside program was set up, and how far bearing and range may disagree with XYZ.

    The tolerances come on top of what rounding of the printed coordinates explains.
    """

    axes: Literal["starboard_forward_down", "forward_starboard_down"] = "starboard_forward_down"
    bearing_reference: Reference = "bow"
    bearing_tolerance_deg: float = 0.5
    range_tolerance_m: float = 0.5

    def swap(self, xyz: Vec3) -> Vec3:
        """Turn the sentence's XYZ into forward, starboard, down, or the other way round."""
        x, y, z = xyz
        return (y, x, z) if self.axes == "starboard_forward_down" else xyz


def target(text: str) -> str:
    """Read a target number, without leading zeros."""
    if not _TARGET.fullmatch(text):
        raise UnreadableError("syntax", f'"{text}" is no target number')
    return str(int(text))


def hms(t_s: float | None) -> tuple[int, int, int]:
    """Hours, minutes and seconds of a second of the day."""
    whole = round(t_s or 0.0) % 86400
    return whole // 3600, whole // 60 % 60, whole % 60


def signed(bearing_deg: float) -> float:
    """Bearing 0 to 360 degrees as -180 (excluded) to 180."""
    # Rounded to undo the binary noise of the subtraction: 359.9 becomes -0.1.
    return bearing_deg if bearing_deg <= 180 else round(bearing_deg - 360, 9)


def unsigned(bearing_deg: float | None) -> float:
    """Bearing in steps of 0.1 degrees from 0.0 to 359.9, as the fields hold it."""
    return round(bearing_deg or 0.0, 1) % 360


def elevation(xyz_m: Vec3) -> float:
    """Elevation (deg, positive up) of a point in forward, starboard, down."""
    x, y, z = xyz_m
    return degrees(atan2(-z, hypot(x, y)))


def step(*texts: str) -> float:
    """Coarsest resolution among printed numbers: ``("12", "3.4")`` -> 1."""
    return max(10.0 ** -len(text.partition(".")[2]) for text in texts)


def agree(
    bearing_deg: float, slant_m: float, xyz_m: Vec3, resolution_m: float, options: PositionOptions
) -> bool:
    """Tell whether bearing and slant range are those of XYZ (forward, starboard, down).

    Each coordinate may be off by half its resolution: in the plane that is 0.71 steps, which turns
    the bearing by asin(0.71 steps / horizontal distance), in space 0.87 steps.
    """
    x, y, _ = xyz_m
    error_m, horizontal_m = resolution_m * 0.5**0.5, hypot(x, y)
    allowed = degrees(asin(error_m / horizontal_m)) if error_m < horizontal_m else 180.0
    turn = abs((bearing_deg - degrees(atan2(y, x)) + 180) % 360 - 180)
    stretch = abs(slant_m - dist(xyz_m, (0.0, 0.0, 0.0)))
    return (
        turn <= options.bearing_tolerance_deg + allowed
        and stretch <= options.range_tolerance_m + resolution_m * 0.75**0.5
    )


def no_range(slant_m: float) -> str | None:
    """Name the fault of a slant range of zero: nothing was measured."""
    return None if slant_m > 0 else "no_range"


def fitted(value: float, width: int, decimals: int, what: str) -> str:
    """Write a number right-aligned in its columns.

    Raises
    ------
    ValueError
        If it does not fit.
    """
    text = f"{value:{width}.{decimals}f}"
    if len(text) > width:
        raise ValueError(f"{what} {value} does not fit its {width} columns")
    return text


def fixed_starts(width: int, line: bytes) -> tuple[int, ...]:
    """Where a line of fixed width may begin: its width before the end, else at the front.

    A digit glued to the front by a cut line before it would otherwise make another target number.
    """
    return (len(line) - width, 0) if len(line) > width else (0,)
