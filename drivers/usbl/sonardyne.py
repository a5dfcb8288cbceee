"""Sonardyne Ranger 2: ``$PSONLLD``, where a beacon is and how well that is known.

``$PSONLLD,hhmmss.ss,beacon,A,lat,lon,depth,major,minor,direction,depth sigma,,,,*hh``
    Decimal degrees; depth, the half axes of the 1-sigma ellipse and the sigma of depth in m; status
    A or V. The names of beacons may hold blanks.

Every other sentence comes out as it is.
"""

from msgspec import UNSET, UnsetType

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import clock, number, seconds_of_day
from drivers.framing import UnreadableError
from drivers.nmea0183 import NmeaOptions
from drivers.records import NmeaSentence, Record, UsblRecord
from drivers.sentences import Fields, Heard, Reader, expect, table_decoder, written

LONGEST = 160


def decoder(options: NmeaOptions) -> Decoder:
    """Make a decoder of one system's sentences."""
    return table_decoder(_READERS, options, options.checksum)


def encode(record: Record, options: NmeaOptions) -> bytes:
    """Write where a beacon is.

    Raises
    ------
    ValueError
        If the record does not say it.
    """
    match record:
        case NmeaSentence():
            address = record.talker + record.formatter
            return written(address, record.fields, options.checksum, LONGEST)
        case UsblRecord():
            return written("PSONLLD", _lld_fields(record), options.checksum, LONGEST)
    raise ValueError(f"psonlld cannot say this {type(record).__name__}")


def _lld(fields: Fields, _options: NmeaOptions, heard: Heard) -> UsblRecord:
    """What follows the ellipse is not described: any number of fields."""
    if len(fields) < 10:
        expect(fields, 14)
    time, beacon, status, lat, lon, depth = fields[:6]
    if not beacon or status not in ("A", "V"):
        raise UnreadableError("syntax", "no beacon, or a status that is neither A nor V")
    valid = status == "A"
    return UsblRecord(
        **heard,
        beacon=beacon,
        t_device_s=seconds_of_day(time),
        valid=valid,
        error_code=None if valid else status,
        lat_deg=_told(lat, 90, valid),
        lon_deg=_told(lon, 180, valid),
        depth_m=_told(depth, 1e5, valid),
    )


def _told(text: str, bound: float, needed: bool) -> float | UnsetType:
    """Read a number, which only a fix that is no good may leave out."""
    return number(text, -bound, bound) if text or needed else UNSET


def _lld_fields(record: UsblRecord) -> list[str]:
    place = (record.lat_deg, record.lon_deg, record.depth_m)
    if record.valid and UNSET in place:
        raise ValueError("psonlld needs latitude, longitude and depth")
    lat, lon, depth = (
        "" if value is UNSET else f"{value:.{decimals}f}"
        for value, decimals in zip(place, (8, 8, 3), strict=True)
    )
    status = "A" if record.valid else "V"
    ellipse = ["0.00", "0.00", "0.00", "0.00"]
    begin = [clock(record.t_device_s or 0.0), record.beacon, status]
    return [*begin, lat, lon, depth, *ellipse, "", "", "", ""]


_READERS: dict[str, Reader] = {"PSONLLD": _lld}

PSONLLD = Codec(
    name="psonlld",
    kind="usbl",
    devices="Sonardyne Ranger 2: PSONLLD",
    options=NmeaOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_modulus_s=86_400.0),
)
