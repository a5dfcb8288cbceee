"""TrackLink GLL: the position of the target as ``$GPGLL,ddmm.mm,N,dddmm.mm,W,hhmmss,A``.

The sentence names no target and carries no checksum, and looks like that of a ship's GPS: it needs
a port of its own, and an option says whose position it is. 0.01 minute of latitude is 18 m.
"""

import msgspec
from msgspec import UNSET, UnsetType

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import seconds_of_day
from drivers.framing import LineDecoder, UnreadableError
from drivers.nmea0183 import degrees, last_start, latitude, longitude, parse
from drivers.records import Record, UsblRecord
from drivers.usbl.tracklink.fields import hms


class GllOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whose position the sentences give."""

    beacon: str = "1"


def decoder(options: GllOptions) -> Decoder:
    """Make a decoder of GLL sentences; a checksum need not be there, but then must hold."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        _, formatter, fields = parse(line, "optional")
        if formatter != "GLL":
            raise UnreadableError("unknown", f"{formatter} is not GLL")
        if len(fields) not in (6, 7) or fields[5] not in ("A", "V"):
            raise UnreadableError("syntax", "a GLL sentence has 6 fields and status A or V")
        lat, north, lon, east, clock, status = fields[:6]
        valid = status == "A"
        lat_deg: float | UnsetType = UNSET
        lon_deg: float | UnsetType = UNSET
        if valid or lat or lon:
            if north not in ("N", "S") or east not in ("E", "W"):
                raise UnreadableError("syntax", "the hemispheres are not N or S and E or W")
            lat_deg, lon_deg = degrees(lat, north), degrees(lon, east)
        return UsblRecord(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            beacon=options.beacon,
            t_device_s=seconds_of_day(clock) if clock else None,
            valid=valid,
            error_code=None if valid else status,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
        )

    return LineDecoder(decode, last_start)


def encode(record: Record, options: GllOptions) -> bytes:
    """Write one sentence, without a checksum as the program does."""
    if not isinstance(record, UsblRecord):
        raise ValueError(f"tracklink-gll cannot say a {type(record).__name__}")
    place = ("", "", "", "")
    if record.lat_deg is not UNSET and record.lon_deg is not UNSET:
        place = (*latitude(record.lat_deg, 2), *longitude(record.lon_deg, 2))
    elif record.valid:
        raise ValueError("tracklink-gll needs a latitude and a longitude")
    hours, minutes, seconds = hms(record.t_device_s)
    clock = "" if record.t_device_s is None else f"{hours:02d}{minutes:02d}{seconds:02d}"
    return f"$GPGLL,{','.join(place)},{clock},{'A' if record.valid else 'V'}\r\n".encode()


GLL = Codec(
    name="tracklink-gll",
    kind="usbl",
    devices="LinkQuest TrackLink, GLL output",
    options=GllOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=1.0),
)
