"""VectorNav binary output: VN-100, -200, -300 and their kin, whatever fields were chosen.

FA, group byte (bit 7: another follows), one u16 mask of fields for each group it names, the fields
in the order of groups and bits, CRC-16/XMODEM over all behind FA, big-endian; the rest is
little-endian. What is used (group, bit):

========== ================================================================================
1.0 2.0    time since start-up u64 (ns)
1.2 2.4    time since the last sync in u64 (ns)
1.14 2.5   time since the last GPS pulse u64 (ns)
3.3 1.9    rotation x y z (rad/s), uncompensated; in 1.9 behind the acceleration
3.10 1.5   rotation x y z (rad/s), less the bias the unit's filter estimates
3.2 1.9    acceleration x y z (m/s^2), uncompensated
3.9 1.8    acceleration x y z (m/s^2), less the bias the unit's filter estimates
3.6 1.11   interval (s), angle increment x y z (deg); in 1.11 the velocity increment (m/s) too
3.7        velocity increment x y z (m/s)
3.4        temperature (degC)
3.11       saturation u16: bits 3-5 accelerometers, 6-8 gyros x y z
========== ================================================================================
"""

from functools import lru_cache
from struct import Struct
from typing import NamedTuple

from msgspec import UNSET, UnsetType

from drivers.checksums import crc16_xmodem
from drivers.codec import Codec, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.sample import (
    DEG,
    ZERO,
    Preference,
    other,
    out_of_range,
    plausible,
    preferred,
)
from drivers.records import ImuRecord, Record, Rejected

SYNC = b"\xfa"
SATURATED = 0x1F8
LONGEST_S = 100.0
"""Beyond any interval between two packets (s)."""

_GNSS = (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28)
_LENGTHS: dict[int, tuple[int, ...]] = {
    1: (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),
    2: (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),
    3: (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),
    4: _GNSS,
    5: (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24),
    6: (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),
    7: _GNSS,
}
"""Bytes of each field of each group; what is beyond has no fixed length, or none that is known."""

_FORMATS = {
    **dict.fromkeys([(1, 0), (2, 0), (1, 2), (2, 4), (1, 14), (2, 5)], "Q"),
    **dict.fromkeys([(3, 3), (1, 5), (3, 10), (3, 2), (1, 8), (3, 9), (3, 7)], "3f"),
    (1, 9): "6f",
    (1, 11): "7f",
    (3, 6): "4f",
    (3, 4): "f",
    (3, 11): "H",
}
"""How struct writes the fields that are used, by (group, bit)."""

_START_UP = (((1, 0), 0), ((2, 0), 0))
_PULSE = (((1, 2), 0), ((2, 4), 0), ((1, 14), 0), ((2, 5), 0))
_ANGLE = (((3, 6), 1), ((1, 11), 1))
_RATE = (((3, 3), 0), ((1, 9), 3), ((3, 10), 0), ((1, 5), 0))
_VELOCITY = (((3, 7), 0), ((1, 11), 4))
_FORCE = (((3, 2), 0), ((1, 9), 0), ((3, 9), 0), ((1, 8), 0))
_TEMPERATURE = (((3, 4), 0),)
_SATURATION = (((3, 11), 0),)

Sources = tuple[tuple[tuple[int, int], int], ...]
"""Where a quantity may stand, best first: (group, bit), and how many values into the field."""


class Plan(NamedTuple):
    """How to read packets of one header: their length, and where among its values each stands."""

    length: int
    unpack: Struct
    rate: int | None
    angle: int | None
    force: int | None
    velocity: int | None
    time: int | None
    pulse: int | None
    temperature: int | None
    saturation: int | None


def decoder(options: Preference) -> Decoder:
    """Make a decoder of one unit's stream."""
    prefers_rates = options.prefer == "rates"

    def read(packet: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        if crc16_xmodem(packet[1:]):
            return None
        plan = _plan(packet[1 : 1 + (_header_length(packet, 0) or 0)], prefers_rates)
        if plan.rate is plan.angle is plan.force is plan.velocity is None:
            return other("packet without inertial data", packet, t_rx_ns, line_bytes)
        return _sample(packet, plan, t_rx_ns, line_bytes)

    return SyncDecoder((SYNC,), _measure, read)


def encode(record: Record, options: Preference) -> bytes:
    """Write an `ImuRecord` with time, increments or rates, temperature and saturation.

    Raises
    ------
    ValueError
        If the record carries other quantities than the options say.
    """
    sample, gyro, accel = preferred(record, "vectornav", options.prefer)
    increments = options.prefer == "increments"
    body = round((sample.t_device_s or 0.0) * 1e9).to_bytes(8, "little")
    if increments:
        interval_s = 0.0 if sample.interval_s is UNSET else sample.interval_s
        body += Struct("<7f").pack(interval_s, *(value / DEG for value in gyro), *accel)
    else:
        body += Struct("<6f").pack(*accel, *gyro)
    imu_mask = 1 << 4 | 1 << 11
    body += Struct("<fH").pack(sample.temperature_c or 0.0, 0 if sample.valid else SATURATED)
    masks = (1 | (1 << 11 if increments else 1 << 9), imu_mask)
    header = b"\x05" + b"".join(mask.to_bytes(2, "little") for mask in masks)
    checked = header + body
    return SYNC + checked + crc16_xmodem(checked).to_bytes(2, "big")


def _header_length(data: bytes, at: int) -> int | None:
    """Bytes of group byte and masks; 0 where groups are named that are not known."""
    if len(data) < at + 2:
        return None
    groups = data[at + 1]
    return 0 if groups & 0x80 or not groups else 1 + 2 * groups.bit_count()


def _measure(data: bytes, at: int) -> int | None:
    header = _header_length(data, at)
    if not header:
        return header
    if len(data) < at + 1 + header:
        return None
    return _plan(data[at + 1 : at + 1 + header], False).length


@lru_cache(maxsize=256)
def _plan(header: bytes, prefers_rates: bool) -> Plan:
    """Work out a header; the length is 0 if it names a field of unknown length."""
    places: dict[tuple[int, int], int] = {}
    form, count, at = f"<{1 + len(header)}x", 0, 1
    is_known = True
    for group in (g for g in range(1, 8) if header[0] >> (g - 1) & 1):
        mask, at = header[at] | header[at + 1] << 8, at + 2
        for bit in (b for b in range(16) if mask >> b & 1):
            if bit >= len(_LENGTHS[group]):
                is_known = False
                continue
            wanted = _FORMATS.get((group, bit))
            if wanted is None:
                form += f"{_LENGTHS[group][bit]}x"
                continue
            places[group, bit] = count
            form += wanted
            count += int(wanted[:-1] or 1)
    unpack = Struct(form + "2x")

    def first(sources: Sources) -> int | None:
        return next((places[key] + skip for key, skip in sources if key in places), None)

    rate, angle, force, velocity = map(first, (_RATE, _ANGLE, _FORCE, _VELOCITY))
    if None not in (rate, angle):
        rate, angle = (rate, None) if prefers_rates else (None, angle)
    if None not in (force, velocity):
        force, velocity = (force, None) if prefers_rates else (None, velocity)
    return Plan(
        unpack.size if is_known else 0,
        unpack,
        *(rate, angle, force, velocity),
        *map(first, (_START_UP, _PULSE, _TEMPERATURE, _SATURATION)),
    )


def _sample(packet: bytes, plan: Plan, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected]:
    values = plan.unpack.unpack(packet)
    gyro = accel = ZERO
    interval_s: float | UnsetType = UNSET
    if plan.angle is not None:
        interval_s, x, y, z = values[plan.angle - 1 : plan.angle + 3]
        gyro = x * DEG, y * DEG, z * DEG
    elif plan.rate is not None:
        gyro = values[plan.rate : plan.rate + 3]
    at = plan.velocity if plan.force is None else plan.force
    if at is not None:
        accel = values[at : at + 3]
    warm = None if plan.temperature is None else values[plan.temperature]
    is_timed = interval_s is UNSET or 0 <= interval_s <= LONGEST_S
    if not (is_timed and plausible(gyro, accel, warm)):
        return out_of_range(packet, t_rx_ns, line_bytes)
    has_gyro = plan.rate is not None or plan.angle is not None
    spoiled = plan.saturation is not None and values[plan.saturation] & SATURATED
    record = ImuRecord(
        t_rx_ns=t_rx_ns,
        line_bytes=line_bytes,
        t_device_s=None if plan.time is None else values[plan.time] * 1e-9,
        valid=has_gyro and at is not None and not spoiled,
        rate_rad_s=UNSET if plan.rate is None else gyro,
        delta_angle_rad=UNSET if plan.angle is None else gyro,
        specific_force_m_s2=UNSET if plan.force is None else accel,
        delta_velocity_m_s=UNSET if plan.velocity is None else accel,
        interval_s=interval_s,
        since_pulse_s=UNSET if plan.pulse is None else values[plan.pulse] * 1e-9,
        temperature_c=warm,
    )
    return (record,)


VECTORNAV = Codec(
    name="vectornav",
    kind="imu",
    devices="VectorNav VN-100, -110, -200, -210, -300, -310 (binary output)",
    options=Preference,
    decoder=decoder,
    encode=encode,
)
