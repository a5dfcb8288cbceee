"""NMEA 0183 sentences of what is followed: its place (TLL), and how it lies and moves (TTM).

========  ======================================================================================
sentence  fields (unit, format)
========  ======================================================================================
TLL       number, lat, N/S, lon, E/W, name, UTC, status, (reference empty)
TTM       number, range, bearing, T, knots, course, T, CPA, TCPA (min), N, name, status, , UTC, A
========  ======================================================================================

Range and CPA (closest point of approach) are in nautical miles. Status T is tracking, L lost.
"""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from drivers.nmea0183 import latitude, longitude, sentence
from gateway.modes import Mode
from gateway.outputs.nmea import KNOT_M_S, MINUTE_DECIMALS
from gateway.outputs.schema import NavReport, TargetReport

NAUTICAL_MILE_M = 1852.0
NAME_LENGTH = 10
"""Of a name as it is sent: a sentence has 82 characters."""
STILL_M_S = 0.01
"""Who moves slower against each other comes no nearer."""


def write(report: TargetReport, own: NavReport, sentences: Sequence[str], talker: str) -> bytes:
    """Write those of the sentences that are of targets.

    Parameters
    ----------
    own
        The solution of the same moment.
    """
    writers = {"TLL": _tll(report), "TTM": _ttm(report, own)}
    return b"".join(sentence(talker + name, writers[name]) for name in sentences if name in writers)


def as_vessel(report: TargetReport, own: NavReport) -> NavReport | None:
    """The target as if it were the vessel; None where it is lost. Its attitude is not known.

    It claims no more than our `own` solution, from which it is told.
    """
    if report.state == "lost":
        return None
    is_sure = report.state == "tracked" and own.mode is Mode.AIDED
    mode = Mode.AIDED if is_sure else Mode.DEAD_RECKONING
    fields: dict[str, Any] = {name: getattr(report, name) for name in _SHARED}
    fields |= dict.fromkeys(_ATTITUDE, math.nan)
    return NavReport(**fields, mode=mode, fix_age_s=report.age_s, fixes_used=0, fixes_rejected=0)


_ATTITUDE = (
    *("roll_deg", "pitch_deg", "heading_deg"),
    *("sd_roll_deg", "sd_pitch_deg", "sd_heading_deg"),
)
_SHARED = tuple(
    name for name in NavReport.__struct_fields__ if name in TargetReport.__struct_fields__
)


def _tll(report: TargetReport) -> list[str]:
    place = latitude(report.lat_deg, MINUTE_DECIMALS - 1) + longitude(
        report.lon_deg, MINUTE_DECIMALS - 1
    )
    return [f"{report.number:02d}", *place, _name(report), _time(report), _status(report), ""]


def _ttm(report: TargetReport, own: NavReport) -> list[str]:
    speed = math.hypot(report.vn_m_s, report.ve_m_s)
    course = math.degrees(math.atan2(report.ve_m_s, report.vn_m_s)) % 360.0
    cpa_m, tcpa_s = _approach(report, own)
    return [
        f"{report.number:02d}",
        f"{report.range_m / NAUTICAL_MILE_M:.3f}",
        *(f"{report.bearing_deg % 360.0:.1f}", "T"),
        f"{speed / KNOT_M_S:.1f}",
        *(f"{course:.1f}", "T"),
        f"{cpa_m / NAUTICAL_MILE_M:.3f}",
        f"{max(min(tcpa_s / 60.0, 99.9), -99.9):.1f}",
        *("N", _name(report), _status(report), "", _time(report), "A"),
    ]


def _approach(report: TargetReport, own: NavReport) -> tuple[float, float]:
    """Least distance (m) and when it is (s from now; it may be over), both going on as they do."""
    bearing = math.radians(report.bearing_deg)
    n, e = report.range_m * math.cos(bearing), report.range_m * math.sin(bearing)
    vn, ve = report.vn_m_s - own.vn_m_s, report.ve_m_s - own.ve_m_s
    speed2 = vn * vn + ve * ve
    if speed2 < STILL_M_S**2:
        return report.range_m, 0.0
    t_s = -(n * vn + e * ve) / speed2
    return math.hypot(n + t_s * vn, e + t_s * ve), t_s


def _name(report: TargetReport) -> str:
    return report.name[:NAME_LENGTH]


def _status(report: TargetReport) -> str:
    return "L" if report.state == "lost" else "T"


def _time(report: TargetReport) -> str:
    seconds, hundredths = divmod((report.utc_ns + 5_000_000) // 10_000_000, 100)
    return f"{datetime.fromtimestamp(seconds, UTC):%H%M%S}.{hundredths:02d}"
