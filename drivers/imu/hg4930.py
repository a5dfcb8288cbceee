"""Honeywell HG4930: control messages at 600 Hz, every sixth of them with increments behind.

Little-endian; the sum of all 16-bit words before the last one is the last one.

======= ========= ================================================================================
bytes   message   content
======= ========= ================================================================================
0       01, 02    0E, the unit's address
1       01, 02    the message: 01 of 20 bytes, 02 of 44
2-7     01, 02    rotation x y z, 3 x i16, 600 * 2^-20 rad/s
8-13    01, 02    acceleration x y z, 3 x i16, 600 * 2^-14 * 0.3048 m/s^2
14-15   01, 02    status 1: bits 0-1 counter, 2-3 test, 4-10 and 15 faults
16-17   01, 02    status 2: bit 9 no data yet, 8 and 10-14 faults; bit 15 clear: bits 0-7 version of
                  the software, set: temperature of an accelerometer i8, degC
18-29   02        angle increments x y z, 3 x i32, 2^-33 rad
30-41   02        velocity increments x y z, 3 x i32, 2^-27 * 0.3048 m/s
======= ========= ================================================================================

The control data are filtered and sampled, the increments sums of all that was measured. A fault bit
is 1.
"""

from struct import Struct

from msgspec import UNSET

from drivers.codec import Codec, Counting, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.sample import Preference, other, out_of_range, plausible, preferred
from drivers.records import ImuRecord, Record, Rejected, Vec3

ADDRESS, CONTROL, INERTIAL = 0x0E, 0x01, 0x02
FAULTS_1, FAULTS_2 = 0x87F0, 0x7D00
NO_DATA, HAS_TEMPERATURE = 1 << 9, 1 << 15
IMU_FAULT = 1 << 15

_RATE = 600 * 2.0**-20
_ACCEL = 600 * 2.0**-14 * 0.3048
_ANGLE = 2.0**-33
_VELOCITY = 2.0**-27 * 0.3048

_BODIES = {CONTROL: Struct("<2x6hHH2x"), INERTIAL: Struct("<2x6hHH6i2x")}
_WORDS = {body.size: Struct(f"<{body.size // 2}H") for body in _BODIES.values()}
_SYNCS = [bytes([ADDRESS, message]) for message in _BODIES]
_STILL = (0,) * 6


class Hg4930Options(Preference, frozen=True):
    """Increments of every sixth message, or rates of each; the others come out as they are."""


def decoder(options: Hg4930Options) -> Decoder:
    """Make a decoder of one unit's stream."""
    increments = options.prefer == "increments"

    def read(frame: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        *words, said = _WORDS[len(frame)].unpack(frame)
        if sum(words) & 0xFFFF != said:
            return None
        values = _BODIES[frame[1]].unpack(frame)
        if values[7] & NO_DATA:
            return other("no data yet", frame, t_rx_ns, line_bytes)
        if increments and frame[1] == CONTROL:
            return other("control message", frame, t_rx_ns, line_bytes)
        gyro_lsb, accel_lsb = (_ANGLE, _VELOCITY) if increments else (_RATE, _ACCEL)
        x, y, z, u, v, w = values[8:] if increments else values[:6]
        gyro = x * gyro_lsb, y * gyro_lsb, z * gyro_lsb
        accel = u * accel_lsb, v * accel_lsb, w * accel_lsb
        if not plausible(gyro, accel):
            return out_of_range(frame, t_rx_ns, line_bytes)
        return (_sample(gyro, accel, values[6], values[7], increments, (t_rx_ns, line_bytes)),)

    return SyncDecoder(_SYNCS, _measure, read)


def encode(record: Record, options: Hg4930Options) -> bytes:
    """Write a sample as message 02 with its increments, or as 01 with its rates.

    What is beyond the range is sent as the end of it.

    Raises
    ------
    ValueError
        If the record carries other quantities than the options say.
    """
    sample, gyro, accel = preferred(record, "hg4930", options.prefer)
    status = 0 if sample.valid else IMU_FAULT
    warm = sample.temperature_c
    status_2 = 0 if warm is None else HAS_TEMPERATURE | _clipped(warm, 8) & 0xFF
    if options.prefer == "increments":
        message = INERTIAL
        counts = [_clipped(value / _ANGLE, 32) for value in gyro]
        counts += [_clipped(value / _VELOCITY, 32) for value in accel]
        frame = bytearray(_BODIES[message].pack(*_STILL, status, status_2, *counts))
    else:
        message = CONTROL
        counts = [_clipped(value / _RATE, 16) for value in gyro]
        counts += [_clipped(value / _ACCEL, 16) for value in accel]
        frame = bytearray(_BODIES[message].pack(*counts, status, status_2))
    frame[0], frame[1] = ADDRESS, message
    frame[-2:] = (sum(_WORDS[len(frame)].unpack(frame)) & 0xFFFF).to_bytes(2, "little")
    return bytes(frame)


def _measure(data: bytes, at: int) -> int | None:
    return _BODIES[data[at + 1]].size if len(data) > at + 1 else None


def _sample(
    gyro: Vec3,
    accel: Vec3,
    status: int,
    status_2: int,
    increments: bool,
    heard: tuple[int, int],
) -> ImuRecord:
    t_rx_ns, line_bytes = heard
    warm = status_2 & 0xFF
    return ImuRecord(
        t_rx_ns=t_rx_ns,
        line_bytes=line_bytes,
        valid=not (status & FAULTS_1 or status_2 & FAULTS_2),
        rate_rad_s=UNSET if increments else gyro,
        delta_angle_rad=gyro if increments else UNSET,
        specific_force_m_s2=UNSET if increments else accel,
        delta_velocity_m_s=accel if increments else UNSET,
        temperature_c=None if not status_2 & HAS_TEMPERATURE else (warm ^ 0x80) - 0x80,
    )


def _clipped(value: float, bits: int) -> int:
    """Counts, at most as many as a field holds."""
    most = 1 << bits - 1
    return max(-most, min(round(value), most - 1))


HG4930 = Codec(
    name="hg4930",
    kind="imu",
    devices="Honeywell HG4930 (600 Hz and 100 Hz, RS-422)",
    options=Hg4930Options,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=None),
)
"""The two bits of counter are not used: they run over within 7 ms."""
