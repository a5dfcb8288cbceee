"""GNSS receivers by NMEA 0183: position with GGA or GNS, velocity with RMC or VTG, time with ZDA.

``$--GGA,hhmmss.ss,ddmm.mm,N,dddmm.mm,E,q,nn,h.h,altitude,M,geoid,M,age,station*hh``
    UTC, latitude, longitude, quality (0 none, 1 to 5 a fix, 6 estimated, 7 manual, 8 simulated),
    satellites, HDOP, altitude above the geoid, and the geoid above the ellipsoid: their sum is the
    height. ``age`` and ``station`` of the corrections are not read.
``$--GNS,hhmmss.ss,ddmm.mm,N,dddmm.mm,E,modes,nn,h.h,altitude,geoid,age,station,safety*hh``
    The same with a mode letter for each satellite system; ``safety`` came with version 4.1.
``$--RMC,hhmmss.ss,A,ddmm.mm,N,dddmm.mm,E,knots,course,ddmmyy,variation,E,mode,safety*hh``
    UTC, status (A or V), latitude, longitude, speed and true course over ground. ``mode`` came with
    version 2.3 (A, D, F, R and P are fixes; E estimated, M manual, S simulated, N none), ``safety``
    with 4.1 and is not read, like date and magnetic variation.
``$--VTG,course,T,magnetic,M,knots,N,km/h,K,mode*hh``
    True course and speed over ground; no time of its own.
``$--ZDA,hhmmss.ss,dd,mm,yyyy,zone,minutes*hh``
    UTC with its date; the local zone is not read.

Any talker. Every other sentence comes out as it is.
"""

import msgspec

from drivers.codec import Codec, Decoder
from drivers.fields import clock, maybe, number, plain, seconds_of_day, unix_date, unix_day
from drivers.framing import UnreadableError
from drivers.nmea0183 import Checksum, degrees, latitude, longitude
from drivers.records import GnssRecord, Record, TimeRecord
from drivers.sentences import Fields, Heard, Reader, expect, expect_units, table_decoder, written

KNOT_M_S = 1852 / 3600
FIXES = range(1, 6)
"""Qualities of GGA that the receiver measured."""
MODES = frozenset("ADFRP")
"""Modes of the other sentences that the receiver measured."""
ALL_MODES = MODES | frozenset("EMNS")

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
    return table_decoder(READERS, options, options.checksum)


def encode(record: Record, options: GnssOptions) -> bytes:
    """Write the sentence that a `GnssRecord` names, or a `TimeRecord`, under the talker GP."""
    if isinstance(record, TimeRecord):
        return written("GPZDA", _zda_fields(record), options.checksum)
    if not isinstance(record, GnssRecord) or record.sentence is None:
        raise ValueError(f"nmea-gnss cannot say a {type(record).__name__} that names no sentence")
    fields = _WRITERS[record.sentence](record)
    return written(f"GP{record.sentence}", fields, options.checksum)


def _gga(fields: Fields, options: GnssOptions, heard: Heard) -> GnssRecord:
    expect(fields, 14)
    time, *place, quality, satellites, hdop, altitude, unit, geoid, geoid_unit, _, _ = fields
    if len(quality) != 1:
        raise UnreadableError("syntax", f'"{quality}" is no quality')
    valid = int(number(quality)) in FIXES
    lat_deg, lon_deg = _place(place, valid)
    for text, letter in ((altitude, unit), (geoid, geoid_unit)):
        if text and letter != "M":
            raise UnreadableError("syntax", f'"{text},{letter}" is not in metres')
    height_m, geoid_m = _height(maybe(altitude), maybe(geoid), options)
    return GnssRecord(
        **heard,
        sentence="GGA",
        valid=valid,
        t_device_s=_time(time),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=height_m,
        geoid_m=geoid_m,
        quality=int(quality),
        satellites=_count(satellites),
        hdop=maybe(hdop, 0),
    )


def _gns(fields: Fields, options: GnssOptions, heard: Heard) -> GnssRecord:
    expect(fields, 12, 13)
    time, *place, modes, satellites, hdop, altitude, geoid = fields[:10]
    if not modes or not ALL_MODES.issuperset(modes):
        raise UnreadableError("syntax", f'"{modes}" are no modes')
    valid = not MODES.isdisjoint(modes)
    lat_deg, lon_deg = _place(place, valid)
    height_m, geoid_m = _height(maybe(altitude), maybe(geoid), options)
    return GnssRecord(
        **heard,
        sentence="GNS",
        valid=valid,
        t_device_s=_time(time),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=height_m,
        geoid_m=geoid_m,
        mode=modes,
        satellites=_count(satellites),
        hdop=maybe(hdop, 0),
    )


def _rmc(fields: Fields, _options: GnssOptions, heard: Heard) -> GnssRecord:
    expect(fields, 11, 12, 13)
    time, status, *place, knots, course = fields[:8]
    mode = fields[11] if len(fields) > 11 else ""
    if status not in ("A", "V") or len(mode) > 1:
        raise UnreadableError("syntax", f'"{status}" and "{mode}" are no status and mode')
    valid = status == "A" and (not mode or mode in MODES)
    lat_deg, lon_deg = _place(place, valid)
    return GnssRecord(
        **heard,
        sentence="RMC",
        valid=valid,
        t_device_s=_time(time),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        speed_m_s=number(knots, 0) * KNOT_M_S if knots else None,
        course_deg=maybe(course, 0, 360),
        mode=mode or None,
    )


def _vtg(fields: Fields, _options: GnssOptions, heard: Heard) -> GnssRecord:
    expect(fields, 9, 8)
    expect_units(fields, {1: "T", 3: "M", 5: "N", 7: "K"})
    course, _, _, _, knots = fields[:5]
    mode = fields[8] if len(fields) > 8 else ""
    if len(mode) > 1:
        raise UnreadableError("syntax", f'"{mode}" is no mode')
    return GnssRecord(
        **heard,
        sentence="VTG",
        valid=mode in MODES if mode else bool(knots),
        speed_m_s=number(knots, 0) * KNOT_M_S if knots else None,
        course_deg=maybe(course, 0, 360),
        mode=mode or None,
    )


def _zda(fields: Fields, _options: GnssOptions, heard: Heard) -> TimeRecord:
    """A receiver that does not know the time yet leaves the fields empty."""
    expect(fields, 6, 4)
    time, *day = fields[:4]
    if not (time and all(day)):
        return TimeRecord(**heard, valid=False)
    if not all(text.isdigit() for text in day):
        raise UnreadableError("syntax", f"{'.'.join(day)} is no date")
    d, m, year = map(int, day)
    return TimeRecord(**heard, unix_s=unix_day(year, m, d) + seconds_of_day(time))


def _place(fields: list[str], needed: bool) -> tuple[float | None, float | None]:
    """Latitude and longitude; a receiver without a fix may leave them empty."""
    lat, north, lon, east = fields
    if not (needed or lat or lon):
        return None, None
    if north not in ("N", "S") or east not in ("E", "W"):
        raise UnreadableError("syntax", "the hemispheres are not N or S and E or W")
    return degrees(lat, north), degrees(lon, east)


def _time(text: str) -> float | None:
    return seconds_of_day(text) if text else None


def _count(text: str) -> int | None:
    return int(number(text, 0, 99)) if text else None


def _height(
    altitude_m: float | None, geoid_m: float | None, options: GnssOptions
) -> tuple[float | None, float | None]:
    """Height above the ellipsoid and the geoid's."""
    geoid_m = options.geoid_m if geoid_m is None else geoid_m
    if altitude_m is None or geoid_m is None:
        return None, geoid_m
    return round(altitude_m + geoid_m, 6), geoid_m  # undoes the binary noise of the sum


def _gga_fields(record: GnssRecord) -> list[str]:
    if record.quality is None:
        raise ValueError("a GGA sentence needs a quality")
    altitude, geoid = _height_fields(record)
    where, heights = _place_fields(record), [altitude, "M", geoid, "M"]
    sight = [str(record.quality), *_sight_fields(record)]
    return [clock(record.t_device_s), *where, *sight, *heights, "", ""]


def _gns_fields(record: GnssRecord) -> list[str]:
    if record.mode is None:
        raise ValueError("a GNS sentence needs a mode")
    where, sight = _place_fields(record), [record.mode, *_sight_fields(record)]
    return [clock(record.t_device_s), *where, *sight, *_height_fields(record), "", ""]


def _rmc_fields(record: GnssRecord) -> list[str]:
    status, where = "A" if record.valid else "V", _place_fields(record)
    mode = [] if record.mode is None else [record.mode]
    moving = [_knots(record), plain(record.course_deg, 2)]
    return [clock(record.t_device_s), status, *where, *moving, "", "", "", *mode]


def _vtg_fields(record: GnssRecord) -> list[str]:
    speed_km_h = None if record.speed_m_s is None else record.speed_m_s * 3.6
    mode = [] if record.mode is None else [record.mode]
    course, over = plain(record.course_deg, 2), plain(speed_km_h, 3)
    return [course, "T", "", "M", _knots(record), "N", over, "K", *mode]


def _zda_fields(record: TimeRecord) -> list[str]:
    if record.unix_s is None:
        return [""] * 6
    day, of_day = divmod(round(record.unix_s * 100), 8_640_000)
    when = unix_date(day)
    return [clock(of_day / 100), f"{when.day:02d}", f"{when.month:02d}", str(when.year), "00", "00"]


def _place_fields(record: GnssRecord) -> tuple[str, ...]:
    if record.lat_deg is None or record.lon_deg is None:
        return _NOWHERE
    return *latitude(record.lat_deg, 6), *longitude(record.lon_deg, 6)


def _sight_fields(record: GnssRecord) -> list[str]:
    satellites = "" if record.satellites is None else f"{record.satellites:02d}"
    return [satellites, plain(record.hdop, 2)]


def _height_fields(record: GnssRecord) -> tuple[str, str]:
    """Altitude and geoid, the latter 0 where only their sum is known."""
    if record.height_m is None:
        return "", plain(record.geoid_m, 2)
    geoid_m = record.geoid_m or 0.0
    return f"{record.height_m - geoid_m:.2f}", f"{geoid_m:.2f}"


def _knots(record: GnssRecord) -> str:
    return plain(None if record.speed_m_s is None else record.speed_m_s / KNOT_M_S, 3)


READERS: dict[str, Reader] = {"GGA": _gga, "GNS": _gns, "RMC": _rmc, "VTG": _vtg, "ZDA": _zda}
_WRITERS = {"GGA": _gga_fields, "GNS": _gns_fields, "RMC": _rmc_fields, "VTG": _vtg_fields}

NMEA_GNSS = Codec(
    name="nmea-gnss",
    kind="gnss",
    devices="GNSS receivers that send GGA or GNS, RMC or VTG, and ZDA by NMEA 0183",
    options=GnssOptions,
    decoder=decoder,
    encode=encode,
)
