"""Teledyne RDI PD6, the text format of Doppler logs (Workhorse, Explorer, Pathfinder, others').

Lines that begin with a colon and two letters, CR LF, no checksum; numbers may be padded by blanks.
A ping is several lines, of which these are read, each as a record of its own:

``:SA,pitch,roll,heading``
    Attitude of the log, degrees.
``:TS,yymmddHHMMSScc,salinity,temperature,depth,sound speed,test``
    Time of the ping by the log's clock, taken as UTC.
``:BI,x,y,z,error,status``
    Velocity over the bottom in the log's axes, mm/s; A is good, V bad.
``:BS,transverse,longitudinal,normal,status``
    The same in ship's axes: starboard, forward, up.
``:BE,east,north,up,status``
    The same in Earth axes.
``:BD,east,north,up,range,seconds``
    Distance made good, and the range to the bottom (m), 0 where there is none.

Velocities are those of the log over a bottom at rest: with beam 3 forward, X is to starboard, Y
forward and Z up. Other makers that speak PD6 (Water Linked) put forward, starboard, down into BI.
Lines of the water mass (WI, WS, WE, WD) and health (HM) come out as other frames.
"""

import re
from typing import Literal

import msgspec
from msgspec import UNSET

from drivers.codec import Codec, Decoder
from drivers.fields import number, unix_date, unix_day
from drivers.framing import LineDecoder, UnreadableError, other_line
from drivers.records import (
    DepthRecord,
    DvlRecord,
    HeadingRecord,
    Record,
    TimeRecord,
    Vec3,
)
from drivers.sentences import Fields, Heard, expect

BAD = -32768
"""What stands for a velocity that could not be measured (mm/s)."""
MM = 1e-3
CENTURY = 2000

_LINE = re.compile(r":([A-Z]{2})((?:,[^:,]*)+)")
_WHEN = re.compile(r"\d{14}")


class Pd6Options(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What X, Y, Z of BI are, once the log hangs as its mounting angles are counted from."""

    axes: Literal["starboard_forward_up", "forward_starboard_down"] = "starboard_forward_up"


def decoder(options: Pd6Options) -> Decoder:
    """Make a decoder of a log's lines."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        match = _LINE.fullmatch(line)
        if match is None:
            raise UnreadableError("syntax", "not a line of PD6")
        heard: Heard = {"t_rx_ns": t_rx_ns, "line_bytes": line_bytes}
        fields = tuple(field.strip() for field in match[2].split(",")[1:])
        match match[1]:
            case "BI":
                return _instrument(fields, options, heard)
            case "BS":
                return _ship(fields, heard)
            case "BE":
                return _earth(fields, heard)
            case "BD":
                return _range(fields, heard)
            case "SA":
                return _attitude(fields, heard)
            case "TS":
                return _time(fields, heard)
            case name:
                return other_line(name, line, **heard)

    return LineDecoder(decode, _last_colon, longest=128)


def encode(record: Record, options: Pd6Options) -> bytes:
    """Write a `DvlRecord` as BI, BS or BE by its axes, and SA, TS and BD of the other kinds."""
    match record:
        case DvlRecord():
            fields = _velocity_fields(record, options)
        case DepthRecord(altitude_m=float(altitude_m)):
            fields = f"BD,+00000000.00,+00000000.00,+00000000.00,{altitude_m:07.2f},000.00"
        case DepthRecord():
            fields = "BD,+00000000.00,+00000000.00,+00000000.00,0000.00,000.00"
        case HeadingRecord(heading_deg=float(heading_deg)):
            pitch_deg, roll_deg = record.pitch_deg or 0.0, record.roll_deg or 0.0
            fields = f"SA,{pitch_deg:+06.2f},{roll_deg:+06.2f},{heading_deg:06.2f}"
        case TimeRecord(unix_s=float(unix_s)):
            fields = f"TS,{_when(unix_s)},35.0,+15.0,0000.0,1500.0,000"
        case _:
            raise ValueError(f"pd6 cannot say this {type(record).__name__}")
    return f":{fields}\r\n".encode()


def _instrument(fields: Fields, options: Pd6Options, heard: Heard) -> DvlRecord:
    expect(fields, 5)
    error = _mm_s(fields[3])
    velocity = _velocity(fields[:3], fields[4])
    if velocity is not None and options.axes == "starboard_forward_up":
        velocity = _turned(velocity)
    return DvlRecord(
        **heard,
        velocity_m_s=velocity,
        valid=velocity is not None,
        error_velocity_m_s=UNSET if error is None else error,
    )


def _ship(fields: Fields, heard: Heard) -> DvlRecord:
    expect(fields, 4)
    velocity = _velocity(fields[:3], fields[3])
    level = None if velocity is None else _turned(velocity)
    return DvlRecord(**heard, velocity_m_s=level, axes="level", valid=level is not None)


def _earth(fields: Fields, heard: Heard) -> DvlRecord:
    expect(fields, 4)
    velocity = _velocity(fields[:3], fields[3])
    north = None if velocity is None else _turned(velocity)
    return DvlRecord(**heard, velocity_m_s=north, axes="north", valid=north is not None)


def _range(fields: Fields, heard: Heard) -> DepthRecord:
    expect(fields, 5)
    range_m = number(fields[3], 0, 99_999)
    if not range_m:
        return DepthRecord(**heard, valid=False)
    return DepthRecord(**heard, altitude_m=range_m)


def _attitude(fields: Fields, heard: Heard) -> HeadingRecord:
    """Its heading is that of a flux-gate compass unless the vehicle told it a better one."""
    expect(fields, 3)
    pitch, roll, heading = fields
    return HeadingRecord(
        **heard,
        heading_deg=number(heading, 0, 360),
        reference="magnetic",
        roll_deg=number(roll, -180, 180),
        pitch_deg=number(pitch, -90, 90),
    )


def _time(fields: Fields, heard: Heard) -> TimeRecord:
    expect(fields, 6)
    if not _WHEN.fullmatch(fields[0]):
        raise UnreadableError("syntax", f'"{fields[0]}" is no date and time')
    year, month, day, hour, minute, second, cs = (
        int(fields[0][k : k + 2]) for k in range(0, 14, 2)
    )
    if hour > 23 or minute > 59 or second > 59:
        raise UnreadableError("range", f"{fields[0]} is not on the clock")
    midnight = unix_day(CENTURY + year, month, day)
    return TimeRecord(**heard, unix_s=midnight + 3600 * hour + 60 * minute + second + cs / 100)


def _velocity(fields: Fields, status: str) -> Vec3 | None:
    """Three components in m/s; None where the log says or shows that they are bad."""
    if status not in ("A", "V"):
        raise UnreadableError("syntax", f'"{status}" is no status')
    x, y, z = map(_mm_s, fields)
    if status == "V" or x is None or y is None or z is None:
        return None
    return x, y, z


def _mm_s(text: str) -> float | None:
    value = number(text, BAD, -BAD)
    return None if value == BAD else value * MM


def _turned(xyz: Vec3) -> Vec3:
    """Starboard, forward, up as forward, starboard, down; east, north, up likewise; and back."""
    x, y, z = xyz
    return y, x, -z


def _velocity_fields(record: DvlRecord, options: Pd6Options) -> str:
    name = {"sensor": "BI", "level": "BS", "north": "BE"}[record.axes]
    said = record.velocity_m_s or (0.0, 0.0, 0.0)
    if record.axes != "sensor" or options.axes == "starboard_forward_up":
        said = _turned(said)
    texts = [f"{round(component / MM):+06d}" for component in said]
    if record.axes == "sensor":
        error = record.error_velocity_m_s
        texts.append(f"{BAD if error is UNSET else round(error / MM):+06d}")
    return ",".join([name, *texts, "A" if record.valid else "V"])


def _when(unix_s: float) -> str:
    days, cs = divmod(round(unix_s * 100), 8_640_000)
    seconds, cs = divmod(cs, 100)
    clock = f"{seconds // 3600:02d}{seconds // 60 % 60:02d}{seconds % 60:02d}{cs:02d}"
    return f"{unix_date(days):%y%m%d}{clock}"


def _last_colon(line: bytes) -> tuple[int]:
    return (max(line.rfind(b":"), 0),)


PD6 = Codec(
    name="pd6",
    kind="dvl",
    devices="Teledyne RDI Doppler logs in PD6; Water Linked DVL in PD6 by option",
    options=Pd6Options,
    decoder=decoder,
    encode=encode,
    also=(
        "depth",
        "heading",
    ),
)
