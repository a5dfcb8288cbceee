"""Xsens Xbus: the MTData2 messages of MTi units.

FA FF, message id u8, length u8 (FF: a u16 follows), data, and a byte that makes the sum of all
from the second on 0 modulo 256. Big-endian. MTData2 is message 36: items of an id u16, a length u8
and content. The last hex digit of an item's id says the number format (0 f32, 1 fixed 12.20 i32,
2 fixed 16.32 as u32 fraction, i16, 3 f64) and the frame, which raw data do not depend on.

====== =====================================================================================
1020   packet counter u16
1060   time of the sample u32, 10 000 a second
0810   temperature (degC)
4010   velocity increment x y z (m/s)
4020   acceleration x y z (m/s^2)
8020   rate of turn x y z (rad/s)
8030   orientation increment, a quaternion
E020   status u32: bits 8-10 accelerometers, 11-13 gyros x y z clipped
====== =====================================================================================
"""

from math import atan2, cos, hypot, sin
from struct import Struct

from msgspec import UNSET, UnsetType

from drivers.codec import Codec, Counting, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.sample import (
    ZERO,
    Prefer,
    Preference,
    other,
    out_of_range,
    plausible,
    preferred,
)
from drivers.records import ImuRecord, Record, Rejected, Vec3

PREAMBLE = b"\xfa\xff"
MTDATA2 = 0x36
LONG = 0xFF
DATA_MAX = 2048
CLIPPED = 0x3F00
TICK_S = 1e-4

COUNTER, TIME, TEMPERATURE, STATUS = 0x1020, 0x1060, 0x0810, 0xE020
DELTA_V, ACCEL, GYRO, DELTA_Q = 0x4010, 0x4020, 0x8020, 0x8030

_NUMBERS = [
    {size: Struct(f">{size}{kind}") for size in (1, 3, 4)} for kind in ("f", "i", "Ih", "d")
]
_NUMBERS[2] = {size: Struct(">" + size * "Ih") for size in (1, 3, 4)}
_COUNTS = {TEMPERATURE: 1, DELTA_V: 3, ACCEL: 3, GYRO: 3, DELTA_Q: 4}
_INTEGERS = {COUNTER: 2, TIME: 4, STATUS: 4}
_SIZES = {
    **_INTEGERS,
    **{
        kind | digit: _NUMBERS[digit & 3][count].size
        for kind, count in _COUNTS.items()
        for digit in range(16)
    },
}
"""Bytes of each item that is looked at, by its id with its format."""

Items = dict[int, tuple[int, int]]
"""Of each kind of item: the whole id, and where its content stands."""


def decoder(options: Preference) -> Decoder:
    """Make a decoder of one unit's stream."""
    order = _ORDERS[options.prefer]

    def read(message: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        if (sum(message) - message[0]) & 0xFF:
            return None
        if message[2] != MTDATA2:
            return other(f"message {message[2]:02X}", message, t_rx_ns, line_bytes)
        items = _items(message)
        if items is None:
            return (
                Rejected(t_rx_ns=t_rx_ns, line_bytes=line_bytes, reason="syntax", data=message),
            )
        return _sample(message, items, order, t_rx_ns, line_bytes)

    return SyncDecoder((PREAMBLE,), _measure, read)


def encode(record: Record, options: Preference) -> bytes:
    """Write an `ImuRecord` as MTData2 in f32.

    Raises
    ------
    ValueError
        If the record carries other quantities than the options say.
    """
    sample, gyro, accel = preferred(record, "xsens-mtdata2", options.prefer)
    increments = options.prefer == "increments"
    data = b""
    if sample.sequence is not None:
        data += _item(COUNTER, (sample.sequence % 2**16).to_bytes(2, "big"))
    if sample.t_device_s is not None:
        data += _item(TIME, (round(sample.t_device_s / TICK_S) % 2**32).to_bytes(4, "big"))
    if sample.temperature_c is not None:
        data += _item(TEMPERATURE, _NUMBERS[0][1].pack(sample.temperature_c))
    data += _item(DELTA_V if increments else ACCEL, _NUMBERS[0][3].pack(*accel))
    if increments:
        data += _item(DELTA_Q, _NUMBERS[0][4].pack(*_quaternion(gyro)))
    else:
        data += _item(GYRO, _NUMBERS[0][3].pack(*gyro))
    data += _item(STATUS, (0 if sample.valid else CLIPPED).to_bytes(4, "big"))
    body = PREAMBLE[1:] + bytes([MTDATA2, len(data)]) + data
    return PREAMBLE[:1] + body + bytes([-sum(body) & 0xFF])


def _measure(data: bytes, at: int) -> int | None:
    if len(data) < at + 4:
        return None
    if data[at + 3] != LONG:
        return data[at + 3] + 5
    if len(data) < at + 6:
        return None
    length = data[at + 4] << 8 | data[at + 5]
    return length + 7 if length <= DATA_MAX else 0


def _items(message: bytes) -> Items | None:
    """Where each item stands; None if they do not fill the message or one is of a wrong size."""
    at, end = (6 if message[3] == LONG else 4), len(message) - 1
    items: Items = {}
    while at + 3 <= end:
        identifier, length = message[at] << 8 | message[at + 1], message[at + 2]
        if _SIZES.get(identifier, length) != length:
            return None
        items[identifier & 0xFFF0] = identifier, at + 3
        at += 3 + length
    return items if at == end else None


_ORDERS: dict[Prefer, tuple[tuple[int, int], tuple[int, int]]] = {
    "increments": ((DELTA_Q, GYRO), (DELTA_V, ACCEL)),
    "rates": ((GYRO, DELTA_Q), (ACCEL, DELTA_V)),
}


def _numbers(message: bytes, item: tuple[int, int], count: int) -> tuple[float, ...]:
    """The numbers of an item, in whichever format it has."""
    identifier, at = item
    kind = identifier & 3
    raw = _NUMBERS[kind][count].unpack_from(message, at)
    if kind == 1:
        return tuple(value / 2**20 for value in raw)
    if kind == 2:
        return tuple(whole + part / 2**32 for part, whole in zip(raw[::2], raw[1::2], strict=True))
    return raw


def _sample(
    message: bytes,
    items: Items,
    order: tuple[tuple[int, int], tuple[int, int]],
    t_rx_ns: int,
    line_bytes: int,
) -> tuple[Record | Rejected]:
    (turning, turning_else), (moving, moving_else) = order
    if turning not in items:
        turning = turning_else if turning_else in items else 0
    if moving not in items:
        moving = moving_else if moving_else in items else 0
    if not (turning or moving):
        return other("MTData2 without inertial data", message, t_rx_ns, line_bytes)
    gyro: Vec3 | UnsetType = UNSET
    accel: Vec3 | UnsetType = UNSET
    if turning == DELTA_Q:
        gyro = _rotation_vector(*_numbers(message, items[DELTA_Q], 4))
    elif turning:
        x, y, z = _numbers(message, items[GYRO], 3)
        gyro = x, y, z
    if moving:
        x, y, z = _numbers(message, items[moving], 3)
        accel = x, y, z
    warm = _numbers(message, items[TEMPERATURE], 1)[0] if TEMPERATURE in items else None
    if not plausible(gyro or ZERO, accel or ZERO, warm):
        return out_of_range(message, t_rx_ns, line_bytes)
    counter, ticks = _integer(message, items, COUNTER), _integer(message, items, TIME)
    status = _integer(message, items, STATUS)
    record = ImuRecord(
        t_rx_ns=t_rx_ns,
        line_bytes=line_bytes,
        sequence=counter,
        t_device_s=None if ticks is None else ticks * TICK_S,
        valid=bool(gyro and accel) and not (status or 0) & CLIPPED,
        rate_rad_s=gyro if turning == GYRO else UNSET,
        delta_angle_rad=gyro if turning == DELTA_Q else UNSET,
        specific_force_m_s2=accel if moving == ACCEL else UNSET,
        delta_velocity_m_s=accel if moving == DELTA_V else UNSET,
        temperature_c=warm,
    )
    return (record,)


def _integer(message: bytes, items: Items, kind: int) -> int | None:
    if kind not in items:
        return None
    _, at = items[kind]
    return int.from_bytes(message[at : at + _INTEGERS[kind]], "big")


def _rotation_vector(w: float, x: float, y: float, z: float) -> Vec3:
    """Rotation vector (rad) of an orientation increment."""
    length = hypot(x, y, z)
    angle = 2 * atan2(length, w)
    k = angle / length if length > 0 else 2.0
    return k * x, k * y, k * z


def _quaternion(angle: Vec3) -> tuple[float, float, float, float]:
    half = hypot(*angle) / 2
    k = sin(half) / half / 2 if half > 0 else 0.5
    x, y, z = angle
    return cos(half), k * x, k * y, k * z


def _item(identifier: int, content: bytes) -> bytes:
    return identifier.to_bytes(2, "big") + bytes([len(content)]) + content


XSENS_MTDATA2 = Codec(
    name="xsens-mtdata2",
    kind="imu",
    devices="Xsens (Movella) MTi, MTi-G, Sirius, Avior (MTData2)",
    options=Preference,
    decoder=decoder,
    encode=encode,
    counting=Counting(sequence_modulus=2**16, time_modulus_s=2**32 * TICK_S),
)
