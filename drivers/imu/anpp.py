"""Advanced Navigation Packet Protocol: raw sensors, with the time of the packets around them.

A packet has no sync word: a check byte that makes the sum of the five header bytes 0 modulo 256,
id u8, length u8, CRC-16/CCITT-FALSE u16 over the payload, then the payload, all little-endian.

======= ====== ==============================================================================
id      length payload
======= ====== ==============================================================================
28      48     acceleration x y z (m/s^2), rotation x y z (rad/s), magnetic field x y z (mG),
               temperature (degC), pressure (Pa), its temperature: 12 x f32
20      100    system status u16, filter status u16 (bit 3: UTC known), Unix time u32 s, u32 us, ...
21      8      Unix time u32 s, u32 us
49      8      time since power-up u32 s, u32 us
======= ====== ==============================================================================
"""

from struct import Struct
from typing import Literal

import msgspec

from drivers.checksums import crc16_ccitt_false
from drivers.codec import Codec, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.sample import (
    other,
    out_of_range,
    plausible,
    preferred,
)
from drivers.records import ImuRecord, Record, Rejected, TimeRecord

HEADER = 5
SYSTEM_STATE, UNIX_TIME, RAW_SENSORS, RUNNING_TIME = 20, 21, 28, 49
UTC_KNOWN = 1 << 3
UNIX_MIN_S = 1_000_000_000
"""An earlier Unix time is that of a unit which has not been told yet."""

_RAW = Struct("<12f")
_TIME = Struct("<II")
_LENGTHS = {RAW_SENSORS: 48, SYSTEM_STATE: 100, UNIX_TIME: 8, RUNNING_TIME: 8}


class AnppOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which packets tell a sample its time; `with_time` is for `encode`."""

    time: Literal["unix", "running"] = "unix"
    with_time: bool = False


def decoder(options: AnppOptions) -> Decoder:
    """Make a decoder of one unit's stream."""
    return SyncDecoder((b"",), _measure, _Reader(options).read)


def encode(record: Record, options: AnppOptions) -> bytes:
    """Write an `ImuRecord` as packet 28, ``with_time`` behind the packet that tells its time.

    Raises
    ------
    ValueError
        If the record does not carry rate and specific force.
    """
    if isinstance(record, TimeRecord) and record.unix_s is not None:
        return _packet(UNIX_TIME, _time(record.unix_s))
    sample, gyro, accel = preferred(record, "anpp", "rates")
    payload = _RAW.pack(
        *accel,
        *gyro,
        *(0.0, 0.0, 0.0),
        sample.temperature_c or 0.0,
        *(0.0, 0.0),
    )
    packet = _packet(RAW_SENSORS, payload)
    t_s = sample.t_device_s
    if not options.with_time or t_s is None:
        return packet
    identifier = UNIX_TIME if options.time == "unix" else RUNNING_TIME
    return _packet(identifier, _time(t_s)) + packet


def _measure(data: bytes, at: int) -> int | None:
    if len(data) < at + HEADER:
        return None
    return 0 if sum(data[at : at + HEADER]) & 0xFF else HEADER + data[at + 2]


class _Reader:
    """Packets to records; remembers the time of the output cycle until a sample has it."""

    def __init__(self, options: AnppOptions) -> None:
        self._is_running = options.time == "running"
        self._t_s: float | None = None

    def read(self, packet: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        """One whole packet."""
        payload = packet[HEADER:]
        if crc16_ccitt_false(payload) != packet[3] | packet[4] << 8:
            return None
        identifier = packet[1]
        if _LENGTHS.get(identifier) != len(payload):
            return other(f"packet {identifier}", packet, t_rx_ns, line_bytes)
        if identifier == RAW_SENSORS:
            return self._read_raw(packet, t_rx_ns, line_bytes)
        is_state = identifier == SYSTEM_STATE
        seconds, microseconds = _TIME.unpack_from(payload, 4 * is_state)
        t_s = seconds + microseconds * 1e-6
        if (identifier == RUNNING_TIME) == self._is_running:
            self._t_s = t_s
        if identifier == RUNNING_TIME:
            return other(f"packet {identifier}", packet, t_rx_ns, line_bytes)
        known = bool(payload[2] & UTC_KNOWN) if is_state else seconds >= UNIX_MIN_S
        return (TimeRecord(t_rx_ns=t_rx_ns, line_bytes=line_bytes, unix_s=t_s, valid=known),)

    def _read_raw(self, packet: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected]:
        ax, ay, az, gx, gy, gz, _, _, _, temperature, _, _ = _RAW.unpack_from(packet, HEADER)
        t_s, self._t_s = self._t_s, None
        gyro, accel = (gx, gy, gz), (ax, ay, az)
        if not plausible(gyro, accel, temperature):
            return out_of_range(packet, t_rx_ns, line_bytes)
        record = ImuRecord(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            t_device_s=t_s,
            rate_rad_s=gyro,
            specific_force_m_s2=accel,
            temperature_c=temperature,
        )
        return (record,)


def _packet(identifier: int, payload: bytes) -> bytes:
    header = bytes([identifier, len(payload)]) + crc16_ccitt_false(payload).to_bytes(2, "little")
    return bytes([-sum(header) & 0xFF]) + header + payload


def _time(t_s: float) -> bytes:
    seconds, microseconds = divmod(round(t_s * 1e6), 1_000_000)
    return _TIME.pack(seconds, microseconds)


ANPP = Codec(
    name="anpp",
    kind="imu",
    devices="Advanced Navigation Motus, Orientus, Spatial, Certus, Boreas, Subsonus (packet 28)",
    options=AnppOptions,
    decoder=decoder,
    encode=encode,
)
