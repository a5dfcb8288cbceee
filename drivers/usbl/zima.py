"""UCNL Zima 2: ``$PAZM3``, a reply heard by an array.

======= ==================================================
field   what
======= ==================================================
1       0 the array's own data, 1 a reply, 2 no reply in time
2       address of who replied
3, 4    codes of request and response
5       how far the reply stood out of the noise, dB
6       the sound's one way, s
7, 8    slant range, horizontal range, m
9       depth the beacon told, m
10      azimuth, deg clockwise from the array's mark
11      elevation, deg, positive down
12, 13  pressure mbar and temperature deg C at the array
14      not used
15, 16  pitch, roll, deg
======= ==================================================

Only sentences of status 0 carry a checksum in the firmware seen last. Every other sentence comes
out as it is.
"""

from math import isclose
from typing import Literal

import msgspec
from msgspec import UNSET

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import maybe, number, plain
from drivers.framing import UnreadableError
from drivers.nmea0183 import Checksum
from drivers.records import NmeaSentence, Record, UsblRecord
from drivers.sentences import Fields, Heard, Reader, expect, table_decoder, written
from drivers.usbl.tracklink.fields import signed

LONGEST = 120
TRAVEL_MAX_S = 10.0
RANGE_MAX_M = 20_000.0
OWN, REPLY, TIMEOUT = "0", "1", "2"


class ZimaOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether sentences carry a checksum, and which way elevation grows.

    ``sound_speed_m_s`` bounds what range and time may say of each other, within ``agreement``.
    """

    checksum: Checksum = "optional"
    elevation_positive: Literal["down", "up"] = "down"
    sound_speed_m_s: float = 1500.0
    agreement: float = 0.1


def decoder(options: ZimaOptions) -> Decoder:
    """Make a decoder of one array's sentences."""
    return table_decoder(_READERS, options, options.checksum)


def encode(record: Record, options: ZimaOptions) -> bytes:
    """Write a reply, or that there was none in time.

    Raises
    ------
    ValueError
        If the record is none of a reply.
    """
    match record:
        case NmeaSentence():
            address = record.talker + record.formatter
            return written(address, record.fields, options.checksum, LONGEST)
        case UsblRecord():
            return written("PAZM3", _fields(record, options), options.checksum, LONGEST)
    raise ValueError(f"pazm3 cannot say this {type(record).__name__}")


def _azm(fields: Fields, options: ZimaOptions, heard: Heard) -> Record:
    expect(fields, 16)
    status, beacon = fields[:2]
    if status == OWN:
        return NmeaSentence(**heard, talker="P", formatter="AZM3", fields=fields)
    if status not in (REPLY, TIMEOUT) or not beacon.isdigit():
        raise UnreadableError("syntax", f'"{status}" and "{beacon}" are no reply')
    if status == TIMEOUT:
        return UsblRecord(**heard, beacon=str(int(beacon)), valid=False, error_code="timeout")
    way_s = maybe(fields[5], 0, TRAVEL_MAX_S)
    slant_m = maybe(fields[6], 0, RANGE_MAX_M)
    azimuth = maybe(fields[9], 0, 360)
    elevation = maybe(fields[10], -90, 90)
    fault = _fault(way_s, slant_m, options)
    return UsblRecord(
        **heard,
        beacon=str(int(beacon)),
        bearing_deg=None if azimuth is None else signed(azimuth),
        elevation_deg=None if elevation is None else _sign(options) * elevation + 0.0,
        slant_range_m=slant_m,
        valid=fault is None,
        error_code=fault,
        depth_m=UNSET if not fields[8] else number(fields[8]),
        one_way_s=UNSET if way_s is None else way_s,
    )


def _fault(way_s: float | None, slant_m: float | None, options: ZimaOptions) -> str | None:
    """Name the fault of a reply without a range, or whose range is not that of its time."""
    if not slant_m:
        return "no_range"
    if way_s is None:
        return None
    far_m = way_s * options.sound_speed_m_s
    return None if isclose(far_m, slant_m, rel_tol=options.agreement) else "inconsistent"


def _sign(options: ZimaOptions) -> float:
    return -1.0 if options.elevation_positive == "down" else 1.0


def _fields(record: UsblRecord, options: ZimaOptions) -> list[str]:
    status = TIMEOUT if record.error_code == "timeout" else REPLY
    elevation = record.elevation_deg
    way_s = None if record.one_way_s is UNSET else record.one_way_s
    return [
        *(status, str(int(record.beacon)), "0", "0", "", plain(way_s, 6)),
        *(plain(record.slant_range_m, 1), ""),
        plain(None if record.depth_m is UNSET else record.depth_m, 1),
        plain(None if record.bearing_deg is None else round(record.bearing_deg, 1) % 360, 1),
        plain(None if elevation is None else _sign(options) * elevation + 0.0, 1),
        *("", "", "", "", ""),
    ]


_READERS: dict[str, Reader] = {"PAZM3": _azm}

PAZM3 = Codec(
    name="pazm3",
    kind="usbl",
    devices="UCNL Zima 2: PAZM3",
    options=ZimaOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=None),
)
