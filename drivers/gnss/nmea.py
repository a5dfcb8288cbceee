"""GNSS receivers by NMEA 0183: position with GGA, velocity with RMC, any talker.

``$--GGA,hhmmss.ss,ddmm.mm,N,dddmm.mm,E,q,nn,h.h,altitude,M,geoid,M,age,station*hh``
    UTC, latitude, longitude, quality (0 none, 1 to 5 a fix, 6 estimated, 7 manual, 8 simulated),
    satellites, HDOP, altitude above the geoid, and the geoid above the ellipsoid: their sum is the
    height. ``age`` and ``station`` of the corrections are not read.
``$--RMC,hhmmss.ss,A,ddmm.mm,N,dddmm.mm,E,knots,course,ddmmyy,variation,E,mode,safety*hh``
    UTC, status (A or V), latitude, longitude, speed and true course over ground. ``mode`` came with
    version 2.3 (A, D, F, R and P are fixes; E estimated, M manual, S simulated, N none), ``safety``
    with 4.1 and is not read, like date and magnetic variation.

Every other sentence comes out as it is.
"""

import msgspec

from drivers.codec import Codec, Decoder
from drivers.fields import number, seconds_of_day
from drivers.framing import LineDecoder, UnreadableError
from drivers.nmea0183 import (
    Checksum,
    degrees,
    last_start,
    latitude,
    longitude,
    parse,
    sentence,
)
from drivers.records import GnssRecord, NmeaSentence, Record

KNOT_M_S = 1852 / 3600
FIXES = range(1, 6)
"""Qualities of GGA that the receiver measured."""
MODES = "ADFRP"
"""Modes of RMC that the receiver measured."""

_NOWHERE = ("", "", "", "")


class GnssOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether sentences carry a checksum, and the geoid where the receiver does not say it.

    ``geoid_m`` is the height of the geoid above the ellipsoid (m): without either there is no
    ellipsoidal height, for the two differ by up to 100 m.
    """

    checksum: Checksum = "required"
    geoid_m: float | None = None


def decoder(options: GnssOptions) -> Decoder:
    """Make a decoder of a receiver's sentences."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        talker, formatter, fields = parse(line, options.checksum)
        if talker == "P" or formatter not in ("GGA", "RMC"):
            return NmeaSentence(
                t_rx_ns=t_rx_ns,
                line_bytes=line_bytes,
                talker=talker,
                formatter=formatter,
                fields=fields,
            )
        record = _gga(fields, options) if formatter == "GGA" else _rmc(fields)
        return msgspec.structs.replace(record, t_rx_ns=t_rx_ns, line_bytes=line_bytes)

    return LineDecoder(decode, last_start)


def encode(record: Record, options: GnssOptions) -> bytes:
    """Write a `GnssRecord` as the sentence it names, with its checksum unless forbidden."""
    if not isinstance(record, GnssRecord):
        raise ValueError(f"nmea-gnss cannot say a {type(record).__name__}")
    fields = _gga_fields(record) if record.sentence == "GGA" else _rmc_fields(record)
    line = sentence(f"GP{record.sentence}", fields)
    return line[: line.index(b"*")] + b"\r\n" if options.checksum == "forbidden" else line


def _gga(fields: tuple[str, ...], options: GnssOptions) -> GnssRecord:
    if len(fields) != 14:
        raise UnreadableError("syntax", "a GGA sentence has 14 fields")
    clock, *place, quality, satellites, hdop, altitude, unit, geoid, geoid_unit, _, _ = fields
    if len(quality) != 1:
        raise UnreadableError("syntax", f'"{quality}" is no quality')
    valid = int(number(quality)) in FIXES
    lat_deg, lon_deg = _place(place, valid)
    altitude_m, geoid_m = _metres(altitude, unit), _metres(geoid, geoid_unit)
    geoid_m = options.geoid_m if geoid_m is None else geoid_m
    return GnssRecord(
        t_rx_ns=0,
        sentence="GGA",
        valid=valid,
        t_device_s=_clock(clock),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=_height(altitude_m, geoid_m),
        geoid_m=geoid_m,
        quality=int(quality),
        satellites=int(number(satellites, 0, 99)) if satellites else None,
        hdop=number(hdop, 0) if hdop else None,
    )


def _rmc(fields: tuple[str, ...]) -> GnssRecord:
    if len(fields) not in (11, 12, 13):
        raise UnreadableError("syntax", "an RMC sentence has 11 to 13 fields")
    clock, status, *place, knots, course = fields[:8]
    mode = fields[11] if len(fields) > 11 else ""
    if status not in ("A", "V") or len(mode) > 1:
        raise UnreadableError("syntax", f'"{status}" and "{mode}" are no status and mode')
    valid = status == "A" and mode in MODES
    lat_deg, lon_deg = _place(place, valid)
    return GnssRecord(
        t_rx_ns=0,
        sentence="RMC",
        valid=valid,
        t_device_s=_clock(clock),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        speed_m_s=number(knots, 0) * KNOT_M_S if knots else None,
        course_deg=number(course, 0, 360) if course else None,
        mode=mode or None,
    )


def _place(fields: list[str], needed: bool) -> tuple[float | None, float | None]:
    """Latitude and longitude; a receiver without a fix may leave them empty."""
    lat, north, lon, east = fields
    if not (needed or lat or lon):
        return None, None
    if north not in ("N", "S") or east not in ("E", "W"):
        raise UnreadableError("syntax", "the hemispheres are not N or S and E or W")
    return degrees(lat, north), degrees(lon, east)


def _clock(text: str) -> float | None:
    return seconds_of_day(text) if text else None


def _metres(text: str, unit: str) -> float | None:
    if text and unit != "M":
        raise UnreadableError("syntax", f'"{text},{unit}" is not in metres')
    return number(text) if text else None


def _height(altitude_m: float | None, geoid_m: float | None) -> float | None:
    if altitude_m is None or geoid_m is None:
        return None
    return round(altitude_m + geoid_m, 6)  # undoes the binary noise of the sum


def _gga_fields(record: GnssRecord) -> list[str]:
    if record.quality is None:
        raise ValueError("a GGA sentence needs a quality")
    geoid_m, height = record.geoid_m, ["", "M", "", "M"]
    if geoid_m is not None:
        height[2] = f"{geoid_m:.2f}"
    if record.height_m is not None:
        height[0] = f"{record.height_m - (geoid_m or 0.0):.2f}"
        height[2] = height[2] or "0.00"
    satellites = "" if record.satellites is None else f"{record.satellites:02d}"
    hdop = "" if record.hdop is None else f"{record.hdop:.2f}"
    where = _place_fields(record)
    return [_time(record), *where, str(record.quality), satellites, hdop, *height, "", ""]


def _rmc_fields(record: GnssRecord) -> list[str]:
    knots = "" if record.speed_m_s is None else f"{record.speed_m_s / KNOT_M_S:.3f}"
    course = "" if record.course_deg is None else f"{record.course_deg:.2f}"
    status, where = "A" if record.valid else "V", _place_fields(record)
    mode = [] if record.mode is None else [record.mode]
    return [_time(record), status, *where, knots, course, "", "", "", *mode]


def _place_fields(record: GnssRecord) -> tuple[str, ...]:
    if record.lat_deg is None or record.lon_deg is None:
        return _NOWHERE
    return *latitude(record.lat_deg, 6), *longitude(record.lon_deg, 6)


def _time(record: GnssRecord) -> str:
    if record.t_device_s is None:
        return ""
    minutes, cs = divmod(round(record.t_device_s * 100) % 8_640_000, 6000)
    return f"{minutes // 60:02d}{minutes % 60:02d}{cs // 100:02d}.{cs % 100:02d}"


NMEA_GNSS = Codec(
    name="nmea-gnss",
    kind="gnss",
    devices="GNSS receivers that send GGA and RMC by NMEA 0183",
    options=GnssOptions,
    decoder=decoder,
    encode=encode,
)
