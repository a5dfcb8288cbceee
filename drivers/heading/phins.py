"""iXblue and Exail PHINS by sentences: the "PHINS STANDARD" output and what rides with it.

``$HEHDT,heading,T*hh``
    True heading.
``$PIXSE,ATITUD,roll,pitch*hh``
    Roll positive port up; pitch positive bow *down* (deg).
``$PIXSE,POSITI,latitude,longitude,altitude*hh``
    Degrees, longitude 0 to 360: what the unit estimates, not what a receiver measured.
``$PIXSE,SPEED_,east,north,up*hh``
    m/s, estimated too.
``$PIXSE,DEPIN_,depth,hhmmss.ssssss*hh``
    What a depth sensor told the unit (m), with its own time.

Every other sentence comes out as it is.
"""

from math import atan2, cos, degrees, hypot, radians, sin

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import number, numbers, plain, seconds_of_day
from drivers.nmea0183 import NmeaOptions
from drivers.records import DepthRecord, GnssRecord, HeadingRecord, NmeaSentence, Record
from drivers.sentences import Fields, Heard, Reader, expect, expect_units, table_decoder, written

DAY_S = 86_400


def decoder(options: NmeaOptions) -> Decoder:
    """Make a decoder of one unit's sentences."""
    return table_decoder({"HDT": _hdt, "PIXSE": _pixse}, options, options.checksum)


def encode(record: Record, options: NmeaOptions) -> bytes:
    """Write the one sentence that says a record: of heading and attitude, the heading.

    Raises
    ------
    ValueError
        If no sentence can say it.
    """
    return written(*_sentence(record), options.checksum)


def _hdt(fields: Fields, _options: NmeaOptions, heard: Heard) -> HeadingRecord:
    expect(fields, 2)
    expect_units(fields, {1: "T"})
    return HeadingRecord(**heard, heading_deg=number(fields[0], 0, 360))


def _pixse(fields: Fields, options: NmeaOptions, heard: Heard) -> Record:
    read = _READERS.get(fields[0]) if fields else None
    if read is None:
        return NmeaSentence(**heard, talker="P", formatter="IXSE", fields=fields)
    return read(fields[1:], options, heard)


def _atitud(fields: Fields, _options: NmeaOptions, heard: Heard) -> HeadingRecord:
    """Not valid as a heading, for there is none in it."""
    expect(fields, 2)
    return HeadingRecord(
        **heard,
        roll_deg=number(fields[0], -180, 180),
        pitch_deg=-number(fields[1], -90, 90),
        valid=False,
    )


def _positi(fields: Fields, _options: NmeaOptions, heard: Heard) -> GnssRecord:
    """What altitude means is a setting of the unit: it is not read."""
    expect(fields, 3)
    lon_deg = number(fields[1], -180, 360)
    return GnssRecord(
        **heard,
        valid=False,
        lat_deg=number(fields[0], -90, 90),
        lon_deg=lon_deg - 360 if lon_deg > 180 else lon_deg,
    )


def _speed(fields: Fields, _options: NmeaOptions, heard: Heard) -> GnssRecord:
    expect(fields, 3)
    east, north, _ = numbers(fields)
    course_deg = degrees(atan2(east, north)) % 360
    return GnssRecord(**heard, valid=False, speed_m_s=hypot(east, north), course_deg=course_deg)


def _depin(fields: Fields, _options: NmeaOptions, heard: Heard) -> DepthRecord:
    expect(fields, 2)
    return DepthRecord(**heard, depth_m=number(fields[0]), t_device_s=seconds_of_day(fields[1]))


_READERS: dict[str, Reader] = {
    "ATITUD": _atitud,
    "POSITI": _positi,
    "SPEED_": _speed,
    "DEPIN_": _depin,
}


def _sentence(record: Record) -> tuple[str, list[str]]:
    match record:
        case NmeaSentence():
            return record.talker + record.formatter, list(record.fields)
        case HeadingRecord(heading_deg=float(heading_deg)):
            return "HEHDT", [plain(heading_deg, 3), "T"]
        case HeadingRecord(roll_deg=float(roll_deg), pitch_deg=float(pitch_deg)):
            return "PIXSE", ["ATITUD", plain(roll_deg, 3), plain(-pitch_deg, 3)]
        case GnssRecord(lat_deg=float(lat_deg), lon_deg=float(lon_deg)):
            return "PIXSE", ["POSITI", plain(lat_deg, 8), plain(lon_deg % 360, 8), "0.000"]
        case GnssRecord(speed_m_s=float(speed_m_s), course_deg=float(course_deg)):
            east, north = (speed_m_s * turn(radians(course_deg)) for turn in (sin, cos))
            return "PIXSE", ["SPEED_", plain(east, 3), plain(north, 3), "0.000"]
        case DepthRecord(depth_m=float(depth_m), t_device_s=float(t_s)):
            return "PIXSE", ["DEPIN_", plain(depth_m, 3), _clock(t_s)]
    raise ValueError(f"no sentence of phins says this {type(record).__name__}")


def _clock(t_s: float) -> str:
    """``hhmmss.ssssss``."""
    seconds, microseconds = divmod(round(t_s * 1e6) % (DAY_S * 10**6), 10**6)
    hours, minutes = seconds // 3600, seconds // 60 % 60
    return f"{hours:02d}{minutes:02d}{seconds % 60:02d}.{microseconds:06d}"


PHINS = Codec(
    name="phins",
    kind="heading",
    devices="iXblue and Exail PHINS, ROVINS, OCTANS (PHINS STANDARD sentences)",
    options=NmeaOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_modulus_s=DAY_S),
    also=(
        "gnss",
        "depth",
    ),
)
