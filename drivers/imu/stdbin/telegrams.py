"""STDBIN telegrams to records, and records to telegrams of one block."""

from collections.abc import Callable
from functools import lru_cache
from math import inf, isfinite
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
    """Write a telegram of the one record.

    Raises
    ------
    ValueError
        If no block can say the record, or it lacks what the block needs.
    """
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
        temperature_c=None if warm is None else _known(_first(heard, warm)),
    )


def _compensated(heard: Heard, places: Places) -> Record:
    turning, moving = _vector(heard, places[0], DEG), _vector(heard, places[1])
    lost = (turning is UNSET and places[0]) or (moving is UNSET and places[1])
    return CompensatedRecord(
        **heard.arrival,
        sequence=heard.counter,
        t_device_s=heard.validity * TICK_S,
        valid=not lost and plausible(turning or _ZERO, moving or _ZERO),
        rate_rad_s=turning,
        acceleration_m_s2=moving,
    )


def _attitude(heard: Heard, places: Places) -> Record:
    attitude, sd = _vector(heard, places[0]), _vector(heard, places[1])
    heading, roll, pitch = attitude or (None, None, None)
    return HeadingRecord(
        **heard.arrival,
        heading_deg=heading,
        roll_deg=roll,
        pitch_deg=None if pitch is None else -pitch,
        t_device_s=heard.validity * TICK_S,
        valid=attitude is not UNSET,
        sd_deg=sd[0] if sd else UNSET,
    )


def _gnss(heard: Heard, at: int) -> Record:
    tag, source, quality, lat, lon, altitude, *sd, _, geoid = GNSS_BLOCK.unpack_from(
        heard.telegram, at
    )
    geoid_m = _known(geoid) or heard.options.geoid_m
    is_place = _finite((lat, lon, altitude))
    return GnssRecord(
        **heard.told(tag),
        valid=quality > 0 and source != MANUAL_GNSS and is_place,
        t_device_s=tag * TICK_S,
        lat_deg=lat if is_place else None,
        lon_deg=_east(lon) if is_place else None,
        height_m=altitude + geoid_m if is_place and geoid_m is not None else None,
        geoid_m=geoid_m,
        quality=quality,
        sd_m=_triple(*sd),
    )


def _usbl(heard: Heard, at: int) -> Record:
    tag, _, beacon, lat, lon, altitude, *_ = USBL_BLOCK.unpack_from(heard.telegram, at)
    is_place = _finite((lat, lon, altitude))
    return UsblRecord(
        **heard.told(tag),
        beacon=_name(beacon),
        t_device_s=tag * TICK_S,
        valid=is_place,
        lat_deg=lat if is_place else UNSET,
        lon_deg=_east(lon) if is_place else UNSET,
        depth_m=-altitude if is_place else UNSET,
    )


def _depth(heard: Heard, at: int) -> Record:
    tag, depth, sd = DEPTH_BLOCK.unpack_from(heard.telegram, at)
    return DepthRecord(
        **heard.told(tag),
        depth_m=_known(depth),
        t_device_s=tag * TICK_S,
        valid=isfinite(depth),
        sd_m=sd if isfinite(sd) else UNSET,
    )


def _bottom(heard: Heard, at: int) -> Record:
    tag, _, forward, port, up, sound, altitude, *sd = BOTTOM_BLOCK.unpack_from(heard.telegram, at)
    velocity = _triple(forward, -port, -up)
    return DvlRecord(
        **heard.told(tag),
        velocity_m_s=velocity or None,
        t_device_s=tag * TICK_S,
        valid=velocity is not UNSET,
        altitude_m=altitude if 0 < altitude < inf else None,
        sd_m_s=_triple(*sd),
        sound_speed_m_s=sound if isfinite(sound) else UNSET,
    )


def _water(heard: Heard, at: int) -> Record:
    tag, _, forward, port, up, sound, *_ = WATER_BLOCK.unpack_from(heard.telegram, at)
    return DvlRecord(
        **heard.told(tag),
        t_device_s=tag * TICK_S,
        valid=False,
        water_velocity_m_s=_triple(forward, -port, -up),
        sound_speed_m_s=sound if isfinite(sound) else UNSET,
    )


def _lbl(heard: Heard, at: int) -> Record:
    tag, _, beacon, _, _, _, range_m, _ = LBL_BLOCK.unpack_from(heard.telegram, at)
    return LblRecord(
        **heard.told(tag),
        replies=(LblReply(beacon=_name(beacon), range_m=_known(range_m)),),
        t_ping_s=tag * TICK_S,
        valid=0 < range_m < inf,
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
    """What is no number in any of three is not there."""
    if at is None:
        return UNSET
    x, y, z = VECTOR.unpack_from(heard.telegram, at)
    return _triple(x * unit, y * unit, z * unit)


def _triple(x: float, y: float, z: float) -> Vec3 | UnsetType:
    return (x, y, z) if isfinite(x + y + z) else UNSET


def _first(heard: Heard, at: int) -> float:
    value: float = VECTOR.unpack_from(heard.telegram, at)[0]
    return value


def _known(value: float) -> float | None:
    return value if isfinite(value) else None


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
