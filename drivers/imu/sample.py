"""What the codecs of inertial units have in common: units, sanity, and the quantities to encode."""

from math import pi
from typing import Literal

import msgspec
from msgspec import UNSET

from drivers.records import ImuRecord, OtherFrame, Record, Rejected, Vec3

G0 = 9.80665
"""Standard gravity, to which a unit's g refers (m/s^2)."""

DEG = pi / 180
"""One degree (rad)."""

Prefer = Literal["increments", "rates"]
"""What to take from a frame that carries both: increments miss nothing between two samples."""

ZERO: Vec3 = (0.0, 0.0, 0.0)

RATE_MAX = 100.0
"""Faster than any gyro here can tell (rad/s); none counts increments over more than a second, so
the bound holds for them too (rad). Beyond it stands a wrong unit, or no number at all."""

FORCE_MAX = 2000.0
"""The same for specific force (m/s^2) and velocity increments (m/s)."""

TEMPERATURE_MAX = 300.0
"""And for temperature (degC), either way."""


class Preference(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What to take from frames that carry both, and what `encode` writes."""

    prefer: Prefer = "increments"


def plausible(gyro: Vec3, accel: Vec3, temperature_c: float | None = None) -> bool:
    """Whether a sample in SI units can be one; NaN and infinity are not."""
    x, y, z = gyro
    u, v, w = accel
    return (
        x * x + y * y + z * z <= RATE_MAX * RATE_MAX
        and u * u + v * v + w * w <= FORCE_MAX * FORCE_MAX
        and (temperature_c is None or -TEMPERATURE_MAX <= temperature_c <= TEMPERATURE_MAX)
    )


def out_of_range(frame: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Rejected]:
    """A frame whose check holds but which says what cannot be."""
    return (Rejected(t_rx_ns=t_rx_ns, line_bytes=line_bytes, reason="range", data=frame),)


def other(name: str, frame: bytes, t_rx_ns: int, line_bytes: int) -> tuple[OtherFrame]:
    """A frame whose check holds and of which no use is made."""
    return (OtherFrame(t_rx_ns=t_rx_ns, line_bytes=line_bytes, name=name, data=frame),)


def inertial(record: Record, codec: str) -> ImuRecord:
    """The record, if it is a sample; raises ValueError."""
    if not isinstance(record, ImuRecord):
        raise ValueError(f"{codec} cannot say a {type(record).__name__}")
    return record


def rotation(record: ImuRecord, *, increment: bool) -> Vec3:
    """Angle increment (rad) or rate (rad/s) of a sample to encode; raises ValueError."""
    value = record.delta_angle_rad if increment else record.rate_rad_s
    if value is UNSET:
        raise ValueError(f"the record does not carry {_ROTATION[increment]}")
    return value


def acceleration(record: ImuRecord, *, increment: bool) -> Vec3:
    """Velocity increment (m/s) or specific force (m/s^2) to encode; raises ValueError."""
    value = record.delta_velocity_m_s if increment else record.specific_force_m_s2
    if value is UNSET:
        raise ValueError(f"the record does not carry {_ACCELERATION[increment]}")
    return value


def preferred(record: Record, codec: str, prefer: Prefer) -> tuple[ImuRecord, Vec3, Vec3]:
    """A sample to encode, with its rotation and acceleration: both increments, or both rates.

    Raises ValueError where the record is no sample, or does not carry them.
    """
    sample, increment = inertial(record, codec), prefer == "increments"
    return sample, rotation(sample, increment=increment), acceleration(sample, increment=increment)


_ROTATION = {True: "delta_angle_rad", False: "rate_rad_s"}
_ACCELERATION = {True: "delta_velocity_m_s", False: "specific_force_m_s2"}
