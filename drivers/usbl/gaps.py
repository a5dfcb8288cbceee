"""iXblue and Exail GAPS, POSIDONIA: ``$PTSAG``, ``$PTSAX`` and ``$PTSAY``.

All three begin ``#frame,hhmmss.sss,dd,mm,yyyy,id`` and end ``validity,depth,told,sensor*hh``.

``$PTSAG,...,ddmm.mmmmm,N,dddmm.mmmmm,E,...[,altitude]*hh``
    Where a beacon is; id 0 is the ship's antenna.
``$PTSAX,...,x,y,...*hh``
    x forward and y starboard of the array (m), horizontal.
``$PTSAY,...,x,y,...*hh``
    x north, y east.
``$PTSAX,id,x,y,validity,depth,told,sensor*hh``
    The older form of PTSAX, without a time.

Validity is in hex which hydrophones served, F all four; told is 0 for no depth, 1 where it was
computed, 2 where a sensor in the beacon told it, 9999 is no sensor. Every other sentence comes out
as it is.
"""

from typing import Literal

import msgspec
from msgspec import UNSET, UnsetType

from drivers.codec import Codec, Decoder
from drivers.fields import clock, number, seconds_of_day, unix_date, unix_day
from drivers.framing import UnreadableError
from drivers.nmea0183 import Checksum, degrees, latitude, longitude
from drivers.records import GnssRecord, NmeaSentence, Record, UsblRecord
from drivers.sentences import Fields, Heard, Reader, expect, table_decoder, written
from drivers.usbl.geometry import place, polar

LONGEST = 120
SHIP = "0"
ALL_HYDROPHONES = "F"
DAY_S = 86_400


class GapsOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How deep the array is, which turns a beacon's depth into one below the array."""

    checksum: Checksum = "required"
    array_depth_m: float = 0.0


def decoder(options: GapsOptions) -> Decoder:
    """Make a decoder of one array's sentences."""
    return table_decoder(_READERS, options, options.checksum)


def encode(record: Record, options: GapsOptions) -> bytes:
    """Write a record: where the ship or a beacon is as PTSAG, what is seen as PTSAX or PTSAY.

    Raises
    ------
    ValueError
        If no sentence can say it.
    """
    return written(*_sentence(record, options), options.checksum, LONGEST)


def _ptsag(fields: Fields, _options: GapsOptions, heard: Heard) -> Record:
    expect(fields, 14, 15)
    beacon = _beacon(fields[5])
    lat, north, lon, east = fields[6:10]
    if north not in ("N", "S") or east not in ("E", "W"):
        raise UnreadableError("syntax", "the hemispheres are not N or S and E or W")
    lat_deg, lon_deg = degrees(lat, north), degrees(lon, east)
    fault = _fault(fields[10])
    if beacon == SHIP:
        return GnssRecord(
            **heard,
            valid=fault is None,
            t_device_s=seconds_of_day(fields[1]),
            lat_deg=lat_deg,
            lon_deg=lon_deg,
        )
    return UsblRecord(
        **heard,
        beacon=beacon,
        t_device_s=_unix_s(fields),
        valid=fault is None,
        error_code=fault,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        depth_m=_depth(fields[11], fields[12]),
    )


def _ptsax(fields: Fields, options: GapsOptions, heard: Heard) -> UsblRecord:
    """By its length the older form, without frame number, time and date."""
    expect(fields, 12, 7)
    t_s = _unix_s(fields) if len(fields) == 12 else None
    return _seen(fields[-7:], t_s, "level", options, heard)


def _ptsay(fields: Fields, options: GapsOptions, heard: Heard) -> UsblRecord:
    expect(fields, 12)
    return _seen(fields[-7:], _unix_s(fields), "north", options, heard)


def _seen(
    fields: Fields,
    t_s: float | None,
    axes: Literal["level", "north"],
    options: GapsOptions,
    heard: Heard,
) -> UsblRecord:
    """Without a depth a beacon is seen in a direction only."""
    beacon, x, y, hydrophones, depth, told, _ = fields
    depth_m = _depth(depth, told)
    z = 0.0 if depth_m is UNSET else depth_m - options.array_depth_m
    xyz_m = (number(x), number(y), z)
    bearing_deg, elevation_deg, slant_m = polar(xyz_m)
    deep = depth_m is not UNSET
    fault = _fault(hydrophones)
    return UsblRecord(
        **heard,
        beacon=_beacon(beacon),
        bearing_deg=bearing_deg,
        elevation_deg=elevation_deg if deep else None,
        slant_range_m=slant_m if deep else None,
        xyz_m=xyz_m if deep else None,
        t_device_s=t_s,
        valid=fault is None,
        error_code=fault,
        axes=axes,
        depth_m=depth_m,
    )


def _unix_s(fields: Fields) -> float:
    frame, time, *date = fields[:5]
    if not (frame.startswith("#") and frame[1:].isdigit() and all(map(str.isdigit, date))):
        raise UnreadableError("syntax", "no number of the frame and date")
    day, month, year = map(int, date)
    return unix_day(year, month, day) + seconds_of_day(time)


def _beacon(text: str) -> str:
    return str(int(number(text, 0, 128)))


def _fault(hydrophones: str) -> str | None:
    if len(hydrophones) != 1 or hydrophones not in "0123456789ABCDEF":
        raise UnreadableError("syntax", f'"{hydrophones}" are no hydrophones')
    return None if hydrophones == ALL_HYDROPHONES else f"hydrophones_{hydrophones}"


def _depth(text: str, told: str) -> float | UnsetType:
    if told not in ("0", "1", "2"):
        raise UnreadableError("syntax", f'"{told}" is not how a depth is told')
    depth_m = number(text)
    return UNSET if told == "0" else depth_m


def _sentence(record: Record, options: GapsOptions) -> tuple[str, list[str]]:
    match record:
        case NmeaSentence():
            return record.talker + record.formatter, list(record.fields)
        case GnssRecord(lat_deg=float(lat_deg), lon_deg=float(lon_deg)):
            end = [ALL_HYDROPHONES if record.valid else "0", "0000.0", "0", "9999.0"]
            return "PTSAG", [*_begin(record.t_device_s, SHIP), *_latlon(lat_deg, lon_deg), *end]
        case UsblRecord(lat_deg=float(lat_deg), lon_deg=float(lon_deg)):
            begin = _begin(record.t_device_s, record.beacon)
            return "PTSAG", [*begin, *_latlon(lat_deg, lon_deg), *_end(record, record.depth_m)]
        case UsblRecord(axes="level" | "north") if (xyz_m := place(record)) is not None:
            address = "PTSAX" if record.axes == "level" else "PTSAY"
            begin = _begin(record.t_device_s, record.beacon)
            x, y, z = xyz_m
            end = _end(record, z + options.array_depth_m)
            return address, [*begin, f"{x:.2f}", f"{y:.2f}", *end]
    raise ValueError(f"no sentence of gaps says this {type(record).__name__}")


def _begin(t_s: float | None, beacon: str) -> list[str]:
    """Rounded before it is split: there is no second 60."""
    days, seconds = divmod(round(t_s or 0.0, 3), DAY_S)
    date = f"{unix_date(int(days)):%d %m %Y}".split()
    return ["#1", clock(seconds, 3), *date, beacon]


def _latlon(lat_deg: float, lon_deg: float) -> list[str]:
    return [*latitude(lat_deg, 5), *longitude(lon_deg, 5)]


def _end(record: UsblRecord, depth_m: float | UnsetType) -> list[str]:
    hydrophones = ALL_HYDROPHONES if record.valid else (record.error_code or "0")[-1]
    depth = ["0000.0", "0"] if depth_m is UNSET else [f"{depth_m:06.1f}", "1"]
    return [hydrophones, *depth, "9999.0"]


_READERS: dict[str, Reader] = {"PTSAG": _ptsag, "PTSAX": _ptsax, "PTSAY": _ptsay}

GAPS = Codec(
    name="gaps",
    kind="usbl",
    devices="iXblue and Exail GAPS, POSIDONIA: PTSAG, PTSAX, PTSAY",
    options=GapsOptions,
    decoder=decoder,
    encode=encode,
    also=("gnss",),
)
