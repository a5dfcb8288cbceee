"""NovAtel's inertial logs: raw increments as samples, corrected ones marked as compensated.

=================================== ========================================================
log (message id)                    message, 40 or 60 bytes
=================================== ========================================================
RAWIMU 268, RAWIMUS 325             week u32, seconds f64, status u32,
                                    acceleration z, -y, x, rotation z, -y, x: 6 x i32
RAWIMUX 1461, RAWIMUSX 1462         info u8 (bit 0: error), IMU type u8, week u16, seconds f64,
                                    status u32, the same six
CORRIMUDATA 812, CORRIMUDATAS 813,  week u32, seconds f64,
IMURATECORRIMUS 1362                pitch, roll, yaw (rad), lateral, longitudinal, vertical (m/s)
                                    increments: 6 x f64
CORRIMUS 2264                       count u32, the same six, two reserved u32
=================================== ========================================================

Raw counts are increments over a sample in the unit's own axes, the second of each triple with its
sign turned; `scales` says what they are worth.
"""

from collections.abc import Sequence
from struct import Struct
from typing import Literal

import msgspec

from drivers.codec import Codec, Counting, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.novatel import frames
from drivers.imu.novatel.scales import NUMBERS, SCALES, TYPES, ImuName, Scale
from drivers.imu.sample import (
    acceleration,
    inertial,
    other,
    out_of_range,
    plausible,
    rotation,
)
from drivers.records import CompensatedRecord, ImuRecord, Record, Rejected

WEEK_S = 604800.0

RawLog = Literal["rawimusx", "rawimux", "rawimus", "rawimu"]

_RAW = Struct("<IdI6i")
_RAW_X = Struct("<BBHdI6i")
_CORRECTED = Struct("<Id6d")
_COUNTED = Struct("<I6dII")

_LOGS: dict[int, tuple[str, Struct]] = {
    268: ("RAWIMU", _RAW),
    325: ("RAWIMUS", _RAW),
    1461: ("RAWIMUX", _RAW_X),
    1462: ("RAWIMUSX", _RAW_X),
    812: ("CORRIMUDATA", _CORRECTED),
    813: ("CORRIMUDATAS", _CORRECTED),
    1362: ("IMURATECORRIMUS", _CORRECTED),
    2264: ("CORRIMUS", _COUNTED),
}
_IDENTIFIERS = {name: identifier for identifier, (name, _) in _LOGS.items()}
_ASCII = {f"{name}A": (name, message) for name, message in _LOGS.values()}
_BASES = {_RAW: {2: 16}, _RAW_X: {0: 16, 1: 10, 4: 16}}
"""Which ASCII fields of a message are integers, and in which base."""


class NovatelOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The unit behind the receiver, where its log does not name it; what `encode` writes.

    ``gyro_lsb_rad`` and ``accel_lsb_m_s`` are for a unit that is not in the list, and overrule it.
    """

    imu: ImuName | None = None
    gyro_lsb_rad: float | None = None
    accel_lsb_m_s: float | None = None
    log: RawLog = "rawimusx"
    ascii: bool = False

    @property
    def scale(self) -> Scale | None:
        """What a count is worth, if the options say it."""
        if self.gyro_lsb_rad is not None and self.accel_lsb_m_s is not None:
            return Scale(self.gyro_lsb_rad, self.accel_lsb_m_s)
        return SCALES[self.imu] if self.imu else None


def decoder(options: NovatelOptions) -> Decoder:
    """Make a decoder of one receiver's stream."""
    return SyncDecoder(frames.SYNCS, frames.measure, _Reader(options).read)


def encode(record: Record, options: NovatelOptions) -> bytes:
    """Write an `ImuRecord` as the raw log of the options (of an ISA-100C if they name no unit).

    A `CompensatedRecord` becomes IMURATECORRIMUS.

    Raises
    ------
    ValueError
        If the record does not carry increments.
    """
    if isinstance(record, CompensatedRecord):
        return _encode_corrected(record)
    sample = inertial(record, "novatel-span")
    scale = options.scale or SCALES["isa100c"]
    x, y, z = rotation(sample, increment=True)
    u, v, w = acceleration(sample, increment=True)
    counts = [_count(value, scale.accel_m_s) for value in (w, -v, u)]
    counts += [_count(value, scale.gyro_rad) for value in (z, -y, x)]
    seconds = (sample.t_device_s or 0.0) % WEEK_S
    info, imu_type = int(not sample.valid), NUMBERS[options.imu or "isa100c"]
    name = options.log.upper()
    if options.ascii:
        fields = [f"{info:02x}", str(imu_type)] if name.endswith("X") else []
        fields += ["0", f"{seconds:.9f}", "00000000", *map(str, counts)]
        return frames.ascii_log(_ascii_header(name, seconds), fields)
    if name.endswith("X"):
        message = _RAW_X.pack(info, imu_type, 0, seconds, 0, *counts)
    else:
        message = _RAW.pack(0, seconds, 0, *counts)
    write = frames.short if name in ("RAWIMUS", "RAWIMUSX") else frames.long
    return write(_IDENTIFIERS[name], message, seconds)


class _Reader:
    """Logs to records, with the unit of the options."""

    def __init__(self, options: NovatelOptions) -> None:
        self._scale = options.scale
        self._overruled = options.gyro_lsb_rad is not None and options.accel_lsb_m_s is not None

    def read(self, log: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected] | None:
        """One whole log."""
        if not frames.holds(log):
            return None
        if log[0] != 0xAA:
            return self._read_ascii(log, t_rx_ns, line_bytes)
        start = frames.SHORT_HEADER if log[2] == frames.SHORT else log[3]
        identifier = log[4] | log[5] << 8
        kind = _LOGS.get(identifier)
        if kind is None or len(log) < start + kind[1].size + 4:
            return other(f"message {identifier}", log, t_rx_ns, line_bytes)
        message = kind[1]
        values = message.unpack_from(log, start)
        if message is _COUNTED:
            place = 8 if log[2] == frames.SHORT else 16
            milliseconds = int.from_bytes(log[place : place + 4], "little")
            values = (0, milliseconds / 1000, *values[1:7])
        return self._record(kind, values, log, t_rx_ns, line_bytes)

    def _read_ascii(self, log: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record | Rejected]:
        header, _, body = log[1:].decode().rpartition("*")[0].partition(";")
        name, *head = header.split(",")
        kind = _ASCII.get(name)
        if kind is None:
            return other(name, log, t_rx_ns, line_bytes)
        message = kind[1]
        try:
            bases = _BASES.get(message, {})
            values = [_number(text, bases.get(at)) for at, text in enumerate(body.split(","))]
            if message is _COUNTED:
                seconds = head[5] if log[:1] == b"#" else head[1]
                values = [0, float(seconds), *values[1:7]]
            wanted = {_RAW: 9, _RAW_X: 11}.get(message, 8)
            if len(values) < wanted:
                raise ValueError(name)
            values = values[:wanted]
        except (ValueError, IndexError):
            return (Rejected(t_rx_ns=t_rx_ns, line_bytes=line_bytes, reason="syntax", data=log),)
        return self._record(kind, values, log, t_rx_ns, line_bytes)

    def _record(
        self,
        kind: tuple[str, Struct],
        values: Sequence[float],
        log: bytes,
        t_rx_ns: int,
        line_bytes: int,
    ) -> tuple[Record | Rejected]:
        name, message = kind
        valid, scale = True, self._scale
        if message is _RAW_X:
            valid = not int(values[0]) & 1
            if not self._overruled:
                _, scale = TYPES.get(int(values[1]), ("", None))
            values = values[2:]
        elif message is not _RAW:
            return _corrected(values, log, t_rx_ns, line_bytes)
        if scale is None:
            return other(f"{name} of an unknown IMU", log, t_rx_ns, line_bytes)
        _, seconds, _, w, v, u, z, y, x = values
        gyro_rad, accel_m_s = scale
        delta_angle = x * gyro_rad, -y * gyro_rad, z * gyro_rad
        delta_velocity = u * accel_m_s, -v * accel_m_s, w * accel_m_s
        if not (plausible(delta_angle, delta_velocity) and 0 <= seconds <= WEEK_S):
            return out_of_range(log, t_rx_ns, line_bytes)
        record = ImuRecord(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            t_device_s=seconds,
            valid=valid,
            delta_angle_rad=delta_angle,
            delta_velocity_m_s=delta_velocity,
        )
        return (record,)


def _corrected(
    values: Sequence[float], log: bytes, t_rx_ns: int, line_bytes: int
) -> tuple[Record | Rejected]:
    _, seconds, pitch, roll, yaw, lateral, longitudinal, vertical = values[:8]
    delta_angle, delta_velocity = (pitch, roll, yaw), (lateral, longitudinal, vertical)
    if not (plausible(delta_angle, delta_velocity) and 0 <= seconds <= WEEK_S):
        return out_of_range(log, t_rx_ns, line_bytes)
    record = CompensatedRecord(
        t_rx_ns=t_rx_ns,
        line_bytes=line_bytes,
        t_device_s=seconds,
        delta_angle_rad=delta_angle,
        delta_velocity_m_s=delta_velocity,
    )
    return (record,)


def _encode_corrected(record: CompensatedRecord) -> bytes:
    if not (record.delta_angle_rad and record.delta_velocity_m_s):
        raise ValueError("the record does not carry increments")
    seconds = (record.t_device_s or 0.0) % WEEK_S
    six = *record.delta_angle_rad, *record.delta_velocity_m_s
    message = _CORRECTED.pack(0, seconds, *six)
    return frames.short(_IDENTIFIERS["IMURATECORRIMUS"], message, seconds)


def _count(value: float, lsb: float) -> int:
    """Counts of a quantity, at most as many as the log can hold."""
    return max(-(1 << 31), min(round(value / lsb), (1 << 31) - 1))


def _number(text: str, base: int | None) -> float:
    return int(text, base) if base else float(text)


def _ascii_header(name: str, seconds: float) -> str:
    if name in ("RAWIMUS", "RAWIMUSX"):
        return f"%{name}A,0,{seconds:.3f}"
    return f"#{name}A,COM1,0,0.0,FINESTEERING,0,{seconds:.3f},00000000,0000,0"


NOVATEL_SPAN = Codec(
    name="novatel-span",
    kind="imu",
    devices="NovAtel SPAN receivers: RAWIMU, RAWIMUS, RAWIMUX, RAWIMUSX; corrected logs as such",
    options=NovatelOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_modulus_s=WEEK_S),
)
