"""Teledyne RDI PD0, the binary format of ADCPs and Doppler logs: its bottom track.

Numbers are little-endian. An ensemble is a header, data types in any order, and the sum of all
bytes before it modulo 65536.

======= ==========================================================================================
byte    header
======= ==========================================================================================
0-1     7F 7F
2-3     bytes of the ensemble without the sum, u16
5       n, the number of data types
6-      n offsets of the data types, u16
======= ==========================================================================================

======= ======= ==================================================================================
type    byte    what is read of it
======= ======= ==================================================================================
0000 h  4-5     system: bit 3 convex, bit 7 up-facing, bits 8-9 beam angle 15, 20, 30 deg, other
fixed   25      bits 3-4 coordinates: beam, instrument, ship, Earth; bit 2 tilts used
leader  58      beam angle (deg), where the type is that long
0080 h  4-10    year, month, day, hour, minute, second, 1/100 s of the ping
var.    14-15   speed of sound used (m/s), u16
0600 h  16-23   vertical range of each of four beams (cm), u16, 0 is none; 77-80 its third byte
bottom  24-31   velocity of four beams, or X, Y, Z, error (mm/s), i16, 8000 h is bad
2013 h  53-68   since each beam's ping met the bottom until the ensemble's first byte (us), u32
======= ======= ==================================================================================

PD0 takes the log to be at rest and **the bottom to be moving**: with beam 3 forward, X to
starboard, Y forward and Z up, the log's own velocity is the negative of what stands there.
"""

from math import cos, radians, sin, sqrt
from struct import Struct
from typing import Annotated

import msgspec
from msgspec import UNSET, Meta, UnsetType

from drivers.codec import Codec, Decoder
from drivers.fields import unix_date, unix_day
from drivers.framing import SyncDecoder, UnreadableError
from drivers.records import Axes, DvlRecord, OtherFrame, Record, Rejected, Vec3
from drivers.sentences import Heard

SYNC = b"\x7f\x7f"
LONGEST = 8192
"""Bytes of the longest ensemble that is waited for: 128 cells of four beams take 3 kB."""
TYPES_MAX = 40
CENTURY = 2000
BAD = -32768
MM, CM, MICRO = 1e-3, 1e-2, 1e-6
AGE_MAX_S = 60.0
FIXED, VARIABLE, BOTTOM, NAVIGATION = 0x0000, 0x0080, 0x0600, 0x2013
BEAM, INSTRUMENT, SHIP, EARTH = range(4)
ANGLES_DEG = (15.0, 20.0, 30.0)
CONVEX, UP_FACING, TILTS_USED = 0x08, 0x80, 0x04

_U16 = Struct("<H")
_BOTTOM = Struct("<16x4H4h45x4B")
_AGES = Struct("<53x4I")
LEAST = {FIXED: 26, VARIABLE: 16, BOTTOM: 77}
"""Bytes of each data type up to the last that must be there."""


class Pd0Options(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The angle of the beams from the axis, where the ensemble calls it another than usual."""

    beam_angle_deg: Annotated[float, Meta(gt=0, lt=90)] | None = None


def decoder(options: Pd0Options) -> Decoder:
    """Make a decoder of ensembles."""

    def decode(frame: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        if sum(frame[:-2]) & 0xFFFF != _U16.unpack_from(frame, len(frame) - 2)[0]:
            return None
        heard: Heard = {"t_rx_ns": t_rx_ns, "line_bytes": line_bytes}
        types = _data_types(frame)
        if not LEAST.keys() <= types.keys():
            return (OtherFrame(**heard, name="no bottom track", data=frame),)
        if any(len(types[name]) < least for name, least in LEAST.items()):
            return (Rejected(**heard, reason="length", data=frame),)
        weights = _beam_weights(types[FIXED], options)
        if weights is None:
            return (Rejected(**heard, reason="range", data=frame),)
        return (_record(types, weights, heard),)

    return SyncDecoder((SYNC,), _measure, decode)


def encode(record: Record, _options: Pd0Options) -> bytes:
    """Write a `DvlRecord`: in instrument, ship's or Earth coordinates by its axes."""
    if not isinstance(record, DvlRecord):
        raise ValueError(f"pd0 cannot say a {type(record).__name__}")
    types = [_fixed_leader(record), _variable_leader(record), _bottom_track(record)]
    if record.age_s is not UNSET:
        age_us = round(record.age_s / MICRO)
        types.append(_U16.pack(NAVIGATION) + bytes(51) + Struct("<4I").pack(*[age_us] * 4))
    table = 6 + 2 * len(types)
    offsets = [table + sum(map(len, types[:k])) for k in range(len(types))]
    size = table + sum(map(len, types))
    head = SYNC + Struct(f"<HBB{len(types)}H").pack(size, 0, len(types), *offsets)
    ensemble = head + b"".join(types)
    return ensemble + _U16.pack(sum(ensemble) & 0xFFFF)


def _measure(data: bytes, at: int) -> int | None:
    """Length of an ensemble; what cannot be a header costs no waiting for its declared length."""
    if not data.startswith(SYNC[: len(data) - at], at):
        return 0
    if len(data) - at < 6:
        return None
    length = _U16.unpack_from(data, at + 2)[0] + 2
    table = 6 + 2 * data[at + 5]
    if not (0 < data[at + 5] <= TYPES_MAX and table + 2 < length <= LONGEST):
        return 0
    if len(data) - at < table:
        return None
    offsets = [_U16.unpack_from(data, at + k)[0] for k in range(6, table, 2)]
    return length if min(offsets) >= table and max(offsets) <= length - 4 else 0


def _data_types(frame: bytes) -> dict[int, bytes]:
    """The data types by their identity, each up to the end of the ensemble or the next one."""
    starts = [_U16.unpack_from(frame, 6 + 2 * k)[0] for k in range(frame[5])]
    ends = [min((s for s in starts if s > start), default=len(frame) - 2) for start in starts]
    return {
        _U16.unpack_from(frame, start)[0]: frame[start:end]
        for start, end in zip(starts, ends, strict=True)
    }


def _record(types: dict[int, bytes], weights: Vec3, heard: Heard) -> DvlRecord:
    fixed, variable = types[FIXED], types[VARIABLE]
    values = _BOTTOM.unpack(types[BOTTOM][:81].ljust(81, b"\0"))
    coordinates = fixed[25] >> 3 & 3
    moving, error = _bottom(values[4:8], weights, coordinates)
    up_facing = coordinates in (BEAM, INSTRUMENT) and fixed[4] & UP_FACING
    fault = "up_facing" if up_facing else "no_lock" if moving is None else None
    return DvlRecord(
        **heard,
        age_s=_age_s(fixed, types.get(NAVIGATION, b"")),
        velocity_m_s=None if fault or moving is None else _turned(moving),
        axes=_axes(coordinates, bool(fixed[25] & TILTS_USED)),
        t_device_s=_time(variable),
        valid=fault is None,
        error_code=fault,
        altitude_m=_altitude(values[:4], values[8:]),
        error_velocity_m_s=UNSET if error is None else error,
        sound_speed_m_s=float(_U16.unpack_from(variable, 14)[0]),
    )


def _axes(coordinates: int, tilts_used: bool) -> Axes:
    """Ship's coordinates are the log's own, turned by its alignment, unless tilts are in them."""
    if coordinates == EARTH:
        return "north"
    return "level" if coordinates == SHIP and tilts_used else "sensor"


def _beam_weights(fixed: bytes, options: Pd0Options) -> Vec3 | None:
    """Weights of a beam in X or Y, in Z, and in the error velocity; None without their angle."""
    angle_deg, named = options.beam_angle_deg or 0.0, fixed[5] & 3
    if not angle_deg and named < len(ANGLES_DEG):
        angle_deg = ANGLES_DEG[named]
    elif not angle_deg and len(fixed) > 58:
        angle_deg = float(fixed[58])
    if not 0.0 < angle_deg < 90.0:
        return None
    across = 0.5 / sin(radians(angle_deg)) * (1.0 if fixed[4] & CONVEX else -1.0)
    return across, 0.25 / cos(radians(angle_deg)), abs(across) / sqrt(2.0)


def _bottom(
    said: tuple[int, ...], weights: Vec3, coordinates: int
) -> tuple[Vec3 | None, float | None]:
    """The bottom's X, Y, Z (m/s), and the error velocity; None for what could not be measured.

    Three good beams are enough: the fourth is what makes the error zero.
    """
    v = [None if value == BAD else value * MM for value in said]
    if coordinates != BEAM:
        x, y, z, error = v
        return (None if x is None or y is None or z is None else (x, y, z)), error
    bad = [k for k in range(4) if v[k] is None]
    if len(bad) > 1:
        return None, None
    b = [value or 0.0 for value in v]
    if bad:
        opposite, others = bad[0] ^ 1, b[2:] if bad[0] < 2 else b[:2]
        b[bad[0]] = sum(others) - b[opposite]
    across, up, doubt = weights
    xyz = across * (b[0] - b[1]), across * (b[3] - b[2]), up * sum(b)
    return xyz, None if bad else doubt * (b[0] + b[1] - b[2] - b[3])


def _turned(xyz: Vec3) -> Vec3:
    """The bottom's starboard, forward, up as the log's forward, starboard, down; and back.

    East, north, up becomes north, east, down alike.
    """
    x, y, z = xyz
    return -y, -x, z


def _altitude(ranges: tuple[int, ...], thirds: tuple[int, ...]) -> float | None:
    """Mean of the beams' ranges that found the bottom (m)."""
    found = [low + 65536 * high for low, high in zip(ranges, thirds, strict=True) if low or high]
    return sum(found) / len(found) * CM if found else None


def _age_s(fixed: bytes, navigation: bytes) -> float | UnsetType:
    """How old the bottom track was; a triggered log counts from its trigger instead."""
    triggered = len(fixed) <= 39 or fixed[39]
    if triggered or len(navigation) < _AGES.size:
        return UNSET
    ages = [age for age in _AGES.unpack_from(navigation) if 0 < age * MICRO < AGE_MAX_S]
    return sum(ages) / len(ages) * MICRO if ages else UNSET


def _time(variable: bytes) -> float | None:
    """Unix time of the ping by the log's clock, taken as UTC; None where that was never set."""
    year, month, day, hour, minute, second, cs = variable[4:11]
    try:
        midnight = unix_day(CENTURY + year, month, day)
    except UnreadableError:
        return None
    return midnight + 3600 * hour + 60 * minute + second + cs / 100


def _fixed_leader(record: DvlRecord) -> bytes:
    """Convex beams of 30 degrees at 600 kHz, facing down."""
    coordinates = {"sensor": INSTRUMENT << 3, "level": SHIP << 3 | TILTS_USED, "north": EARTH << 3}
    fixed = bytearray(59)
    fixed[4:6], fixed[8], fixed[25], fixed[58] = b"\x4b\x42", 4, coordinates[record.axes], 30
    return bytes(fixed)


def _variable_leader(record: DvlRecord) -> bytes:
    speed = 1500.0 if record.sound_speed_m_s is UNSET else record.sound_speed_m_s
    when = bytes(7)
    if record.t_device_s is not None:
        days, cs = divmod(round(record.t_device_s * 100), 8_640_000)
        day, seconds = unix_date(days), cs // 100
        clock = (seconds // 3600, seconds // 60 % 60, seconds % 60, cs % 100)
        when = bytes((day.year % 100, day.month, day.day, *clock))
    return _U16.pack(VARIABLE) + bytes(2) + when + bytes(3) + _U16.pack(round(speed)) + bytes(44)


def _bottom_track(record: DvlRecord) -> bytes:
    velocity = [BAD] * 4
    if record.velocity_m_s is not None:
        velocity[:3] = [round(v / MM) for v in _turned(record.velocity_m_s)]
        error = record.error_velocity_m_s
        velocity[3] = BAD if error is UNSET else round(error / MM)
    range_cm = round((record.altitude_m or 0.0) / CM)
    low, high = [range_cm % 65536] * 4, [range_cm // 65536] * 4
    return _U16.pack(BOTTOM) + _BOTTOM.pack(*low, *velocity, *high)[2:]


PD0 = Codec(
    name="pd0",
    kind="dvl",
    devices="Teledyne RDI Doppler logs and ADCPs with bottom track in PD0",
    options=Pd0Options,
    decoder=decoder,
    encode=encode,
)
