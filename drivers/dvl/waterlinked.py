"""Water Linked DVL A50 and A125: reports as JSON, one a line, over TCP (port 16171).

=================== ==============================================================================
velocity report     ``type`` velocity, or velocity_water of a layer of water
=================== ==============================================================================
vx, vy, vz          m/s forward, starboard, down in the log's axes (turned by its own mounting
                    rotation offset, if one is set)
covariance          3 x 3, (m/s)^2
altitude            along z, m; -1 or 0 without a bottom
velocity_valid      whether it has a lock on the bottom
fom, time, status   figure of merit m/s, ms since the last report, bit 0 too hot
time_of_validity    Unix us of the reflection, by the log's clock
time_of_transmission  Unix us of the sending: with it the report tells its own age
=================== ==============================================================================

Its velocities assume the speed of sound it was told. Other reports (``position_local``) and answers
to commands come out as other frames.
"""

import re
from collections.abc import Iterator
from math import isfinite, sqrt

import msgspec
from msgspec import UNSET

from drivers.codec import Codec, Decoder, NoOptions
from drivers.framing import LineDecoder, UnreadableError, other_line
from drivers.records import DvlRecord, Record, Vec3

LONGEST = 2048
"""Bytes of a report with its four transducers: 1100 to 1300."""
AGE_MAX_S = 10.0
"""A report that is older than this by its own clock has one that was set in between."""
SPEED_MAX = 100.0
MICRO = 1e-6

_START = re.compile(rb'\{"')


class _Report(msgspec.Struct, forbid_unknown_fields=False):
    """A report, as far as it is read."""

    type: str
    vx: float | None = None
    vy: float | None = None
    vz: float | None = None
    covariance: tuple[Vec3, Vec3, Vec3] | None = None
    altitude: float | None = None
    velocity_valid: bool = False
    tracking_mode: str = "bottom"
    status: int = 0
    time_of_validity: int | None = None
    time_of_transmission: int | None = None


_JSON = msgspec.json.Decoder(_Report)


def decoder(_options: NoOptions) -> Decoder:
    """Make a decoder of a log's reports."""
    return LineDecoder(_decode, _starts, longest=LONGEST)


def encode(record: Record, _options: NoOptions) -> bytes:
    """Write a `DvlRecord` as a velocity report, its transducers left out."""
    if not isinstance(record, DvlRecord) or record.axes != "sensor":
        raise ValueError(f"waterlinked-dvl cannot say this {type(record).__name__}")
    water = record.water_velocity_m_s is not UNSET
    said = record.water_velocity_m_s or record.velocity_m_s or (0.0, 0.0, 0.0)
    variances = (0.0,) * 3 if record.sd_m_s is UNSET else [sd * sd for sd in record.sd_m_s]
    report = {
        "time": 0.0,
        **dict(zip(("vx", "vy", "vz"), said, strict=True)),
        "fom": sqrt(max(variances)),
        "covariance": [[v if i == k else 0.0 for k in range(3)] for i, v in enumerate(variances)],
        "altitude": -1.0 if record.altitude_m is None else record.altitude_m,
        "velocity_valid": record.velocity_m_s is not None or water,
        "status": 0,
        "format": "json_v3.2",
        "type": "velocity_water" if water else "velocity",
        **_time_fields(record),
    }
    return msgspec.json.encode(report) + b"\r\n"


def _decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
    try:
        report = _JSON.decode(line)
    except (msgspec.DecodeError, UnicodeError) as error:
        raise UnreadableError("syntax", "not a report") from error
    if report.type not in ("velocity", "velocity_water"):
        return other_line(report.type, line, t_rx_ns, line_bytes)
    velocity = _velocity(report)
    water = report.type == "velocity_water" or report.tracking_mode == "water"
    age_s, validity_us = _age_s(report), report.time_of_validity
    return DvlRecord(
        t_rx_ns=t_rx_ns,
        line_bytes=line_bytes,
        age_s=UNSET if age_s is None else age_s,
        velocity_m_s=None if water else velocity,
        t_device_s=None if validity_us is None else validity_us * MICRO,
        valid=velocity is not None and not water,
        error_code=_error(velocity, water),
        altitude_m=_altitude(report),
        sd_m_s=_sd(report),
        water_velocity_m_s=velocity if water and velocity else UNSET,
    )


def _velocity(report: _Report) -> Vec3 | None:
    vx, vy, vz = report.vx, report.vy, report.vz
    if vx is None or vy is None or vz is None:
        raise UnreadableError("syntax", "a velocity report without velocities")
    if not max(abs(vx), abs(vy), abs(vz)) <= SPEED_MAX:
        raise UnreadableError("range", f"{vx}, {vy}, {vz} m/s")
    return (vx, vy, vz) if report.velocity_valid else None


def _error(velocity: Vec3 | None, water: bool) -> str | None:
    if velocity is None:
        return "no_lock"
    return "water" if water else None


def _altitude(report: _Report) -> float | None:
    altitude_m = report.altitude
    if altitude_m is None or not 0.0 < altitude_m < 1e5 or not report.velocity_valid:
        return None
    return altitude_m


def _sd(report: _Report) -> Vec3 | msgspec.UnsetType:
    if report.covariance is None or not report.velocity_valid:
        return UNSET
    x, y, z = (report.covariance[k][k] for k in range(3))
    if not (min(x, y, z) >= 0.0 and isfinite(x + y + z)):
        raise UnreadableError("range", f"variances {x}, {y}, {z}")
    return sqrt(x), sqrt(y), sqrt(z)


def _age_s(report: _Report) -> float | None:
    if report.time_of_validity is None or report.time_of_transmission is None:
        return None
    age_s = (report.time_of_transmission - report.time_of_validity) * MICRO
    return age_s if 0.0 <= age_s < AGE_MAX_S else None


def _time_fields(record: DvlRecord) -> dict[str, int]:
    if record.t_device_s is None:
        return {}
    validity_us = round(record.t_device_s / MICRO)
    fields = {"time_of_validity": validity_us}
    if record.age_s is not UNSET:
        fields["time_of_transmission"] = validity_us + round(record.age_s / MICRO)
    return fields


def _starts(line: bytes) -> Iterator[int]:
    """A report holds objects itself, but only from the first on is it whole."""
    return (match.start() for match in _START.finditer(line))


WATERLINKED = Codec(
    name="waterlinked-dvl",
    kind="dvl",
    devices="Water Linked DVL A50 and A125, JSON reports over TCP (json_v3)",
    options=NoOptions,
    decoder=decoder,
    encode=encode,
)
