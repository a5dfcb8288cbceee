"""The one conversion from the filter's messages to the edge: degrees, signed longitude, Unix UTC.

Field names carry their unit and are the column names of ``nav.csv`` and the keys of the JSON on
Zenoh (docs/outputs.md). Monotonic time becomes wall time here and nowhere else, with an offset that
the caller measured once for the whole message, so that two outputs never disagree about an epoch.
"""

import math
from typing import Literal

import msgspec

from gateway.messages import Calibration, Innovation, NavSolution
from gateway.modes import Mode

_UNITS = {
    "_deg_h": "deg/h",
    "_deg": "deg",
    "_ug": "ug",
    "_m_s": "m/s",
    "_ms": "ms",
    "_m": "m",
}


class NavReport(msgspec.Struct, frozen=True):
    """The fused solution of one epoch.

    ``utc_ns`` is the exact time of validity; ``t_s`` the same in seconds, for readers whose numbers
    are doubles. ``sd_*`` are 1 sigma; the ellipse is the 1-sigma (39 %) one of the horizontal
    position, its major axis ``ellipse_deg`` clockwise from north in [0, 180).
    """

    utc_ns: int
    t_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    vn_m_s: float
    ve_m_s: float
    vd_m_s: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    sd_n_m: float
    sd_e_m: float
    sd_d_m: float
    sd_vn_m_s: float
    sd_ve_m_s: float
    sd_vd_m_s: float
    sd_roll_deg: float
    sd_pitch_deg: float
    sd_heading_deg: float
    mode: Mode
    fix_age_s: float | None
    fixes_used: int
    fixes_rejected: int
    ellipse_major_m: float
    ellipse_minor_m: float
    ellipse_deg: float


class ComponentReport(msgspec.Struct, frozen=True):
    """One component of an innovation, measured minus predicted; the unit ends its name."""

    name: str
    value: float
    sigma: float


class InnovationReport(msgspec.Struct, frozen=True):
    """What the filter made of one fix; ``reason`` is empty for a used one.

    A fix that was refused before it could be compared has no components and no ``nis``.
    """

    utc_ns: int
    t_s: float
    device: str
    beacon: str
    components: tuple[ComponentReport, ...]
    nis: float | None
    accepted: bool
    reason: str


class ConstantReport(msgspec.Struct, frozen=True):
    """Estimate and 1 sigma of one constant."""

    value: float
    sigma: float


class CalibrationReport(msgspec.Struct, frozen=True):
    """The estimated constants by name; the unit ends each name."""

    utc_ns: int
    t_s: float
    constants: dict[str, ConstantReport]


class TargetReport(msgspec.Struct, frozen=True):
    """Where something is that the array follows, and how it lies from us.

    ``state`` is ``coasting`` once a third of the patience is over without a fix, and ``lost`` after
    all of it: the place is then no more than where it would be if nothing had changed. It is
    ``lost`` too while we claim no place of our own, from which its place is told.
    ``bearing_deg`` is from true north, ``range_m`` horizontal, both from our own place.
    """

    utc_ns: int
    t_s: float
    number: int
    name: str
    beacon: str
    state: Literal["tracked", "coasting", "lost"]
    age_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    vn_m_s: float
    ve_m_s: float
    vd_m_s: float
    sd_n_m: float
    sd_e_m: float
    sd_d_m: float
    sd_vn_m_s: float
    sd_ve_m_s: float
    sd_vd_m_s: float
    ellipse_major_m: float
    ellipse_minor_m: float
    ellipse_deg: float
    bearing_deg: float
    range_m: float


def nav_report(solution: NavSolution, utc_minus_monotonic_ns: int) -> NavReport:
    """Turn a solution into edge units.

    Parameters
    ----------
    solution
        From the filter: radians, monotonic time of validity.
    utc_minus_monotonic_ns
        Unix time minus host monotonic time (ns).
    """
    utc_ns = solution.t_ns + utc_minus_monotonic_ns
    sd_n, sd_e, sd_d = solution.sd_position
    vn, ve, vd = solution.v_eb_n
    sd_vn, sd_ve, sd_vd = solution.sd_velocity
    sd_roll, sd_pitch, sd_heading = map(math.degrees, solution.sd_attitude)
    major, minor, orientation = error_ellipse(sd_n, sd_e, solution.cov_ne)
    return NavReport(
        utc_ns=utc_ns,
        t_s=utc_ns / 1e9,
        lat_deg=math.degrees(solution.lat),
        lon_deg=wrap_180(math.degrees(solution.lon)),
        height_m=solution.h,
        vn_m_s=vn,
        ve_m_s=ve,
        vd_m_s=vd,
        roll_deg=math.degrees(solution.roll),
        pitch_deg=math.degrees(solution.pitch),
        heading_deg=wrap(math.degrees(solution.heading)),
        sd_n_m=sd_n,
        sd_e_m=sd_e,
        sd_d_m=sd_d,
        sd_vn_m_s=sd_vn,
        sd_ve_m_s=sd_ve,
        sd_vd_m_s=sd_vd,
        sd_roll_deg=sd_roll,
        sd_pitch_deg=sd_pitch,
        sd_heading_deg=sd_heading,
        mode=solution.mode,
        fix_age_s=solution.fix_age_s,
        fixes_used=solution.fixes_used,
        fixes_rejected=solution.fixes_rejected,
        ellipse_major_m=major,
        ellipse_minor_m=minor,
        ellipse_deg=orientation,
    )


def innovation_report(innovation: Innovation, utc_minus_monotonic_ns: int) -> InnovationReport:
    """Give an innovation, whose components the filter already names and scales for the edge."""
    utc_ns = innovation.t_ns + utc_minus_monotonic_ns
    return InnovationReport(
        utc_ns=utc_ns,
        t_s=utc_ns / 1e9,
        device=innovation.device,
        beacon=innovation.beacon,
        components=tuple(ComponentReport(c.name, c.value, c.sigma) for c in innovation.components),
        nis=innovation.nis if math.isfinite(innovation.nis) else None,
        accepted=innovation.accepted,
        reason=innovation.reason,
    )


def calibration_report(calibration: Calibration, utc_minus_monotonic_ns: int) -> CalibrationReport:
    """Give the estimated constants, which the filter already names and scales for the edge."""
    utc_ns = calibration.t_ns + utc_minus_monotonic_ns
    constants = {c.name: ConstantReport(c.value, c.sigma) for c in calibration.constants}
    return CalibrationReport(utc_ns=utc_ns, t_s=utc_ns / 1e9, constants=constants)


def error_ellipse(sd_north: float, sd_east: float, cov_ne: float) -> tuple[float, float, float]:
    """1-sigma ellipse of the horizontal position from its 2x2 covariance.

    Returns
    -------
    major, minor
        Semi-axes (m): the roots of the eigenvalues, a rounding-negative one taken as 0.
    orientation
        Of the major axis, degrees clockwise from north, in [0, 180).
    """
    var_n, var_e = sd_north**2, sd_east**2
    mean = (var_n + var_e) / 2
    radius = math.hypot((var_n - var_e) / 2, cov_ne)
    azimuth = math.degrees(math.atan2(2 * cov_ne, var_n - var_e) / 2)
    return math.sqrt(mean + radius), math.sqrt(max(mean - radius, 0.0)), wrap(azimuth, 180.0)


def wrap(angle_deg: float, period: float = 360.0) -> float:
    """Wrap an angle into [0, period) degrees; a tiny negative one becomes 0."""
    wrapped = angle_deg % period
    return wrapped if wrapped < period else 0.0


def wrap_180(angle_deg: float) -> float:
    """Wrap an angle into [-180, 180) degrees; one already there keeps its last bit."""
    return angle_deg if -180.0 <= angle_deg < 180.0 else wrap(angle_deg + 180.0) - 180.0


def titled(name: str) -> str:
    """``gyro_bias_x_deg_h`` -> ``gyro bias x (deg/h)``."""
    for ending, unit in _UNITS.items():
        if name.endswith(ending):
            return f"{name.removesuffix(ending).replace('_', ' ')} ({unit})"
    return name.replace("_", " ")
