"""Cerulean ROV Locator: ``$USRTH``, direction and range of a transmitter.

======= ==================================================
field   what
======= ==================================================
1, 2    apparent bearing, deg counterclockwise, clockwise
3       apparent elevation, deg
4       slant range, m
5, 6    true bearing, deg counterclockwise from east, clockwise from north
7       true elevation, deg
8 - 10  roll, pitch, yaw of the receiver, deg
11      compass heading, deg
12      gain
13 - 19 of newer receivers, not used
======= ==================================================

Apparent angles are in the receiver's own axes. Every other sentence comes out as it is.
"""

from math import remainder
from typing import Literal

import msgspec

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import maybe, numbers, plain
from drivers.framing import UnreadableError
from drivers.nmea0183 import Checksum
from drivers.records import NmeaSentence, Record, UsblRecord
from drivers.sentences import Fields, Heard, Reader, expect, table_decoder, written
from drivers.usbl.tracklink.fields import signed

LONGEST = 120


class UsrthOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whose direction the sentence tells, in which axes, and which way elevation grows.

    Angles are ``apparent``, in the array's axes, or ``true``, by the receiver's own compass.
    """

    checksum: Checksum = "required"
    beacon: str = "1"
    angles: Literal["apparent", "true"] = "apparent"
    elevation_positive: Literal["up", "down"] = "up"


def decoder(options: UsrthOptions) -> Decoder:
    """Make a decoder of one receiver's sentences."""
    return table_decoder(_READERS, options, options.checksum)


def encode(record: Record, options: UsrthOptions) -> bytes:
    """Write a fix; what the record does not say of the receiver is 0.

    Raises
    ------
    ValueError
        If the record is no fix with angles in the axes of the options.
    """
    match record:
        case NmeaSentence():
            address = record.talker + record.formatter
            return written(address, record.fields, options.checksum, LONGEST)
        case UsblRecord(bearing_deg=float(bearing_deg), elevation_deg=float(elevation_deg)):
            if record.axes == _axes(options):
                fields = _fields(bearing_deg, elevation_deg, record.slant_range_m, options)
                return written("USRTH", fields, options.checksum, LONGEST)
    raise ValueError(f"usrth cannot say this {type(record).__name__}")


def _rth(fields: Fields, options: UsrthOptions, heard: Heard) -> UsblRecord:
    """Bearing is told in both directions: they must agree."""
    expect(fields, 12, 19)
    at = 0 if options.angles == "apparent" else 4
    counterclockwise, clockwise, elevation = numbers((*fields[at : at + 2], fields[at + 2]))
    across = counterclockwise + clockwise - (0 if options.angles == "apparent" else 90)
    if not (0 <= clockwise <= 360 and -90 <= elevation <= 90) or abs(remainder(across, 360)) > 0.3:
        raise UnreadableError("range", "the bearings are no two of one direction")
    slant_m = maybe(fields[3], 0, 20_000)
    fault = None if slant_m else "no_range"
    return UsblRecord(
        **heard,
        beacon=options.beacon,
        bearing_deg=signed(clockwise),
        elevation_deg=_sign(options) * elevation + 0.0,
        slant_range_m=slant_m,
        valid=fault is None,
        error_code=fault,
        axes=_axes(options),
    )


def _axes(options: UsrthOptions) -> Literal["array", "north"]:
    return "array" if options.angles == "apparent" else "north"


def _sign(options: UsrthOptions) -> float:
    return 1.0 if options.elevation_positive == "up" else -1.0


def _fields(
    bearing_deg: float, elevation_deg: float, slant_m: float | None, options: UsrthOptions
) -> list[str]:
    """The receiver level and looking north: both sorts of angles are the same."""
    clockwise = round(bearing_deg, 1) % 360
    elevation = plain(_sign(options) * elevation_deg + 0.0, 1)
    return [
        *(plain(-clockwise % 360, 1), plain(clockwise, 1), elevation, plain(slant_m, 1)),
        *(plain((90 - clockwise) % 360, 1), plain(clockwise, 1), elevation),
        *("0.0", "0.0", "0.0", "0.0", "0"),
    ]


_READERS: dict[str, Reader] = {"RTH": _rth}

USRTH = Codec(
    name="usrth",
    kind="usbl",
    devices="Cerulean ROV Locator: USRTH",
    options=UsrthOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=None),
)
