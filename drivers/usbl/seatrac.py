"""Blueprint SeaTrac X150 and X110: the fix of an acoustic exchange (ACOFIX).

A message is ``$``, two hex digits of what it is, the hex digits of its bytes, four of the
CRC-16/ARC of all these bytes (low byte first), CR LF. Those that begin with an ACOFIX are

==== ========= ======================
id   name      before the fix
==== ========= ======================
0x39 XCVR_FIX  nothing
0x42 PING_RESP nothing
==== ========= ======================

====== ====== =======================================================
offset type   what (little-endian)
====== ====== =======================================================
0      u8     destination
1      u8     source: who replied
2      u8     flags: range, angles, position, enhanced, filter error
3      u8     type of message
4      i16 x3 yaw (magnetic), pitch, roll, 0.1 deg
10     u16    depth of this beacon, dm
12     u16    sound speed, dm/s
14     i16    signal, cB
16     u32    range: count, 16 kHz
20     i32    range: one way of the sound, 100 ns
24     u16    range, dm
+0     u8     angles: n receivers
+1     i16 xn angles: signal at each
+      i16    azimuth, 0.1 deg
+2     i16    elevation, 0.1 deg
+4     i16    error of the fit, 0.01
+0     i16 x3 position: east, north, depth, dm
====== ====== =======================================================

Blocks whose flag is not set are not there. Other messages come out as they are.
"""

import re
import struct
from math import remainder
from typing import Literal

import msgspec

from drivers.checksums import crc16_arc
from drivers.codec import Codec, Counting, Decoder
from drivers.framing import LineDecoder, UnreadableError, other_line
from drivers.nmea0183 import last_start
from drivers.records import Record, UsblRecord
from drivers.sentences import Heard

XCVR_FIX, PING_RESP = 0x39, 0x42
FIXES = (XCVR_FIX, PING_RESP)
RANGE, ANGLES, POSITION, FILTER_ERROR = 1, 2, 4, 16
SOUND_DM_S = 15_000

_HEX = re.compile(r"\$((?:[0-9A-Fa-f]{2}){3,512})")
_BEGIN = struct.Struct("<BBBB3hHHh")
_RANGE = struct.Struct("<IiH")
_ANGLES = struct.Struct("<3h")
_POSITION = struct.Struct("<3h")


class SeatracOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which way elevation grows, and up to which error of the fit angles are good."""

    elevation_positive: Literal["up", "down"] = "up"
    fit_error_max: float = 3.0


def decoder(options: SeatracOptions) -> Decoder:
    """Make a decoder of what a beacon sends."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        match = _HEX.fullmatch(line)
        if match is None:
            raise UnreadableError("syntax", "no line of hex digits")
        message = bytes.fromhex(match[1])
        content, check = message[:-2], message[-2:]
        if crc16_arc(content).to_bytes(2, "little") != check:
            raise UnreadableError("checksum", "the CRC does not hold")
        heard: Heard = {"t_rx_ns": t_rx_ns, "line_bytes": line_bytes}
        if content[0] not in FIXES:
            return other_line(f"0x{content[0]:02X}", line, t_rx_ns, line_bytes)
        return _fix(content[1:], options, heard)

    return LineDecoder(decode, last_start)


def encode(record: Record, options: SeatracOptions) -> bytes:
    """Write a fix as XCVR_FIX.

    Raises
    ------
    ValueError
        If the record is none, or no field can hold it.
    """
    if not isinstance(record, UsblRecord) or record.axes != "array":
        raise ValueError(f"seatrac cannot say this {type(record).__name__}")
    try:
        content = bytes((XCVR_FIX,)) + _content(record, options)
    except struct.error as error:
        raise ValueError(f"seatrac cannot say this fix: {error}") from error
    check = crc16_arc(content).to_bytes(2, "little")
    return b"$" + (content + check).hex().upper().encode() + b"\r\n"


def _fix(content: bytes, options: SeatracOptions, heard: Heard) -> UsblRecord:
    try:
        _, source, flags, *_ = _BEGIN.unpack_from(content)
        at = _BEGIN.size
        slant_m = bearing_deg = elevation_deg = fit = None
        if flags & RANGE:
            slant_m = _RANGE.unpack_from(content, at)[2] / 10
            at += _RANGE.size
        if flags & ANGLES:
            at += 1 + 2 * content[at]
            azimuth, elevation, error = _ANGLES.unpack_from(content, at)
            bearing_deg, elevation_deg = azimuth / 10, _sign(options) * elevation / 10 + 0.0
            fit = error / 100
            at += _ANGLES.size
        at += _POSITION.size if flags & POSITION else 0
    except (struct.error, IndexError) as error:
        raise UnreadableError("length", str(error)) from error
    if at != len(content):
        raise UnreadableError("length", f"{len(content)} bytes of a fix, not {at}")
    if bearing_deg is not None and not abs(bearing_deg) <= 360:
        raise UnreadableError("range", f"no bearing of {bearing_deg} deg")
    fault = _fault(slant_m, fit, flags, options)
    return UsblRecord(
        **heard,
        beacon=str(source),
        bearing_deg=None if bearing_deg is None else round(remainder(bearing_deg, 360), 1) + 0.0,
        elevation_deg=elevation_deg,
        slant_range_m=slant_m,
        valid=fault is None,
        error_code=fault,
    )


def _fault(
    slant_m: float | None, fit: float | None, flags: int, options: SeatracOptions
) -> str | None:
    """Angles without a range are good, and a range without angles."""
    if slant_m is None and fit is None:
        return "no_reply"
    if slant_m == 0:
        return "no_range"
    if fit is not None and fit > options.fit_error_max:
        return "fit_error"
    return "filter" if flags & FILTER_ERROR else None


def _sign(options: SeatracOptions) -> float:
    return 1.0 if options.elevation_positive == "up" else -1.0


def _content(record: UsblRecord, options: SeatracOptions) -> bytes:
    """Four receivers and a good fit, unless the record says otherwise."""
    ranged, seen = b"", b""
    flags = FILTER_ERROR if record.error_code == "filter" else 0
    if record.slant_range_m is not None:
        flags |= RANGE
        ranged = _RANGE.pack(0, 0, round(record.slant_range_m * 10))
    if record.bearing_deg is not None and record.elevation_deg is not None:
        flags |= ANGLES
        fit = options.fit_error_max + 1 if record.error_code == "fit_error" else 0.5
        elevation = round(_sign(options) * record.elevation_deg * 10)
        angles = _ANGLES.pack(round(record.bearing_deg * 10), elevation, round(fit * 100))
        seen = struct.pack("<B4h", 4, 0, 0, 0, 0) + angles
    begin = _BEGIN.pack(0, int(record.beacon), flags, 0, 0, 0, 0, 0, SOUND_DM_S, 0)
    return begin + ranged + seen


SEATRAC = Codec(
    name="seatrac",
    kind="usbl",
    devices="Blueprint Subsea SeaTrac X150, X110: XCVR_FIX, PING_RESP",
    options=SeatracOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=None),
)
