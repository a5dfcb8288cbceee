"""Sensonor STIM300: every datagram of its normal and init modes, in the units it says itself.

A datagram has no sync word: an identifier, its content (big-endian, two's complement), a
CRC-32/MPEG-2 over all before it *and over as many 00 bytes, not sent, as make that a multiple of
four*, and CR LF where the unit is set so.

============ ===================================================== ================
identifier   content, in this order                                bytes, no CR LF
============ ===================================================== ================
90 91 92 93  gyro x y z, 3 x i24, status                           18 28 28 38
94 A5 A6 A7  acceleration (91 93 A5 A7), 3 x i24, status           25 42 42 59
F0 .. F3     inclination (even of 92, 93, A6, A7), 3 x i24, status 22 32 32 42
F4 .. F7     temperatures (94 A5 A6 A7) of each of the groups      29 46 46 63
98 .. 9C     before, 3 x i16, status                               22 32 32 42 29
AD AE AF     PPS (F0 .. F7) or AUX (98 .. AF), i24, status         46 46 63
\\            counter u8 at 2000/s, latency u16 (us)
B1 B3        part number                                           20
B5 B7        serial number                                         20
BC BD        configuration                                         26
D1 D2        bias trim offsets                                     40
BE BF        extended error information                            21
============ ===================================================== ================

The second identifier of a pair says that CR LF follows. Of the configuration are used byte 3 (bit 0
CR LF), the low halves of 5, 8 and 13 (units of gyro, accelerometer, PPS) and 17-18 (ranges of the
accelerometers x, y, z). Status bits: 7 system integrity, 6 start-up, 5 outside operating
conditions, 4 overload, 3 channel error; 0 is well.
"""

from struct import Struct
from typing import Literal, NamedTuple

import msgspec
from msgspec import UNSET, UnsetType

from drivers.checksums import crc32_mpeg2
from drivers.codec import Codec, Counting, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.sample import DEG, G0, acceleration, inertial, other, rotation
from drivers.records import DeviceStatus, ImuRecord, Record, Rejected, Vec3

COUNT_S = 1 / 2000
"""Seconds from one internal sample to the next, which is what the counter counts."""

LATENCY_MAX = 0xFFFF
FAULTS = 0xD8
"""Status bits that spoil a sample: all but "outside operating conditions" and the axes' own."""
OVERLOAD = 0x10

Numbers = tuple[int, ...]
Gyro = Literal["rate", "increment", "integrated"]
Accel = Literal["acceleration", "increment", "integrated", "integrated_g"]
RangeG = Literal[5, 10, 30, 80]

_GYRO_UNITS: dict[int, Gyro] = {0: "rate", 1: "increment", 2: "rate", 3: "integrated"}
_ACCEL_UNITS: dict[int, Accel] = {
    0: "acceleration",
    1: "increment",
    2: "acceleration",
    3: "integrated_g",
    4: "integrated",
}
_RANGES: dict[int, RangeG] = {0: 10, 3: 5, 4: 30, 6: 80}
_ACCEL_BITS = {5: 20, 10: 19, 30: 18, 80: 16}
_VELOCITY_BITS = {5: 23, 10: 22, 30: 21, 80: 19}

_SPECIAL = {
    0xB1: ("part number", 20),
    0xB5: ("serial number", 20),
    0xBC: ("configuration", 26),
    0xD1: ("bias trim offset", 40),
    0xBE: ("extended error", 21),
}
_WITH_CRLF = {0xB3: 0xB1, 0xB7: 0xB5, 0xBD: 0xBC, 0xD2: 0xD1, 0xBF: 0xBE}


class Stim300Options(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of the unit, until a configuration datagram says them; ``with_`` is for `encode`."""

    gyro: Gyro = "rate"
    accel: Accel = "acceleration"
    accel_range_g: RangeG = 10
    crlf: bool = False
    pps: Literal["since_edge", "filtered"] = "since_edge"
    with_inclination: bool = False
    with_temperature: bool = False
    with_pps: bool = False


class Layout(NamedTuple):
    """What a normal-mode datagram holds, and where among the numbers `unpack` gives."""

    unpack: Struct
    length: int
    accel: bool
    inclination: bool
    temperature: int | None
    pps: int | None


def _layout(*, accel: bool, inclination: bool, temperature: bool, extra: str) -> Layout:
    groups = 1 + accel + inclination
    fields = ">x" + groups * "bHbHbHB"
    at = 7 * groups
    if temperature:
        fields += groups * "hhhB"
    pps = at + temperature * 4 * groups if extra == "pps" else None
    fields += ("bHB" if extra else "") + "BH4x"
    unpack = Struct(fields)
    return Layout(unpack, unpack.size, accel, inclination, at if temperature else None, pps)


_CONTENTS = [(t, i, a) for t in (False, True) for i in (False, True) for a in (False, True)]
_NORMAL = {
    identifier: _layout(temperature=t, inclination=i, accel=a, extra=extra)
    for extra, identifiers in {
        "": b"\x90\x91\x92\x93\x94\xa5\xa6\xa7",
        "pps": b"\xf0\xf1\xf2\xf3\xf4\xf5\xf6\xf7",
        "aux": b"\x98\x99\x9a\x9b\x9c\xad\xae\xaf",
    }.items()
    for identifier, (t, i, a) in zip(identifiers, _CONTENTS, strict=True)
}
_IDENTIFIERS = {
    (layout.accel, layout.inclination, layout.temperature is not None, layout.pps is not None): key
    for key, layout in reversed(_NORMAL.items())
}


def decoder(options: Stim300Options) -> Decoder:
    """Make a decoder of one unit's stream."""
    unit = _Unit(options)
    first = bytes([*_NORMAL, *_SPECIAL, *_WITH_CRLF])
    return SyncDecoder([first[i : i + 1] for i in range(len(first))], unit.measure, unit.read)


def encode(record: Record, options: Stim300Options) -> bytes:
    """Write an `ImuRecord` with acceleration as a normal-mode datagram.

    What is beyond the range is sent as the end of it, with the overload bit, as the unit does.

    Raises
    ------
    ValueError
        If the record carries other quantities than the options say.
    """
    sample = inertial(record, "stim300")
    fault = 0 if sample.valid else 0x80
    unit = _Unit(options)
    gyro = rotation(sample, increment=options.gyro == "increment")
    accel = acceleration(sample, increment=options.accel == "increment")
    if "integrated" in (options.gyro, options.accel) or options.accel == "integrated_g":
        raise ValueError("stim300 writes no integrated units: one record does not hold them")
    content = _triple(gyro, unit.gyro_lsb, fault) + _triple(accel, unit.accel_lsb, fault)
    groups = 2 + options.with_inclination
    if options.with_inclination:
        content += bytes(10)
    if options.with_temperature:
        sensed = round((sample.temperature_c or 0.0) * 256)
        content += groups * (3 * sensed.to_bytes(2, "big", signed=True) + b"\x00")
    if options.with_pps:
        pulse_s = 0.0 if sample.since_pulse_s is UNSET else sample.since_pulse_s
        content += _int24(round(pulse_s * 1e6))[0] + b"\x00"
    age_s = 0.0 if sample.age_s is UNSET else sample.age_s
    latency = min(round(age_s * 1e6), LATENCY_MAX)
    content += bytes([(sample.sequence or 0) % 256]) + latency.to_bytes(2, "big")
    key = True, options.with_inclination, options.with_temperature, options.with_pps
    return _sealed(bytes([_IDENTIFIERS[key]]) + content) + options.crlf * b"\r\n"


def powered_up(options: Stim300Options) -> bytes:
    """Write part number, serial number, configuration and bias trim, as sent at power-up."""

    def told(identifiers: tuple[int, int], content: bytes) -> bytes:
        return _sealed(bytes([identifiers[options.crlf]]) + content) + options.crlf * b"\r\n"

    part = b"\x08\x41\x67-\x44\x00\x00-" + bytes(6) + b"D"
    numbers = told((0xB1, 0xB3), part) + told((0xB5, 0xB7), b"N" + bytes(14))
    return numbers + configuration(options) + told((0xD1, 0xD2), bytes(35))


def configuration(options: Stim300Options) -> bytes:
    """Write the configuration datagram of a unit set to `options`."""
    ranges = {g: code for code, g in _RANGES.items()}
    gyro = {unit: code for code, unit in reversed(_GYRO_UNITS.items())}
    accel = {unit: code for code, unit in reversed(_ACCEL_UNITS.items())}
    body = bytearray(22)
    body[:3] = b"\xbd-\x00" if options.crlf else b"\xbc-\x00"
    body[3] = (
        options.with_pps << 4
        | options.with_temperature << 3
        | options.with_inclination << 2
        | 1 << 1
        | options.crlf
    )
    body[5] = 0x70 | gyro[options.gyro]
    body[8] = 0x70 | accel[options.accel]
    body[13] = 2 if options.pps == "since_edge" else 0
    body[14] = 0x08
    body[17] = ranges[options.accel_range_g] * 0x11
    body[18] = ranges[options.accel_range_g] << 4
    return _sealed(bytes(body)) + options.crlf * b"\r\n"


class _Unit:
    """One unit: its settings as far as they are known, and where its integrated outputs stood."""

    def __init__(self, options: Stim300Options) -> None:
        self._crlf = options.crlf
        self._pps = options.pps == "since_edge"
        self._set(options.gyro, options.accel, (options.accel_range_g,) * 3)

    def _set(self, gyro: Gyro, accel: Accel, ranges_g: tuple[RangeG, RangeG, RangeG]) -> None:
        self._gyro, self._accel = gyro, accel
        self.gyro_lsb: Vec3 = (DEG * 2 ** -(14 if gyro == "rate" else 21),) * 3
        bits = _ACCEL_BITS if accel == "acceleration" else _VELOCITY_BITS
        unit = G0 if accel in ("acceleration", "integrated_g") else 1.0
        x, y, z = (unit * 2.0 ** -bits[g] for g in ranges_g)
        self.accel_lsb: Vec3 = x, y, z
        self._turned = _Growth()
        self._moved = _Growth()

    def measure(self, data: bytes, at: int) -> int:
        """Bytes of the datagram that begins with the identifier at `at`."""
        identifier = data[at]
        layout = _NORMAL.get(identifier)
        if layout is None:
            _, length = _SPECIAL[_WITH_CRLF.get(identifier, identifier)]
            return length + 2 * (identifier in _WITH_CRLF)
        if not self._crlf:
            return layout.length
        # A unit that does not end its datagrams after all loses none: the next byte shows it.
        end = at + layout.length
        return layout.length + (0 if data[end : end + 1] not in (b"", b"\r") else 2)

    def read(self, frame: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        """One datagram with its CR LF."""
        identifier = frame[0]
        layout = _NORMAL.get(identifier)
        if layout is None:
            return self._read_special(frame, t_rx_ns, line_bytes)
        if not _holds(frame, layout.length):
            return None
        numbers = layout.unpack.unpack(frame[: layout.length])
        count, latency = numbers[-2:]
        faults = numbers[6] | numbers[13] if layout.accel else numbers[6]
        gyro = self._rotation(numbers, count, t_rx_ns)
        accel = self._force(numbers, count, t_rx_ns) if layout.accel else UNSET
        is_angle, is_velocity = self._gyro == "increment", self._accel == "increment"
        t = layout.temperature
        record = ImuRecord(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            sequence=count,
            age_s=latency * 1e-6,
            valid=not faults & FAULTS and gyro is not UNSET and accel is not UNSET,
            rate_rad_s=UNSET if is_angle else gyro,
            delta_angle_rad=gyro if is_angle else UNSET,
            specific_force_m_s2=UNSET if is_velocity else accel,
            delta_velocity_m_s=accel if is_velocity else UNSET,
            temperature_c=None if t is None else sum(numbers[t : t + 3]) / (3 * 256),
            since_pulse_s=self._pulse(numbers, layout.pps),
        )
        return (record,)

    def _rotation(self, numbers: Numbers, count: int, t_rx_ns: int) -> Vec3 | UnsetType:
        xh, xl, yh, yl, zh, zl = numbers[:6]
        ticks = xh << 16 | xl, yh << 16 | yl, zh << 16 | zl
        if self._gyro == "integrated":
            return self._turned.rate(ticks, self.gyro_lsb, count, t_rx_ns)
        lsb = self.gyro_lsb[0]
        return ticks[0] * lsb, ticks[1] * lsb, ticks[2] * lsb

    def _force(self, numbers: Numbers, count: int, t_rx_ns: int) -> Vec3 | UnsetType:
        xh, xl, yh, yl, zh, zl = numbers[7:13]
        ticks = xh << 16 | xl, yh << 16 | yl, zh << 16 | zl
        x, y, z = self.accel_lsb
        if self._accel in ("integrated", "integrated_g"):
            return self._moved.rate(ticks, self.accel_lsb, count, t_rx_ns)
        return ticks[0] * x, ticks[1] * y, ticks[2] * z

    def _pulse(self, numbers: Numbers, at: int | None) -> float | UnsetType:
        if at is None or not self._pps or numbers[at + 2] & FAULTS:
            return UNSET
        return (numbers[at] << 16 | numbers[at + 1]) * 1e-6

    def _read_special(
        self, frame: bytes, t_rx_ns: int, line_bytes: int
    ) -> tuple[Record | Rejected] | None:
        name, length = _SPECIAL[_WITH_CRLF.get(frame[0], frame[0])]
        if not _holds(frame, length):
            return None
        if name == "extended error":
            bits = int.from_bytes(frame[1:17], "big")
            failed = tuple(f"E{bit}" for bit in range(128) if bits >> bit & 1)
            return (
                DeviceStatus(
                    t_rx_ns=t_rx_ns, line_bytes=line_bytes, healthy=not failed, failed=failed
                ),
            )
        if name == "configuration":
            self._configure(frame)
        return other(name, frame, t_rx_ns, line_bytes)

    def _configure(self, frame: bytes) -> None:
        """Take over what the unit says of itself, unless it speaks codes unknown here."""
        gyro = _GYRO_UNITS.get(frame[5] & 0x0F & ~0x04)
        accel = _ACCEL_UNITS.get(frame[8] & 0x0F)
        ranges = [_RANGES.get(code) for code in (frame[17] >> 4, frame[17] & 15, frame[18] >> 4)]
        self._crlf = bool(frame[3] & 1)
        self._pps = frame[13] & 0x0F in (2, 3)
        x, y, z = ranges
        if gyro and accel and x and y and z:
            self._set(gyro, accel, (x, y, z))


class _Growth:
    """An integrated output back into its mean rate since the datagram before.

    It wraps at 24 bits and the counter after 128 ms: what came after a longer silence says nothing.
    """

    MAX_NS = 100_000_000

    def __init__(self) -> None:
        self._ticks: Numbers | None = None
        self._count = 0
        self._t_rx_ns = 0

    def rate(self, ticks: Numbers, lsb: Vec3, count: int, t_rx_ns: int) -> Vec3 | UnsetType:
        """Mean rate, or nothing if the datagram before is not known or too long ago."""
        before, steps = self._ticks, (count - self._count) % 256
        is_near = t_rx_ns - self._t_rx_ns <= self.MAX_NS
        self._ticks, self._count, self._t_rx_ns = ticks, count, t_rx_ns
        if before is None or not steps or not is_near:
            return UNSET
        x, y, z = (
            ((new - old + (1 << 23)) % (1 << 24) - (1 << 23)) * unit / (steps * COUNT_S)
            for new, old, unit in zip(ticks, before, lsb, strict=True)
        )
        return x, y, z


def _padding(length: int) -> bytes:
    """The 00 bytes the CRC is computed over but which are not sent."""
    return bytes(-length % 4)


_PADDING = {length: _padding(length - 4) for length in range(4, 64)}


def _holds(frame: bytes, length: int) -> bool:
    """Tell whether the CRC holds, and what stands behind it is CR LF or nothing."""
    return crc32_mpeg2(frame[: length - 4] + _PADDING[length]) == frame[
        length - 4 : length
    ] and frame[length:] in (b"", b"\r\n")


def _sealed(body: bytes) -> bytes:
    return body + crc32_mpeg2(body + _padding(len(body)))


def _int24(value: int) -> tuple[bytes, bool]:
    """Three bytes of a number, and whether it had to be cut."""
    cut = max(-(1 << 23), min(value, (1 << 23) - 1))
    return cut.to_bytes(3, "big", signed=True), cut != value


def _triple(values: Vec3, lsb: Vec3, status: int) -> bytes:
    content = b""
    for axis, (value, unit) in enumerate(zip(values, lsb, strict=True)):
        number, is_cut = _int24(round(value / unit))
        content += number
        status |= (OVERLOAD | 1 << axis) * is_cut
    return content + bytes([status])


STIM300 = Codec(
    name="stim300",
    kind="imu",
    devices="Sensonor STIM300 (all datagrams, with and without PPS, AUX and CR LF)",
    options=Stim300Options,
    decoder=decoder,
    encode=encode,
    counting=Counting(sequence_modulus=256, sequence_s=COUNT_S),
    powered_up=powered_up,
)
