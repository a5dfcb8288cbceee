"""Tritech MicronNav: the position of a responder or transponder as ``%D`` lines (RemV4).

``%D`` count slot device mode kind content CR LF: count u16 of all bytes of the line, slot and
device u8, all three in hex; mode ``0`` text in columns, ``3`` separated by commas. Slot 08 is the
MicronNav, kind 1 its raw position:

======= ======== ===================================================================
columns commas   content
======= ======== ===================================================================
3       0        unit: 0 the responder, 1 to 15 transponders, 19 an INS
11      -18686   x to starboard, mm
11      +4764    y forward, mm
11      +4100    z down, mm
12      0.8      quality, 0 to 3, more is better; in columns ``+0.80000E+00``
3       30       who replied: bit 0 the transmitter, 1 to 4 the receivers
8       15315632 local time, hhmmss and hundredths
======= ======== ===================================================================

With commas, one stands in front of each field. Kind 0, a place in the world without its zone, and
what comes from other slots are passed on as they are.
"""

import re
from typing import Literal

import msgspec

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import clock, seconds_of_day
from drivers.framing import LineDecoder, UnreadableError, other_line
from drivers.records import Record, UsblRecord
from drivers.sentences import Heard
from drivers.usbl.geometry import place, polar

MICRONNAV_SLOT = 0x08
COLUMNS, COMMAS = "0", "3"
RAW = "1"
ALL_RECEIVERS = 0x1E
UNIT_MAX = 19
MM_MAX = 100_000_000
QUALITY = 1.0
"""What is written of a good fix."""

_LINE = re.compile(r"%D([0-9A-F]{4})([0-9A-F]{2})[0-9A-F]{2}([0-3])([0-3])(.*)")
_MM = r"([+-]?\d{1,10})"
_BY_COMMAS = re.compile(rf",(\d{{1,3}}),{_MM},{_MM},{_MM},(\d+(?:\.\d+)?),(\d{{1,3}}),(\d{{8}})")
_BY_COLUMNS = re.compile(
    r"(\d{3})([+-]\d{10})([+-]\d{10})([+-]\d{10})([+-]\d\.\d{5}E[+-]\d\d)(\d{3})(\d{8})"
)
_CONTENT = {COMMAS: _BY_COMMAS, COLUMNS: _BY_COLUMNS}
_REPLIES = re.compile(r"replies_(\d{1,3})")


class MicronNavOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether the head's own tilt is taken out, which quality is good, how lines are written."""

    levelled: bool = True
    quality_min: float = 0.0
    commas: bool = True


def decoder(options: MicronNavOptions) -> Decoder:
    """Make a decoder of what the topside program sends."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        heard: Heard = {"t_rx_ns": t_rx_ns, "line_bytes": line_bytes}
        head = _LINE.fullmatch(line)
        if head is None:
            raise UnreadableError("syntax", "no line of RemV4")
        count, slot, mode, kind, content = head.groups()
        if int(count, 16) != len(line) + 2:
            raise UnreadableError("length", f"{count} bytes said, not {len(line) + 2}")
        if int(slot, 16) != MICRONNAV_SLOT or kind != RAW or mode not in _CONTENT:
            return other_line(f"slot {slot} kind {kind}", line, t_rx_ns, line_bytes)
        fields = _CONTENT[mode].fullmatch(content)
        if fields is None:
            raise UnreadableError("syntax", "no raw position")
        return _fix(fields, options, heard)

    return LineDecoder(decode, lambda line: (max(line.rfind(b"%D"), 0),))


def encode(record: Record, options: MicronNavOptions) -> bytes:
    """Write a raw position; of one that is not valid, that a receiver heard nothing.

    Raises
    ------
    ValueError
        If the record is no place in the axes of the options, or its numbers do not fit.
    """
    if not isinstance(record, UsblRecord) or record.axes != _axes(options):
        raise ValueError(f"micronnav cannot say this {type(record).__name__}")
    xyz_m, unit = place(record), int(record.beacon)
    if xyz_m is None or not 0 <= unit <= UNIT_MAX:
        raise ValueError(f"micronnav needs a place, and a unit from 0 to {UNIT_MAX}")
    x, y, z = (round(value * 1000) for value in xyz_m)
    if max(abs(x), abs(y), abs(z)) > MM_MAX:
        raise ValueError(f"{xyz_m} m are too far for micronnav")
    fault = "" if record.valid else record.error_code or "replies_0"
    quality = 0.0 if fault == "quality" else max(QUALITY, options.quality_min)
    silent = _REPLIES.fullmatch(fault)
    replies = int(silent[1]) if silent else ALL_RECEIVERS
    time = clock(record.t_device_s or 0.0).replace(".", "")
    if options.commas:
        content = f",{unit},{y:+d},{x:+d},{z:+d},{quality:.1f},{replies},{time}"
    else:
        content = f"{unit:03d}{y:+011d}{x:+011d}{z:+011d}{quality:+.5f}E+00{replies:03d}{time}"
    head = f"{MICRONNAV_SLOT:02X}20{COMMAS if options.commas else COLUMNS}{RAW}"
    count = len("%D0000") + len(head) + len(content) + 2
    return f"%D{count:04X}{head}{content}\r\n".encode()


def _fix(fields: re.Match[str], options: MicronNavOptions, heard: Heard) -> UsblRecord:
    unit, y, x, z, quality, replies, time = fields.groups()
    if int(unit) > UNIT_MAX or max(abs(int(value)) for value in (x, y, z)) > MM_MAX:
        raise UnreadableError("range", "no such unit, or a place too far away")
    xyz_m = (int(x) / 1000, int(y) / 1000, int(z) / 1000)
    bearing_deg, elevation_deg, slant_m = polar(xyz_m)
    fault = _fault(int(replies), float(quality), slant_m, options)
    return UsblRecord(
        **heard,
        beacon=str(int(unit)),
        bearing_deg=bearing_deg,
        elevation_deg=elevation_deg,
        slant_range_m=slant_m,
        xyz_m=xyz_m,
        t_device_s=seconds_of_day(f"{time[:6]}.{time[6:]}"),
        valid=fault is None,
        error_code=fault,
        axes=_axes(options),
    )


def _fault(replies: int, quality: float, slant_m: float, options: MicronNavOptions) -> str | None:
    if replies & ALL_RECEIVERS != ALL_RECEIVERS:
        return f"replies_{replies}"
    if quality < options.quality_min:
        return "quality"
    return None if slant_m > 0 else "no_range"


def _axes(options: MicronNavOptions) -> Literal["array", "level"]:
    return "level" if options.levelled else "array"


MICRONNAV = Codec(
    name="micronnav",
    kind="usbl",
    devices="Tritech MicronNav: raw XYZ in columns or with commas",
    options=MicronNavOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_modulus_s=86_400.0, time_step_s=0.01),
)
