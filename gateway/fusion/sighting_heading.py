"""Heading of a level vehicle that sees a beacon: its azimuth by the map less that by the array."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.axes import about_down
from gateway.fusion.observation import Model
from gateway.fusion.usbl import direction
from gateway.messages import Fix, UsblFix
from gateway.nav.earth import C_en, ecef_to_lla

Array = NDArray[np.float64]


def seen_heading(fix: Fix, model: Model, C_lb: Array, r_e: Array) -> tuple[float, float] | None:
    """Heading of the axis that `C_lb` calls north, by one fix.  # (M.134)

    Parameters
    ----------
    C_lb
        (3, 3) attitude at the fix, level but of no known heading.
    r_e
        (3,) about where the vehicle is, m.

    Returns
    -------
    heading, weight
        rad, and the horizontal distance (m), which a wrong position is to be compared with. None
        for what is no sight of a known beacon, or one that a topside has turned north.
    """
    if not isinstance(fix, UsblFix) or fix.bearing is None or fix.elevation is None:
        return None
    array, beacon = model.arrays.get(fix.device), model.beacons.get(fix.beacon)
    if array is None or beacon is None or fix.axes == "north":
        return None
    C_lu = C_lb @ array.geometry.C_bu
    if fix.axes == "level":
        C_lu = about_down(float(np.arctan2(C_lu[1, 0], C_lu[0, 0])))
    seen = C_lu @ direction(fix.elevation, fix.bearing)
    lat, lon, _ = ecef_to_lla(r_e)
    there = C_en(lat, lon).T @ (beacon.r_e - r_e)
    heading = np.arctan2(there[1], there[0]) - np.arctan2(seen[1], seen[0])
    return float(heading), float(np.hypot(there[0], there[1]))


def agreed(headings: Sequence[tuple[float, float]]) -> float:
    """The one of several weighted headings (rad) that the others are nearest to."""
    angle, weight = np.array(headings).T
    apart = np.abs(np.angle(np.exp(1j * (angle[:, None] - angle))))
    return float(angle[np.argmin(apart @ weight)])
