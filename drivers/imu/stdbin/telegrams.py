"""STDBIN telegrams to records, and records to telegrams of one block."""

from collections.abc import Callable
from functools import lru_cache
from math import isfinite
from typing import Any, Literal, NamedTuple

import msgspec
from msgspec import UNSET, UnsetType

from drivers.codec import Codec, Counting, Decoder
from drivers.framing import SyncDecoder
from drivers.imu.sample import DEG, other, plausible
from drivers.imu.stdbin import layout
from drivers.imu.stdbin.blocks import (
    AGE_MAX_TICKS,
    BOTTOM,
    BOTTOM_BLOCK,
    DAY_TICKS,
    DEPTH,
    DEPTH_BLOCK,
    FORCE,
    GNSS,
    GNSS_BLOCK,
    HEADING,
    HEADING_SD,
    LBL,
    LBL_BLOCK,
    MANUAL_GNSS,
    MOVING,
    RATE,
    TEMPERATURES,
    TICK_S,
    TURNING,
    USBL,
    USBL_BLOCK,
    VECTOR,
    WATER,
    WATER_BLOCK,
)
from drivers.imu.stdbin.layout import Kind, Layout
from drivers.imu.stdbin.writing import write_telegram
from drivers.records import (
    CompensatedRecord,
    DepthRecord,
    DvlRecord,
    GnssRecord,
    HeadingRecord,
    ImuRecord,
    LblRecord,
    LblReply,
    OtherFrame,
    Record,
    Rejected,
    UsblRecord,
    Vec3,
)


class StdbinOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The geoid (m above the ellipsoid) where GNSS blocks say 0; `version` is for `encode`."""

    geoid_m: float | None = None
    version: Literal[2, 3, 4, 5] = 5


class Heard(NamedTuple):
    """A telegram as it arrived, with its time and the options."""

    telegram: bytes
    t_rx_ns: int
    line_bytes: int
    validity: int
    counter: int
    options: StdbinOptions

    @property
    def arrival(self) -> dict[str, Any]:
        """Fields every record of the telegram has."""
        return {"t_rx_ns": self.t_rx_ns, "line_bytes": self.line_bytes}

    def told(self, tag: int) -> dict[str, Any]:
        """The same for an external block with its own time: also how long ago that was."""
        age = (self.validity - tag) % DAY_TICKS
        age_s = age * TICK_S if age <= AGE_MAX_TICKS else UNSET
        return {**self.arrival, "age_s": age_s}


def decoder(options: StdbinOptions) -> Decoder:
    """Make a decoder of one unit's stream."""

    def read(
        telegram: bytes, t_rx_ns: int, line_bytes: int
    ) -> tuple[Record | Rejected, ...] | None:
        if not layout.holds(telegram):
            return None
        if telegram[:2] == layout.ANSWER:
            return other("answer", telegram, t_rx_ns, line_bytes)
        plan = _plan(layout.head(telegram))
        if not plan.layout.fits(telegram):
            return (
                Rejected(t_rx_ns=t_rx_ns, line_bytes=line_bytes, reason="syntax", data=telegram),
            )
        validity, counter = layout.validity_counter(telegram)
        heard = Heard(telegram, t_rx_ns, line_bytes, validity, counter, options)
        records = [build(heard, at) for build, at in plan.builders]
        return tuple(records) or other("telegram", telegram, t_rx_ns, line_bytes)

    return SyncDecoder((layout.TELEGRAM, layout.ANSWER), layout.measure, read)


def encode(record: Record, options: StdbinOptions) -> bytes:
    """Write a telegram of the one record, an `OtherFrame` as it is.

    Raises
    ------
    ValueError
        If no block can say the record, or it lacks what the block needs.
    """
    if isinstance(record, OtherFrame):
        return record.data
    return write_telegram(record, options.version)


class Plan(NamedTuple):
    """What telegrams of one version and masks hold: who builds a record, and from where."""

    layout: Layout
    builders: tuple[tuple[Callable[[Heard, Any], Record], Any], ...]


@lru_cache(maxsize=64)
def _plan(head: bytes) -> Plan:
    found = layout.layout_of(head)
    places = found.places
    builders: list[tuple[Callable[[Heard, Any], Record], Any]] = []
    for build, keys in (
        (_sample, (RATE, FORCE, TEMPERATURES)),
        (_compensated, (TURNING, MOVING)),
        (_attitude, (HEADING, HEADING_SD)),
    ):
        if keys[0] in places or (keys[1] in places and build is not _attitude):
            builders.append((build, tuple(map(places.get, keys))))
    builders += [(_BLOCKS[key], at) for key, at in places.items() if key in _BLOCKS]
    return Plan(found, tuple(builders))


Places = tuple[int | None, ...]


def _sample(heard: Heard, places: Places) -> Record:
    rate, force, warm = places
    gyro, accel = _vector(heard, rate, DEG), _vector(heard, force)
    return ImuRecord(
        t_rx_ns=heard.t_rx_ns,
        line_bytes=heard.line_bytes,
        sequence=heard.counter,
        t_device_s=heard.validity * TICK_S,
        valid=bool(gyro and accel and plausible(gyro, accel)),
        rate_rad_s=gyro,
        specific_force_m_s2=accel,
        temperature_c=None if warm is None else VECTOR.unpack_from(heard.telegram, warm)[0],
    )


def _compensated(heard: Heard, places: Places) -> Record:
    turning, moving = _vector(heard, places[0], DEG), _vector(heard, places[1])
    return CompensatedRecord(
        **heard.arrival,
        sequence=heard.counter,
        t_device_s=heard.validity * TICK_S,
        valid=plausible(turning or _ZERO, moving or _ZERO),
        rate_rad_s=turning,
        acceleration_m_s2=moving,
    )


def _attitude(heard: Heard, places: Places) -> Record:
    attitude, sd = _vector(heard, places[0]), _vector(heard, places[1])
    heading, roll, pitch = attitude or _ZERO
    return HeadingRecord(
        **heard.arrival,
        heading_deg=heading,
        roll_deg=roll,
        pitch_deg=-pitch,
        t_device_s=heard.validity * TICK_S,
        valid=_finite((heading, roll, pitch)),
        sd_deg=sd[0] if sd else UNSET,
    )


def _gnss(heard: Heard, at: int) -> Record:
    tag, source, quality, lat, lon, altitude, *sd, _, geoid = GNSS_BLOCK.unpack_from(
        heard.telegram, at
    )
    geoid_m = geoid or heard.options.geoid_m
    return GnssRecord(
        **heard.told(tag),
        valid=quality > 0 and source != MANUAL_GNSS and _finite((lat, lon, altitude)),
        t_device_s=tag * TICK_S,
        lat_deg=lat,
        lon_deg=_east(lon),
        height_m=None if geoid_m is None else altitude + geoid_m,
        geoid_m=geoid_m,
        quality=quality,
        sd_m=(sd[0], sd[1], sd[2]),
    )


def _usbl(heard: Heard, at: int) -> Record:
    tag, _, beacon, lat, lon, altitude, *_ = USBL_BLOCK.unpack_from(heard.telegram, at)
    return UsblRecord(
        **heard.told(tag),
        beacon=_name(beacon),
        t_device_s=tag * TICK_S,
        valid=_finite((lat, lon, altitude)),
        lat_deg=lat,
        lon_deg=_east(lon),
        depth_m=-altitude,
    )


def _depth(heard: Heard, at: int) -> Record:
    tag, depth, sd = DEPTH_BLOCK.unpack_from(heard.telegram, at)
    return DepthRecord(
        **heard.told(tag),
        depth_m=depth,
        t_device_s=tag * TICK_S,
        valid=_finite((depth,)),
        sd_m=sd,
    )


def _bottom(heard: Heard, at: int) -> Record:
    tag, _, forward, port, up, sound, altitude, *sd = BOTTOM_BLOCK.unpack_from(heard.telegram, at)
    return DvlRecord(
        **heard.told(tag),
        velocity_m_s=(forward, -port, -up),
        t_device_s=tag * TICK_S,
        valid=_finite((forward, port, up)),
        altitude_m=altitude if altitude > 0 else None,
        sd_m_s=(sd[0], sd[1], sd[2]),
        sound_speed_m_s=sound,
    )


def _water(heard: Heard, at: int) -> Record:
    tag, _, forward, port, up, sound, *_ = WATER_BLOCK.unpack_from(heard.telegram, at)
    return DvlRecord(
        **heard.told(tag),
        t_device_s=tag * TICK_S,
        valid=False,
        water_velocity_m_s=(forward, -port, -up),
        sound_speed_m_s=sound,
    )


def _lbl(heard: Heard, at: int) -> Record:
    tag, _, beacon, _, _, _, range_m, _ = LBL_BLOCK.unpack_from(heard.telegram, at)
    return LblRecord(
        **heard.told(tag),
        replies=(LblReply(beacon=_name(beacon), range_m=range_m),),
        t_ping_s=tag * TICK_S,
        valid=_finite((range_m,)) and range_m > 0,
    )


_ZERO = (0.0, 0.0, 0.0)
_BLOCKS: dict[int, Callable[[Heard, int], Record]] = {
    **dict.fromkeys((GNSS, GNSS + 1, GNSS + 2), _gnss),
    **dict.fromkeys((USBL, USBL + 1, USBL + 2), _usbl),
    DEPTH: _depth,
    **dict.fromkeys((BOTTOM, Kind.EXTERNAL + 21), _bottom),
    **dict.fromkeys((WATER, Kind.EXTERNAL + 22), _water),
    **dict.fromkeys((LBL, LBL + 1, LBL + 2, LBL + 3), _lbl),
}


def _vector(heard: Heard, at: int | None, unit: float = 1.0) -> Vec3 | UnsetType:
    if at is None:
        return UNSET
    x, y, z = VECTOR.unpack_from(heard.telegram, at)
    return x * unit, y * unit, z * unit


def _finite(values: tuple[float, ...]) -> bool:
    return all(map(isfinite, values))


def _east(lon_deg: float) -> float:
    """Longitude from 0..360 to -180..180."""
    return lon_deg - 360 if lon_deg > 180 else lon_deg


def _name(beacon: bytes) -> str:
    """A name of eight characters, as far as it is one."""
    return beacon.split(b"\x00")[0].decode("latin-1").strip()


STDBIN = Codec(
    name="stdbin",
    kind="imu",
    devices="iXblue and Exail PHINS, ROVINS, HYDRINS, OCTANS, QUADRANS (STDBIN V2 to V5)",
    options=StdbinOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(sequence_modulus=2**32, time_modulus_s=DAY_TICKS * TICK_S),
    also=(
        "usbl",
        "lbl",
        "gnss",
        "depth",
        "dvl",
        "heading",
    ),
)
