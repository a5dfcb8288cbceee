"""KVH 1725, 1750 and 1775 inertial units: formats A, B, C and the built-in test between them.

All numbers are big-endian. Data frames end in a CRC-32/MPEG-2 over everything before it, test
frames in the sum of all bytes before it modulo 256.

====== ==================== ==================== ====================
byte   A, 36 bytes          B, 40 bytes          C, 38 bytes
====== ==================== ==================== ====================
0-3    FE 81 FF 55          FE 81 FF 56          FE 81 FF 57
4-15   gyro x y z, f32      same                 same
16-27  accel x y z, f32     same                 same
28-31  status, sequence,    time, u32 us         sequence mod 4: 0 temperature,
       temperature i16                           1 2 3 magnetic x y z (gauss), f32
then   CRC                  status, sequence,    status, sequence,
                            temperature i16, CRC CRC
====== ==================== ==================== ====================

Test results: FE 81 00 AA with six bytes of results (11 in all), FE 81 00 AB with eight (13 in all);
a bit of 1 is a test passed, bit 7 is always 0. Status: bits 0-2 gyro and 4-6 accelerometer x y z
valid. Sequence counts 0 to 127. Units are not in the frame: they are options.
"""

from collections.abc import Callable
from math import isfinite
from struct import Struct
from typing import Any, Literal

import msgspec
from msgspec import UNSET

from drivers.checksums import crc32_mpeg2, crc32_mpeg2_holds, sum8
from drivers.codec import Codec, Counting, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.sample import DEG, G0, acceleration, inertial, out_of_range, rotation
from drivers.records import DeviceStatus, ImuRecord, Record, Rejected

RATE_MAX = 1000 * DEG
"""No fibre gyro of the family turns faster (rad/s); its longest interval is 1 s, so the bound holds
for an increment (rad) too. A larger number means other units than the options say."""

ACCEL_MAX = 100 * G0
"""The same for specific force (m/s^2) and velocity increment (m/s)."""

HEADERS = {
    "a": b"\xfe\x81\xff\x55",
    "b": b"\xfe\x81\xff\x56",
    "c": b"\xfe\x81\xff\x57",
}
TEST_SHORT = b"\xfe\x81\x00\xaa"
TEST_LONG = b"\xfe\x81\x00\xab"
_LENGTHS = {HEADERS["a"]: 36, HEADERS["b"]: 40, HEADERS["c"]: 38, TEST_SHORT: 11, TEST_LONG: 13}

_A = Struct(">4x6fBBh4x")
_B = Struct(">4x6fIBBh4x")
_C = Struct(">4x6ffBB4x")
_VALID = 0x77
_MAGNETIC: dict[int, Literal["x", "y", "z"]] = {1: "x", 2: "y", 3: "z"}

_TESTS = {(6, 3): "SR MAG offset", (6, 6): "GCB Y volts"}


class KvhOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Units the unit was set to, which its frames do not say; `format` is used by `encode` only."""

    gyro: Literal["delta_angle_rad", "delta_angle_deg", "rate_rad_s", "rate_deg_s"] = (
        "delta_angle_rad"
    )
    accel: Literal["g", "delta_v_m_s", "delta_v_ft_s"] = "g"
    temperature: Literal["c", "c_100", "f", "f_100"] = "c"
    format: Literal["a", "b", "c"] = "a"

    @property
    def gyro_scale(self) -> float:
        """Size of the wire's gyro unit in rad or rad/s."""
        return DEG if "_deg" in self.gyro else 1.0

    @property
    def accel_scale(self) -> float:
        """Size of the wire's accelerometer unit in m/s^2 or m/s."""
        return {"g": G0, "delta_v_m_s": 1.0, "delta_v_ft_s": 0.3048}[self.accel]

    @property
    def temperature_zero_span(self) -> tuple[float, float]:
        """Wire value at 0 degC and its change for one kelvin."""
        return {"c": (0.0, 1.0), "c_100": (0.0, 100.0), "f": (32.0, 1.8), "f_100": (3200.0, 180.0)}[
            self.temperature
        ]


def decoder(options: KvhOptions) -> Decoder:
    """Make a decoder of one unit's stream."""
    return SyncDecoder((b"\xfe\x81",), _measure, _frame_reader(options))


def encode(record: Record, options: KvhOptions) -> bytes:
    """Write an `ImuRecord` as a frame of ``options.format``, a `DeviceStatus` as a test frame.

    Raises
    ------
    ValueError
        If the record carries other quantities than the options say.
    """
    if isinstance(record, DeviceStatus):
        return _encode_test(record)
    frame = HEADERS[options.format] + _encode_body(inertial(record, "kvh1750"), options)
    return frame + crc32_mpeg2(frame)


def _measure(data: bytes, at: int) -> int | None:
    header = data[at : at + 4]
    return _LENGTHS.get(header, 0 if len(header) == 4 else None)


def _unpack_a(frame: bytes) -> tuple[Any, ...]:
    return *_A.unpack(frame), None


def _unpack_b(frame: bytes) -> tuple[Any, ...]:
    *axes, time_us, status, sequence, temperature = _B.unpack(frame)
    return *axes, status, sequence, temperature, time_us / 1e6


def _unpack_c(frame: bytes) -> tuple[Any, ...]:
    *axes, extra, status, sequence = _C.unpack(frame)
    return *axes, status, sequence, extra, None


_UNPACK = {0x55: _unpack_a, 0x56: _unpack_b, 0x57: _unpack_c}


def _frame_reader(
    options: KvhOptions,
) -> Callable[[bytes, int, int], tuple[Record | Rejected] | None]:
    """Bind the options once: what this gives runs for every frame, at up to 5 kHz."""
    gyro_scale, accel_scale = options.gyro_scale, options.accel_scale
    gyro_bound, accel_bound = (RATE_MAX / gyro_scale) ** 2, (ACCEL_MAX / accel_scale) ** 2
    zero, span = options.temperature_zero_span
    increment, force = options.gyro.startswith("delta_angle"), options.accel == "g"

    def read(frame: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        kind = frame[3]
        if kind not in _UNPACK:
            return _decode_test(frame, t_rx_ns, line_bytes)
        if not crc32_mpeg2_holds(frame):
            return None
        gx, gy, gz, ax, ay, az, status, sequence, extra, time_s = _UNPACK[kind](frame)
        if not (  # so put that NaN and infinity fail too
            gx * gx + gy * gy + gz * gz <= gyro_bound
            and ax * ax + ay * ay + az * az <= accel_bound
            and sequence < 128
            and isfinite(extra)
        ):
            return out_of_range(frame, t_rx_ns, line_bytes)
        gyro = gx * gyro_scale, gy * gyro_scale, gz * gyro_scale
        accel = ax * accel_scale, ay * accel_scale, az * accel_scale
        axis = _MAGNETIC.get(sequence % 4) if kind == 0x57 else None
        record = ImuRecord(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            sequence=sequence,
            t_device_s=time_s,
            valid=status & _VALID == _VALID,
            rate_rad_s=UNSET if increment else gyro,
            delta_angle_rad=gyro if increment else UNSET,
            specific_force_m_s2=accel if force else UNSET,
            delta_velocity_m_s=UNSET if force else accel,
            temperature_c=None if axis else (extra - zero) / span,
            magnetic_gauss=(axis, extra) if axis else UNSET,
        )
        return (record,)

    return read


def _encode_body(record: ImuRecord, options: KvhOptions) -> bytes:
    """What stands between header and CRC."""
    gyro = rotation(record, increment=options.gyro.startswith("delta_angle"))
    accel = acceleration(record, increment=options.accel != "g")
    axes = [value / options.gyro_scale for value in gyro]
    axes += [value / options.accel_scale for value in accel]
    status = _VALID if record.valid else 0
    sequence = (record.sequence or 0) % 128
    zero, span = options.temperature_zero_span
    temperature = (record.temperature_c or 0.0) * span + zero
    if options.format == "a":
        frame = _A.pack(*axes, status, sequence, round(temperature))
    elif options.format == "b":
        time_us = round((record.t_device_s or 0.0) * 1e6) % 2**32
        frame = _B.pack(*axes, time_us, status, sequence, round(temperature))
    else:
        magnetic = record.magnetic_gauss[1] if record.magnetic_gauss else 0.0
        frame = _C.pack(*axes, magnetic if sequence % 4 else temperature, status, sequence)
    return frame[4:-4]


def _test_name(byte: int, bit: int) -> str:
    return _TESTS.get((byte, bit), f"byte {byte} bit {bit}")


def _decode_test(
    frame: bytes, t_rx_ns: int, line_bytes: int
) -> tuple[DeviceStatus | Rejected] | None:
    results = frame[4:-1]
    if sum8(frame[:-1]) != frame[-1]:
        return None
    if any(result & 0x80 for result in results):
        return out_of_range(frame, t_rx_ns, line_bytes)
    failed = tuple(
        _test_name(byte, bit)
        for byte, result in enumerate(results)
        for bit in range(7)
        if not result >> bit & 1
    )
    status = DeviceStatus(t_rx_ns=t_rx_ns, line_bytes=line_bytes, healthy=not failed, failed=failed)
    return (status,)


def _encode_test(status: DeviceStatus) -> bytes:
    places = {_test_name(byte, bit): (byte, bit) for byte in range(8) for bit in range(7)}
    unknown = [name for name in status.failed if name not in places]
    if unknown:
        raise ValueError(f"kvh1750 has no test called {', '.join(unknown)}")
    results = bytearray(b"\x7f" * 8)
    for byte, bit in map(places.__getitem__, status.failed):
        results[byte] &= ~(1 << bit)
    is_long = results[6:] != b"\x7f\x7f"
    frame = TEST_LONG + results if is_long else TEST_SHORT + results[:6]
    return bytes(frame) + bytes([sum8(frame)])


KVH1750 = Codec(
    name="kvh1750",
    kind="imu",
    devices="KVH 1725, 1750, 1775 (formats A, B, C and built-in test)",
    options=KvhOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(sequence_modulus=128, time_modulus_s=2**32 * 1e-6),
)
