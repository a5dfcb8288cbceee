"""From the track of a target to the report of where it is, seen from our own place."""

import math
from typing import Literal

from gateway.modes import PLACED
from gateway.nav.earth import north_east
from gateway.outputs.schema import NavReport, TargetReport, error_ellipse, wrap, wrap_180
from gateway.targets import Followed

COASTING = 1.0 / 3.0
"""Share of a target's patience after which it is said that it is not seen."""


def target_report(followed: Followed, nav: NavReport) -> TargetReport:
    """Turn a target into edge units, seen from a solution of the same moment."""
    place, patience_s = followed.place, followed.block.max_age_s
    assert place is not None
    lat_deg, lon_deg = math.degrees(place.lat), wrap_180(math.degrees(place.lon))
    own = math.radians(nav.lat_deg), math.radians(nav.lon_deg)
    north, east = map(float, north_east(place.lat, place.lon, *own))
    sd = [math.sqrt(max(float(place.P[k, k]), 0.0)) for k in range(6)]
    major, minor, orientation = error_ellipse(sd[0], sd[1], float(place.P[0, 1]))
    state: Literal["tracked", "coasting", "lost"] = "tracked"
    if followed.is_lost or nav.mode not in PLACED:  # told from a place that we do not know
        state = "lost"
    elif place.age_s > COASTING * patience_s:
        state = "coasting"
    vn, ve, vd = place.v_n
    return TargetReport(
        utc_ns=nav.utc_ns,
        t_s=nav.t_s,
        number=followed.number,
        name=followed.block.name,
        beacon=followed.beacon,
        state=state,
        age_s=place.age_s,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=place.h,
        vn_m_s=vn,
        ve_m_s=ve,
        vd_m_s=vd,
        sd_n_m=sd[0],
        sd_e_m=sd[1],
        sd_d_m=sd[2],
        sd_vn_m_s=sd[3],
        sd_ve_m_s=sd[4],
        sd_vd_m_s=sd[5],
        ellipse_major_m=major,
        ellipse_minor_m=minor,
        ellipse_deg=orientation,
        bearing_deg=wrap(math.degrees(math.atan2(east, north))),
        range_m=math.hypot(north, east),
    )
