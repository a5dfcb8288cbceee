"""Reports as messages of ROS 2, in its frames: east, north, up; forward, left, up.

Source: REP-103, REP-105. The axes of the map are east, north and up at its origin. Position,
attitude and their sigmas are turned into them over the curvature of the Earth, exactly; velocity is
in the axes of the vehicle.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.config import ZenohRos
from gateway.modes import PLACED, Mode
from gateway.nav.attitude import C_from_euler, euler_error_map
from gateway.nav.earth import C_en, lla_to_ecef
from gateway.outputs.ros.cdr import CdrWriter
from gateway.outputs.schema import NavReport

Array = NDArray[np.float64]

ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""North, east, down to east, north, up, and back."""
FLU_FRD = np.diag([1.0, -1.0, -1.0])
"""Forward, right, down to forward, left, up, and back."""
UNKNOWN_VARIANCE = 1e6
"""Of the rate of turn, (rad/s)^2: the solution holds none."""
NOT_KNOWN = (-1.0, *(0.0,) * 8)
"""Covariance of what a ``sensor_msgs/Imu`` does not hold, by the words of its definition."""
FIX, NO_FIX = 0, -1
"""``sensor_msgs/NavSatStatus``."""
KNOWN_COVARIANCE = 3
OK, WARN, ERROR, STALE = b"\x00\x01\x02\x03"
"""Levels of ``diagnostic_msgs/DiagnosticStatus``."""

_LEVELS = {Mode.AIDED: OK, Mode.DEAD_RECKONING: WARN, Mode.ALIGNING: WARN}


class Mapped:
    """Solutions in a map.

    Parameters
    ----------
    settings
        Origin and names of frames.
    """

    def __init__(self, settings: ZenohRos) -> None:
        self._settings = settings
        origin = settings.origin
        lat, lon = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
        self._r_e = lla_to_ecef(lat, lon, origin.height_m)
        self._C_me = ENU_NED @ C_en(lat, lon).T

    def odometry(self, nav: NavReport) -> bytes | None:
        """``nav_msgs/Odometry``; None where the solution gives no place."""
        if nav.mode not in PLACED:
            return None
        lat, lon = math.radians(nav.lat_deg), math.radians(nav.lon_deg)
        C_mn, C_nb = self._C_me @ C_en(lat, lon), _C_nb(nav)
        position = self._C_me @ (lla_to_ecef(lat, lon, nav.height_m) - self._r_e)
        C_fn = FLU_FRD @ C_nb.T
        pose, twist = np.zeros((6, 6)), np.zeros((6, 6))
        pose[:3, :3] = C_mn @ position_covariance(nav) @ C_mn.T
        pose[3:, 3:] = C_mn @ attitude_covariance(nav) @ C_mn.T
        v_sds = np.array((nav.sd_vn_m_s, nav.sd_ve_m_s, nav.sd_vd_m_s))
        twist[:3, :3] = C_fn @ np.diag(v_sds**2) @ C_fn.T
        twist[3:, 3:] = np.eye(3) * UNKNOWN_VARIANCE
        velocity = C_fn @ (nav.vn_m_s, nav.ve_m_s, nav.vd_m_s)
        message = _header(nav.utc_ns, self._settings.frame).text(self._settings.child_frame)
        message.numbers("d", (*position, *quaternion(C_mn @ C_nb @ FLU_FRD)))
        message.numbers("d", pose.ravel().tolist())
        message.numbers("d", (*velocity, 0.0, 0.0, 0.0))
        return message.numbers("d", twist.ravel().tolist()).finish()

    def nav_sat_fix(self, nav: NavReport) -> bytes:
        """``sensor_msgs/NavSatFix``; without a place its coordinates are NaN."""
        placed = nav.mode in PLACED
        place = (nav.lat_deg, nav.lon_deg, nav.height_m) if placed else (math.nan,) * 3
        covariance = ENU_NED @ position_covariance(nav) @ ENU_NED if placed else np.zeros((3, 3))
        message = _header(nav.utc_ns, self._settings.child_frame)
        message.number("b", FIX if placed else NO_FIX).number("H", 0)
        message.numbers("d", place).numbers("d", covariance.ravel().tolist())
        return message.number("B", KNOWN_COVARIANCE if placed else 0).finish()

    def imu(self, nav: NavReport) -> bytes | None:
        """``sensor_msgs/Imu``: the attitude over east, north, up at the vehicle; no rates."""
        if nav.mode not in PLACED:
            return None
        attitude = ENU_NED @ attitude_covariance(nav) @ ENU_NED
        message = _header(nav.utc_ns, self._settings.child_frame)
        message.numbers("d", quaternion(ENU_NED @ _C_nb(nav) @ FLU_FRD))
        message.numbers("d", attitude.ravel().tolist())
        for _ in ("angular velocity", "linear acceleration"):
            message.numbers("d", (0.0, 0.0, 0.0, *NOT_KNOWN))
        return message.finish()


def diagnostics(status: Any, utc_ns: int) -> bytes:
    """``diagnostic_msgs/DiagnosticArray`` of a `gateway.health.HealthReport`."""
    entries = list(_entries(status))
    message = _header(utc_ns, "").number("I", len(entries))
    for name, level, words, values in entries:
        message.number("B", level).text(f"{status.vehicle}: {name}")
        message.text(words).text(status.vehicle)
        message.number("I", len(values))
        for key, value in values.items():
            message.text(key).text(str(value))
    return message.finish()


def position_covariance(nav: NavReport) -> Array:
    """(3, 3) of north, east, down (m^2); the report holds the horizontal part as an ellipse."""
    difference = nav.ellipse_major_m**2 - nav.ellipse_minor_m**2
    north_east = difference / 2.0 * math.sin(2.0 * math.radians(nav.ellipse_deg))
    covariance = np.diag((nav.sd_n_m**2, nav.sd_e_m**2, nav.sd_d_m**2))
    covariance[0, 1] = covariance[1, 0] = north_east
    return covariance


def attitude_covariance(nav: NavReport) -> Array:
    """(3, 3) of small turns about north, east, down (rad^2)."""
    turned = euler_error_map(math.radians(nav.pitch_deg), math.radians(nav.heading_deg))
    sds = np.radians((nav.sd_roll_deg, nav.sd_pitch_deg, nav.sd_heading_deg))
    covariance: Array = turned @ np.diag(sds**2) @ turned.T
    return covariance


def quaternion(C: Array) -> tuple[float, float, float, float]:
    """x, y, z, w (not negative) of a rotation matrix, by its largest component."""
    squares = np.array((C[0, 0], C[1, 1], C[2, 2])) * 2.0 - np.trace(C) + 1.0
    q = np.empty(4)
    if (largest := int(np.argmax((*squares, np.trace(C) + 1.0)))) == 3:
        q[3] = math.sqrt(np.trace(C) + 1.0) / 2.0
        q[:3] = np.array((C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1])) / (4.0 * q[3])
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i] = math.sqrt(squares[i]) / 2.0
        q[j], q[k] = (C[i, j] + C[j, i]) / (4.0 * q[i]), (C[i, k] + C[k, i]) / (4.0 * q[i])
        q[3] = (C[k, j] - C[j, k]) / (4.0 * q[i])
    x, y, z, w = (q if q[3] >= 0.0 else -q).tolist()
    return x, y, z, w


def _C_nb(nav: NavReport) -> Array:
    angles = (nav.roll_deg, nav.pitch_deg, nav.heading_deg)
    return C_from_euler(*(math.radians(angle) for angle in angles))


def _header(utc_ns: int, frame: str) -> CdrWriter:
    seconds, nanoseconds = divmod(utc_ns, 1_000_000_000)
    return CdrWriter().number("i", seconds).number("I", nanoseconds).text(frame)


def _entries(status: Any) -> Iterator[tuple[str, int, str, dict[str, Any]]]:
    """Name, level, words and values of navigation, filter, each device and each output."""
    used = status.totals.fixes_used if status.totals else 0
    values = {"fix_age_s": status.fix_age_s, "fixes_used": used, "up_s": status.up_s}
    yield "navigation", _LEVELS.get(status.mode, ERROR), status.mode.value, values
    host = status.filter
    values = {"restarts": host.restarts, "waiting": host.waiting, "dropped": host.dropped}
    yield "filter", OK if host.ready else WARN, "ready" if host.ready else "not ready", values
    for name, device in status.devices.items():
        values = {"codec": device.codec, "silent_s": device.silent_s, "records": device.records}
        values |= {"gaps": device.gaps, "rejected": sum(device.rejected.values())}
        if device.silent_s is None:
            yield name, STALE, "not heard yet", values
        elif not device.link.up:
            yield name, ERROR, "line lost", values
        else:
            yield name, OK, "up", values
    for output in status.outputs:
        words = output.error or ("up" if output.up else "down")
        values = {"sent": output.sent, "dropped": output.dropped}
        yield output.name, OK if output.up else WARN, words, values
