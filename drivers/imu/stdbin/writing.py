"""Records to STDBIN telegrams: each becomes the block that says it."""

from collections.abc import Callable
from typing import Any

from msgspec import UNSET

from drivers.imu.sample import DEG, acceleration, rotation
from drivers.imu.stdbin import layout
from drivers.imu.stdbin.blocks import (
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
from drivers.records import (
    CompensatedRecord,
    DepthRecord,
    DvlRecord,
    GnssRecord,
    HeadingRecord,
    ImuRecord,
    LblRecord,
    Record,
    UsblRecord,
)

_ZERO = (0.0, 0.0, 0.0)


def write_telegram(record: Record, version: int) -> bytes:
    """Write a telegram of the one record; raises ValueError if no block can say it."""
    write = _WRITERS.get(type(record))
    if write is None:
        raise ValueError(f"stdbin cannot say a {type(record).__name__}")
    t_s = record.t_ping_s if isinstance(record, LblRecord) else getattr(record, "t_device_s", None)
    tag = round((t_s or 0.0) / TICK_S) % DAY_TICKS
    age_s = getattr(record, "age_s", UNSET)
    age = 0 if age_s is UNSET else round(age_s / TICK_S)
    counter = (getattr(record, "sequence", None) or 0) % 2**32
    return layout.write(version, (tag + age) % DAY_TICKS, counter, write(record, tag))


def _write_sample(record: ImuRecord, _tag: int) -> dict[int, bytes]:
    gyro, accel = rotation(record, increment=False), acceleration(record, increment=False)
    blocks = {
        FORCE: VECTOR.pack(*accel),
        RATE: VECTOR.pack(*(value / DEG for value in gyro)),
    }
    if record.temperature_c is not None:
        blocks[TEMPERATURES] = VECTOR.pack(*3 * (record.temperature_c,))
    return blocks


def _write_compensated(record: CompensatedRecord, _tag: int) -> dict[int, bytes]:
    if not (record.rate_rad_s and record.acceleration_m_s2):
        raise ValueError("the record does not carry rate_rad_s and acceleration_m_s2")
    return {
        TURNING: VECTOR.pack(*(value / DEG for value in record.rate_rad_s)),
        MOVING: VECTOR.pack(*record.acceleration_m_s2),
    }


def _write_heading(record: HeadingRecord, _tag: int) -> dict[int, bytes]:
    pitch = -(record.pitch_deg or 0.0)
    attitude = record.heading_deg or 0.0, record.roll_deg or 0.0, pitch
    blocks = {HEADING: VECTOR.pack(*attitude)}
    if record.sd_deg is not UNSET:
        blocks[HEADING_SD] = VECTOR.pack(record.sd_deg, 0.0, 0.0)
    return blocks


def _write_gnss(record: GnssRecord, tag: int) -> dict[int, bytes]:
    geoid = record.geoid_m or 0.0
    altitude = (record.height_m or 0.0) - geoid
    place = record.lat_deg or 0.0, (record.lon_deg or 0.0) % 360
    quality = record.quality if record.quality is not None else int(record.valid)
    sd = _ZERO if record.sd_m is UNSET else record.sd_m
    return {GNSS: GNSS_BLOCK.pack(tag, 0, quality, *place, altitude, *sd, 0.0, geoid)}


def _write_usbl(record: UsblRecord, tag: int) -> dict[int, bytes]:
    if record.lat_deg is UNSET or record.lon_deg is UNSET:
        raise ValueError("the record does not carry latitude and longitude")
    altitude = -(record.depth_m or 0.0)
    place = record.lat_deg, record.lon_deg % 360, altitude
    beacon = record.beacon.encode()[:8]
    return {USBL: USBL_BLOCK.pack(tag, 0, beacon, *place, 0.0, 0.0, 0.0, 0.0)}


def _write_depth(record: DepthRecord, tag: int) -> dict[int, bytes]:
    sd = 0.0 if record.sd_m is UNSET else record.sd_m
    return {DEPTH: DEPTH_BLOCK.pack(tag, record.depth_m or 0.0, sd)}


def _write_dvl(record: DvlRecord, tag: int) -> dict[int, bytes]:
    sound = 0.0 if record.sound_speed_m_s is UNSET else record.sound_speed_m_s
    if record.velocity_m_s is None:
        x, y, z = record.water_velocity_m_s or _ZERO
        return {WATER: WATER_BLOCK.pack(tag, 0, x, -y, -z, sound, *_ZERO)}
    x, y, z = record.velocity_m_s
    sd = _ZERO if record.sd_m_s is UNSET else record.sd_m_s
    altitude = record.altitude_m or 0.0
    return {BOTTOM: BOTTOM_BLOCK.pack(tag, 0, x, -y, -z, sound, altitude, *sd)}


def _write_lbl(record: LblRecord, tag: int) -> dict[int, bytes]:
    return {
        LBL + n: LBL_BLOCK.pack(tag, 0, reply.beacon.encode()[:8], 0, 0, 0, reply.range_m or 0, 0)
        for n, reply in enumerate(record.replies[:4])
    }


_WRITERS: dict[type, Callable[[Any, int], dict[int, bytes]]] = {
    ImuRecord: _write_sample,
    CompensatedRecord: _write_compensated,
    HeadingRecord: _write_heading,
    GnssRecord: _write_gnss,
    UsblRecord: _write_usbl,
    DepthRecord: _write_depth,
    DvlRecord: _write_dvl,
    LblRecord: _write_lbl,
}
