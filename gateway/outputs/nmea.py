"""NMEA 0183 sentences of one epoch, claiming no more than the solution's mode allows.

========  ======================================================================================
sentence  fields (unit, format); every one ends in ``*`` checksum CRLF and fits 82 characters
========  ======================================================================================
GGA       UTC, lat, N/S, lon, E/W, quality, 00 satellites, (HDOP), height, M, 0.0, M, , ,
GLL       lat, N/S, lon, E/W, UTC, status, mode
RMC       UTC, status, lat, N/S, lon, E/W, knots, course, ddmmyy, , , mode
VTG       course, T, , M, knots, N, km/h, K, mode
HDT       heading, T
THS       heading, mode
ZDA       UTC, day, month, year, 00, 00
GST       UTC, , major (m), minor (m), orientation, sigma lat, lon, height (m)
GBS       UTC, sigma lat, lon, height (m), , , ,
GSA       A, 3 or 1, twelve times nothing, (PDOP), (HDOP), (VDOP)
DPT       depth (m), 0.0
DBT, DBS  depth (feet), f, depth (m), M, depth (fathoms), F
PUNAV     UTC, state, roll, pitch, heading, depth, sigma horizontal, depth (m), roll, pitch, heading
========  ======================================================================================

Source: NMEA 0183 version 2.3 (the mode letter); what readers in the field do with it stands in
docs/outputs.md.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from drivers.nmea0183 import latitude, longitude, sentence
from gateway.modes import Mode
from gateway.outputs.schema import NavReport

KNOT_M_S = 1852 / 3600
FOOT_M = 0.3048
FATHOM_M = 6 * FOOT_M
COURSE_MIN_M_S = 0.1
"""Below this speed (or below its own sigma) a course over ground means nothing: field empty."""

MINUTE_DECIMALS = 5
"""Of the minutes of latitude and longitude: 1.9 cm."""


@dataclass(frozen=True)
class Claim:
    """How a mode is spelt in the fields of the sentences."""

    quality: str
    """GGA fix quality: 0 none, 1 autonomous, 6 estimated."""
    status: str
    """RMC and GLL: A valid, V warning."""
    mode: str
    """Positioning mode: A autonomous, E estimated, N not valid. Never S: OpenCPN rejects it."""


_NOTHING = Claim("0", "V", "N")
_CLAIMS = {
    Mode.AIDED: Claim("1", "A", "A"),
    Mode.DEAD_RECKONING: Claim("6", "A", "E"),
}
"""Of the modes with a position. Before the first fix it is only what the user has told."""
_STATES = {
    Mode.AIDED: "A",
    Mode.DEAD_RECKONING: "D",
    Mode.ALIGNING: "I",
    Mode.FAULT: "F",
    Mode.INVALID: "N",
}


@dataclass(frozen=True)
class _Epoch:
    """A report with its time rounded once, so that every sentence carries the same instant."""

    time: str
    date: datetime
    claim: Claim
    state: str
    nav: NavReport | None
    surface_height_m: float | None
    range_error_m: float | None


def epoch(
    report: NavReport | None,
    utc_ns: int,
    sentences: Sequence[str],
    talker: str = "GP",
    *,
    surface_height_m: float | None = None,
    range_error_m: float | None = None,
) -> bytes:
    """Write the sentences of one epoch.

    Parameters
    ----------
    report
        The solution to send, or None where there is none (before the first, or gone stale): the
        sentences then say "not valid" with empty fields.
    utc_ns
        Unix time to send where there is no report (ns); a report carries its own.
    sentences
        Names as in the configuration, sent in this order; those of targets are not of this moment.
    talker
        Two letters in front of each standard sentence.
    surface_height_m
        Of the water's surface above the ellipsoid; without it there is no depth to send.
    range_error_m
        What readers multiply a dilution of precision by; without it dilutions are empty fields.
    """
    data = _prepare(report, utc_ns, surface_height_m, range_error_m)
    parts = []
    for name in sentences:
        fields = _WRITERS[name](data) if name in _WRITERS else None
        if fields is not None:
            parts.append(sentence(name if name == "PUNAV" else talker + name, fields))
    return b"".join(parts)


def _prepare(
    report: NavReport | None,
    utc_ns: int,
    surface_height_m: float | None,
    range_error_m: float | None,
) -> _Epoch:
    state = _STATES[report.mode] if report else "N"
    claim, nav = _NOTHING, None
    if report is not None:
        utc_ns = report.utc_ns
        if report.mode in _CLAIMS and math.isfinite(report.lat_deg + report.lon_deg):
            claim, nav = _CLAIMS[report.mode], report
    seconds, hundredths = divmod((utc_ns + 5_000_000) // 10_000_000, 100)
    date = datetime.fromtimestamp(seconds, UTC)
    time = f"{date:%H%M%S}.{hundredths:02d}"
    return _Epoch(time, date, claim, state, nav, surface_height_m, range_error_m)


def _gga(e: _Epoch) -> list[str]:
    nav = e.nav
    height = ["", "", "", ""] if nav is None else [_number(nav.height_m, 2), "M", "0.0", "M"]
    _, hdop, _ = _dilutions(e)
    return [e.time, *_position(nav), e.claim.quality, "00", hdop, *height, "", ""]


def _gll(e: _Epoch) -> list[str]:
    return [*_position(e.nav), e.time, e.claim.status, e.claim.mode]


def _rmc(e: _Epoch) -> list[str]:
    course, speed = _motion(e.nav)
    knots = _number(speed / KNOT_M_S, 2)
    date = f"{e.date:%d%m%y}"
    where = _position(e.nav)
    return [e.time, e.claim.status, *where, knots, course, date, "", "", e.claim.mode]


def _vtg(e: _Epoch) -> list[str]:
    course, speed = _motion(e.nav)
    knots, km_h = _number(speed / KNOT_M_S, 2), _number(speed * 3.6, 2)
    return [course, "T", "", "M", knots, "N", km_h, "K", e.claim.mode]


def _hdt(e: _Epoch) -> list[str] | None:
    """Nothing at all without a heading: HDT has no field that could say "not valid"."""
    return None if e.nav is None else [_heading(e.nav.heading_deg), "T"]


def _ths(e: _Epoch) -> list[str]:
    return ["", "V"] if e.nav is None else [_heading(e.nav.heading_deg), e.claim.mode]


def _zda(e: _Epoch) -> list[str]:
    return [e.time, f"{e.date:%d}", f"{e.date:%m}", f"{e.date:%Y}", "00", "00"]


def _gst(e: _Epoch) -> list[str]:
    nav = e.nav
    if nav is None:
        return [e.time, *[""] * 7]
    axes = [_sigma(nav.ellipse_major_m), _sigma(nav.ellipse_minor_m)]
    orientation = _number(round(nav.ellipse_deg, 1) % 180.0, 1)
    sigmas = (nav.sd_n_m, nav.sd_e_m, nav.sd_d_m)
    return [e.time, "", *axes, orientation, *map(_sigma, sigmas)]


def _gbs(e: _Epoch) -> list[str]:
    nav = e.nav
    sigmas = ["", "", ""] if nav is None else map(_sigma, (nav.sd_n_m, nav.sd_e_m, nav.sd_d_m))
    return [e.time, *sigmas, *[""] * 4]


def _gsa(e: _Epoch) -> list[str]:
    return ["A", "1" if e.nav is None else "3", *[""] * 12, *_dilutions(e)]


def _dilutions(e: _Epoch) -> tuple[str, str, str]:
    """PDOP, HDOP and VDOP as the sigmas they stand for would have made them."""
    if e.nav is None or e.range_error_m is None:
        return "", "", ""
    across, down = math.hypot(e.nav.sd_n_m, e.nav.sd_e_m), e.nav.sd_d_m
    whole = math.hypot(across, down)
    pdop, hdop, vdop = (_sigma(sigma / e.range_error_m) for sigma in (whole, across, down))
    return pdop, hdop, vdop


def _dpt(e: _Epoch) -> list[str] | None:
    depth = _depth_m(e)
    return None if depth is None else [_number(depth, 2), "0.0"]


def _dbt(e: _Epoch) -> list[str] | None:
    depth = _depth_m(e)
    if depth is None:
        return None
    feet, fathoms = _number(depth / FOOT_M, 1), _number(depth / FATHOM_M, 1)
    return [feet, "f", _number(depth, 2), "M", fathoms, "F"]


def _depth_m(e: _Epoch) -> float | None:
    """Depth of the vehicle; on a wave's crest, above the mean surface, it is 0."""
    if e.nav is None or e.surface_height_m is None:
        return None
    return max(e.surface_height_m - e.nav.height_m, 0.0)


def _punav(e: _Epoch) -> list[str]:
    nav = e.nav
    if nav is None:
        return [e.time, e.state, *[""] * 9]
    attitude = [_number(nav.roll_deg, 2), _number(nav.pitch_deg, 2), _heading(nav.heading_deg)]
    horizontal = math.hypot(nav.sd_n_m, nav.sd_e_m)
    sigmas = (horizontal, nav.sd_d_m, nav.sd_roll_deg, nav.sd_pitch_deg, nav.sd_heading_deg)
    return [e.time, e.state, *attitude, _fit(-nav.height_m, 6, 2), *map(_sigma, sigmas)]


_WRITERS: dict[str, Callable[[_Epoch], list[str] | None]] = {
    "GGA": _gga,
    "GLL": _gll,
    "RMC": _rmc,
    "VTG": _vtg,
    "HDT": _hdt,
    "THS": _ths,
    "ZDA": _zda,
    "GST": _gst,
    "GBS": _gbs,
    "GSA": _gsa,
    "DPT": _dpt,
    "DBT": _dbt,
    "DBS": _dbt,
    "PUNAV": _punav,
}


def _position(nav: NavReport | None) -> list[str]:
    """Latitude, N/S, longitude, E/W; empty without a fix, for some readers plot what they find."""
    if nav is None:
        return ["", "", "", ""]
    return [*latitude(nav.lat_deg, MINUTE_DECIMALS), *longitude(nav.lon_deg, MINUTE_DECIMALS)]


def _motion(nav: NavReport | None) -> tuple[str, float]:
    """Course over ground as written, and speed over ground (m/s, nan without a fix)."""
    if nav is None:
        return "", math.nan
    speed = math.hypot(nav.vn_m_s, nav.ve_m_s)
    if not speed > max(COURSE_MIN_M_S, math.hypot(nav.sd_vn_m_s, nav.sd_ve_m_s)):
        return "", speed
    return _heading(math.degrees(math.atan2(nav.ve_m_s, nav.vn_m_s))), speed


def _heading(degrees: float) -> str:
    """[0, 360) with two decimals: what rounds to 360 is 0."""
    return _number(round(degrees % 360.0, 2) % 360.0, 2)


def _number(value: float, decimals: int) -> str:
    """Fixed decimals, never a negative zero; what is not finite is an empty field."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else ""


def _fit(value: float, width: int, decimals: int) -> str:
    """As many decimals, up to ``decimals``, as the width allows: a sentence has 82 characters."""
    texts = (_number(value, d) for d in range(decimals, -1, -1))
    return next((text for text in texts if len(text) <= width), "9" * width)


def _sigma(value: float) -> str:
    return _fit(value, 5, 3)
