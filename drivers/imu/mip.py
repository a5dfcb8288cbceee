"""MicroStrain (LORD, HBK) MIP: sensor data packets.

Big-endian: 75 65, descriptor set u8, length of the fields u8, fields, two Fletcher bytes over all
before them. A field is its length u8 (with these two bytes), a descriptor u8 and its content. Of
set 80 (sensor data) and the fields all sets share are used:

==== ==========================================================================
04   acceleration x y z (g), 3 x f32
05   rotation x y z (rad/s), 3 x f32
07   angle increment x y z (rad), 3 x f32
08   velocity increment x y z (g s), 3 x f32
14   temperature least, greatest, mean (degC), 3 x f32
18   overrange u16: bits 0-2 accelerometers, 4-6 gyros x y z
D3   GPS time: seconds of week f64, week u16, flags u16
D5   reference time u64 (ns), never set, never jumping
D6   the same since the sample before, u64 (ns)
==== ==========================================================================
"""

from struct import Struct

from msgspec import UNSET, UnsetType

from drivers.checksums import fletcher8
from drivers.codec import Codec, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.sample import (
    G0,
    ZERO,
    Preference,
    other,
    out_of_range,
    plausible,
    preferred,
)
from drivers.records import ImuRecord, Record, Rejected, Vec3

SYNC = b"\x75\x65"
SENSOR_DATA = 0x80
ACCEL, GYRO, DELTA_ANGLE, DELTA_VELOCITY = 0x04, 0x05, 0x07, 0x08
TEMPERATURE, OVERRANGE, GPS_TIME, REFERENCE, REFERENCE_STEP = 0x14, 0x18, 0xD3, 0xD5, 0xD6
OVERRANGE_INERTIAL = 0x77
WEEK_S = 604800

_LENGTHS = {
    ACCEL: 14,
    GYRO: 14,
    DELTA_ANGLE: 14,
    DELTA_VELOCITY: 14,
    TEMPERATURE: 14,
    OVERRANGE: 4,
    GPS_TIME: 14,
    REFERENCE: 10,
    REFERENCE_STEP: 10,
}
_VECTOR = Struct(">3f")
_GPS = Struct(">dHH")


def decoder(options: Preference) -> Decoder:
    """Make a decoder of one unit's stream."""
    prefers_rates = options.prefer == "rates"

    def read(packet: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        if fletcher8(packet[:-2]) != packet[-2:]:
            return None
        if packet[2] != SENSOR_DATA:
            return other(f"set {packet[2]:02X}", packet, t_rx_ns, line_bytes)
        places = _places(packet)
        if places is None:
            return (Rejected(t_rx_ns=t_rx_ns, line_bytes=line_bytes, reason="syntax", data=packet),)
        return _sample(packet, places, prefers_rates, t_rx_ns, line_bytes)

    return SyncDecoder((SYNC,), _measure, read)


def encode(record: Record, options: Preference) -> bytes:
    """Write an `ImuRecord` as a packet of sensor data.

    Raises
    ------
    ValueError
        If the record carries other quantities than the options say.
    """
    sample, gyro, accel = preferred(record, "mip", options.prefer)
    increments = options.prefer == "increments"
    fields = b""
    if sample.t_device_s is not None:
        fields += _field(REFERENCE, round(sample.t_device_s * 1e9).to_bytes(8, "big"))
    if sample.interval_s is not UNSET:
        fields += _field(REFERENCE_STEP, round(sample.interval_s * 1e9).to_bytes(8, "big"))
    in_g = [value / G0 for value in accel]
    fields += _field(DELTA_VELOCITY if increments else ACCEL, _VECTOR.pack(*in_g))
    fields += _field(DELTA_ANGLE if increments else GYRO, _VECTOR.pack(*gyro))
    if sample.temperature_c is not None:
        fields += _field(TEMPERATURE, _VECTOR.pack(*3 * (sample.temperature_c,)))
    if not sample.valid:
        fields += _field(OVERRANGE, OVERRANGE_INERTIAL.to_bytes(2, "big"))
    packet = SYNC + bytes([SENSOR_DATA, len(fields)]) + fields
    return packet + fletcher8(packet)


def _measure(data: bytes, at: int) -> int | None:
    return data[at + 3] + 6 if len(data) > at + 3 else None


def _places(packet: bytes) -> dict[int, int] | None:
    """Where the content of each field stands; None if the fields do not fill the packet."""
    at, end, places = 4, len(packet) - 2, {}
    while at < end:
        length, descriptor = packet[at], packet[at + 1]
        if length < 2 or length != _LENGTHS.get(descriptor, length):
            return None
        places[descriptor] = at + 2
        at += length
    return places if at == end else None


def _sample(
    packet: bytes, places: dict[int, int], prefers_rates: bool, t_rx_ns: int, line_bytes: int
) -> tuple[Record | Rejected]:
    gyro_at, angle_at = places.get(GYRO), places.get(DELTA_ANGLE)
    accel_at, velocity_at = places.get(ACCEL), places.get(DELTA_VELOCITY)
    if gyro_at is not None and angle_at is not None:
        gyro_at, angle_at = (gyro_at, None) if prefers_rates else (None, angle_at)
    if accel_at is not None and velocity_at is not None:
        accel_at, velocity_at = (accel_at, None) if prefers_rates else (None, velocity_at)
    gyro, angle = _vector(packet, gyro_at, 1.0), _vector(packet, angle_at, 1.0)
    accel, velocity = _vector(packet, accel_at, G0), _vector(packet, velocity_at, G0)
    turned, moved = gyro or angle, accel or velocity
    if not (turned or moved):
        return other("sensor data without inertial", packet, t_rx_ns, line_bytes)
    warm_at = places.get(TEMPERATURE)
    warm = None if warm_at is None else _VECTOR.unpack_from(packet, warm_at)[2]
    if not plausible(turned or ZERO, moved or ZERO, warm):
        return out_of_range(packet, t_rx_ns, line_bytes)
    step, over = places.get(REFERENCE_STEP), places.get(OVERRANGE)
    record = ImuRecord(
        t_rx_ns=t_rx_ns,
        line_bytes=line_bytes,
        t_device_s=_time_s(packet, places),
        valid=bool(turned and moved) and not (over and packet[over + 1] & OVERRANGE_INERTIAL),
        rate_rad_s=gyro,
        delta_angle_rad=angle,
        specific_force_m_s2=accel,
        delta_velocity_m_s=velocity,
        interval_s=int.from_bytes(packet[step : step + 8], "big") * 1e-9 if step else UNSET,
        temperature_c=warm,
    )
    return (record,)


def _vector(packet: bytes, at: int | None, unit: float) -> Vec3 | UnsetType:
    if at is None:
        return UNSET
    x, y, z = _VECTOR.unpack_from(packet, at)
    return x * unit, y * unit, z * unit


def _time_s(packet: bytes, places: dict[int, int]) -> float | None:
    """Reference time, else that of GPS since its beginning."""
    at = places.get(REFERENCE)
    if at is not None:
        return int.from_bytes(packet[at : at + 8], "big") * 1e-9
    at = places.get(GPS_TIME)
    if at is None:
        return None
    seconds, week, _ = _GPS.unpack_from(packet, at)
    t_s = week * WEEK_S + seconds
    return t_s if 0 <= seconds <= WEEK_S else None


def _field(descriptor: int, content: bytes) -> bytes:
    return bytes([len(content) + 2, descriptor]) + content


MIP = Codec(
    name="mip",
    kind="imu",
    devices="MicroStrain 3DM-GX, -CX, -CV, -GQ (MIP sensor data)",
    options=Preference,
    decoder=decoder,
    encode=encode,
)
