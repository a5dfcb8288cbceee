"""SBG Systems sbgECom: the asynchronous inertial log of Ellipse, Ekinox, Apogee and Pulse units.

Little-endian: FF 5A, message u8, class u8, length u16, data, CRC-16/KERMIT u16 over message to
data, 33. LOG_IMU_SHORT is message 44 of class 0, 32 bytes of data:

======= =========================================================================
0-3     time since power-up u32 (us)
4-5     status u16: bits 0 communication, 1 built-in test, 2-4 accelerometers x y z, 5-7 gyros
        x y z, 8 accelerometers and 9 gyros within range (1 is well), 10 high scale of the gyros
6-17    acceleration x y z i32, 2^20 = 1 m/s^2
18-29   rotation x y z i32, 2^26 = 1 rad/s, or 12304174 with the high scale
30-31   temperature i16, 256 = 1 degC
======= =========================================================================
"""

from struct import Struct

from drivers.checksums import crc16_kermit
from drivers.codec import Codec, Counting, Decoder, NoOptions
from drivers.framing import SyncDecoder
from drivers.imu.sample import (
    other,
    out_of_range,
    plausible,
    preferred,
)
from drivers.records import ImuRecord, Record, Rejected

SYNC, END = b"\xff\x5a", 0x33
DATA_MAX = 4086
IMU_SHORT = (44, 0)
WELL = 0x3FF
HIGH_SCALE = 1 << 10

_ACCEL = 2.0**-20
_GYRO = 2.0**-26
_GYRO_HIGH = 1 / 12304174
_BODY = Struct("<6xIH6ih")
_FRAME_LENGTH = 41


def decoder(options: NoOptions) -> Decoder:
    """Make a decoder of one unit's stream."""
    return SyncDecoder((SYNC,), _measure, _read)


def encode(record: Record, options: NoOptions) -> bytes:
    """Write an `ImuRecord` as LOG_IMU_SHORT.

    Raises
    ------
    ValueError
        If the record does not carry rate and specific force.
    """
    sample, gyro, accel = preferred(record, "sbg-ecom", "rates")
    is_fast = max(map(abs, gyro)) >= 2**31 * _GYRO
    gyro_lsb = _GYRO_HIGH if is_fast else _GYRO
    body = _BODY.pack(
        round((sample.t_device_s or 0.0) * 1e6) % 2**32,
        (WELL if sample.valid else 0) | HIGH_SCALE * is_fast,
        *(round(value / _ACCEL) for value in accel),
        *(round(value / gyro_lsb) for value in gyro),
        round((sample.temperature_c or 0.0) * 256),
    )
    checked = bytes(IMU_SHORT) + (len(body) - 6).to_bytes(2, "little") + body[6:]
    return SYNC + checked + crc16_kermit(checked).to_bytes(2, "little") + bytes([END])


def _measure(data: bytes, at: int) -> int | None:
    if len(data) < at + 6:
        return None
    length = data[at + 4] | data[at + 5] << 8
    return length + 9 if length <= DATA_MAX else 0


def _read(frame: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
    if frame[-1] != END or crc16_kermit(frame[2:-3]) != frame[-3] | frame[-2] << 8:
        return None
    if (frame[2], frame[3]) != IMU_SHORT or len(frame) != _FRAME_LENGTH:
        return other(f"class {frame[3]} message {frame[2]}", frame, t_rx_ns, line_bytes)
    time_us, status, ax, ay, az, gx, gy, gz, temperature = _BODY.unpack_from(frame)
    lsb = _GYRO_HIGH if status & HIGH_SCALE else _GYRO
    gyro = gx * lsb, gy * lsb, gz * lsb
    accel = ax * _ACCEL, ay * _ACCEL, az * _ACCEL
    if not plausible(gyro, accel):
        return out_of_range(frame, t_rx_ns, line_bytes)
    record = ImuRecord(
        t_rx_ns=t_rx_ns,
        line_bytes=line_bytes,
        t_device_s=time_us * 1e-6,
        valid=status & WELL == WELL,
        rate_rad_s=gyro,
        specific_force_m_s2=accel,
        temperature_c=temperature / 256,
    )
    return (record,)


SBG_ECOM = Codec(
    name="sbg-ecom",
    kind="imu",
    devices="SBG Systems Ellipse, Ekinox, Apogee, Navsight, Pulse (sbgECom LOG_IMU_SHORT)",
    options=NoOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_modulus_s=2**32 * 1e-6),
)
