"""What a codec makes of bytes: one frozen record for each frame, or a `Rejected`.

A record speaks in the instrument's own axes and in SI units (angles of acoustic records in degrees,
as on every edge of the program). Mounting, time of validity and meaning for the filter are not its
business: `gateway.ingest` gives it those.

Arrival
-------
``t_rx_ns`` is the host's monotonic stamp of the chunk that holds the frame's *first* byte, and
``line_bytes`` the number of bytes from that first byte to the chunk's end. On a serial line the
first byte came ``line_bytes`` byte-times before the stamp; on a packet link it came with the stamp.
Where the instrument itself says how old its measurement was when it spoke, ``age_s`` holds that.

Common names
------------
``t_device_s`` is the instrument's own time of the measurement (since it was switched on, of the
UTC day or since 1970, as its format has it), ``sequence`` its count of frames, modulo what the
format holds. ``valid`` says whether the instrument vouches for the measurement; where it says why
not, ``error_code`` has its word. ``sd_…`` is 1 sigma by the instrument itself.
"""

from typing import Literal

import msgspec
from msgspec import UNSET, UnsetType

Vec3 = tuple[float, float, float]
Axes = Literal["sensor", "level", "north"]
Reason = Literal["checksum", "length", "syntax", "range", "unknown"]


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """When the first byte of a frame was seen."""

    t_rx_ns: int
    line_bytes: int = 0


class Measured(Arrival, frozen=True, kw_only=True):
    """A measurement; ``age_s`` from the moment it was true to the frame's first byte, if told."""

    age_s: float | UnsetType = UNSET


class ImuRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="imu"):
    """One sample of an inertial measurement unit, in the sensor's own axes.

    Exactly one of ``rate_rad_s`` / ``delta_angle_rad`` and exactly one of ``specific_force_m_s2`` /
    ``delta_velocity_m_s`` is set: what the frame carries is not converted here, because the
    interval it covers is a question of clocks; ``interval_s`` is set where the frame says it. A
    sample that lacks rotation or acceleration is not ``valid``. ``since_pulse_s`` is the time from
    the last pulse on the unit's synchronisation input to the sample; ``magnetic_gauss`` what one
    axis of a magnetometer says, where frames carry one at a time.
    """

    sequence: int | None = None
    t_device_s: float | None = None
    valid: bool = True
    rate_rad_s: Vec3 | UnsetType = UNSET
    delta_angle_rad: Vec3 | UnsetType = UNSET
    specific_force_m_s2: Vec3 | UnsetType = UNSET
    delta_velocity_m_s: Vec3 | UnsetType = UNSET
    interval_s: float | UnsetType = UNSET
    since_pulse_s: float | UnsetType = UNSET
    temperature_c: float | None = None
    magnetic_gauss: tuple[Literal["x", "y", "z"], float] | UnsetType = UNSET


class CompensatedRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="compensated"):
    """What an instrument's own filter left of an inertial sample, in its own axes.

    Its estimates of bias, the Earth's rotation and gravity are gone from it, so that it says how
    the vehicle moves over the Earth: for looking at, never for a strapdown.
    """

    sequence: int | None = None
    t_device_s: float | None = None
    valid: bool = True
    rate_rad_s: Vec3 | UnsetType = UNSET
    delta_angle_rad: Vec3 | UnsetType = UNSET
    acceleration_m_s2: Vec3 | UnsetType = UNSET
    delta_velocity_m_s: Vec3 | UnsetType = UNSET


class TimeDifference(msgspec.Struct, frozen=True, kw_only=True):
    """How much later sound reached one element of an array than another (s)."""

    element: str
    than: str
    delay_s: float


class UsblRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="usbl"):
    """One acoustic fix: a beacon seen from the array (x forward, y starboard, z down).

    ``bearing_deg`` = atan2(y, x), positive to starboard; ``elevation_deg`` =
    atan2(-z, hypot(x, y)), positive up, so a beacon below is negative. What a sentence does not
    carry is None. ``axes`` says what bearing and xyz refer to: the array itself, the same levelled
    (roll and pitch taken out), or north/east/down where the topside has already turned them.
    ``one_way_s`` is the sound's way from the beacon, ``differences`` what direction is made of;
    ``range_rate_m_s`` is positive when the distance grows. ``lat_deg`` and ``lon_deg`` are the
    beacon's place (WGS84), ``depth_m`` its depth below the surface.
    """

    beacon: str
    bearing_deg: float | None = None
    elevation_deg: float | None = None
    slant_range_m: float | None = None
    xyz_m: Vec3 | None = None
    t_device_s: float | None = None
    valid: bool = True
    error_code: str | None = None
    range_rate_m_s: float | None = None
    axes: Literal["array", "level", "north"] = "array"
    lat_deg: float | UnsetType = UNSET
    lon_deg: float | UnsetType = UNSET
    depth_m: float | UnsetType = UNSET
    one_way_s: float | UnsetType = UNSET
    differences: tuple[TimeDifference, ...] | UnsetType = UNSET


class LblReply(msgspec.Struct, frozen=True, kw_only=True):
    """What one transponder's reply says: the sound's way to it in time or in metres, or its rate.

    ``one_way_s`` is half the way there and back, without the transponder's own delay;
    ``range_rate_m_s`` is positive when the distance grows.
    """

    beacon: str
    one_way_s: float | None = None
    range_m: float | None = None
    range_rate_m_s: float | None = None


class LblRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="lbl"):
    """The replies to one interrogation of a long baseline; who did not answer is not in it.

    ``t_ping_s`` is when the interrogation left, by the instrument's own clock.
    """

    replies: tuple[LblReply, ...]
    t_ping_s: float | None = None
    valid: bool = True


class GnssRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="gnss"):
    """What one sentence of a satellite receiver says: a position, a velocity, or both.

    ``height_m`` is the antenna's height above the WGS84 ellipsoid, ``geoid_m`` the geoid's;
    speed and true course are over ground, ``t_device_s`` is the second of the UTC day. What a
    sentence does not carry, or leaves empty, is None. ``valid`` says that the receiver measured:
    what it estimates, simulates or was told is not. A block of binary data has no ``sentence``.
    """

    sentence: Literal["GGA", "GNS", "RMC", "VTG"] | None = None
    valid: bool
    t_device_s: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    height_m: float | None = None
    geoid_m: float | None = None
    speed_m_s: float | None = None
    course_deg: float | None = None
    quality: int | None = None
    mode: str | None = None
    satellites: int | None = None
    hdop: float | None = None
    sd_m: Vec3 | UnsetType = UNSET
    """1-sigma north, east, down."""


class DepthRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="depth"):
    """How deep a sensor is below the surface, how high above the bottom, or both.

    ``pressure_pa`` is absolute, as measured; ``depth_m`` what the instrument or the codec's options
    made of it.
    """

    depth_m: float | None = None
    altitude_m: float | UnsetType = UNSET
    pressure_pa: float | UnsetType = UNSET
    temperature_c: float | UnsetType = UNSET
    t_device_s: float | None = None
    valid: bool = True
    sd_m: float | UnsetType = UNSET


class DvlRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="dvl"):
    """One ping of a Doppler log: velocity over the bottom, forward, starboard, down.

    ``axes`` says what the components refer to: the instrument's own axes, the same levelled by its
    own tilt sensors, or north/east/down. Without bottom lock ``velocity_m_s`` is None and the
    record is not ``valid``. ``altitude_m`` is the height above the bottom, ``error_velocity_m_s``
    by how much the beams contradict each other, ``water_velocity_m_s`` the velocity through water
    in the same axes.
    """

    velocity_m_s: Vec3 | None = None
    axes: Axes = "sensor"
    t_device_s: float | None = None
    valid: bool = True
    error_code: str | None = None
    altitude_m: float | None = None
    sd_m_s: Vec3 | UnsetType = UNSET
    error_velocity_m_s: float | UnsetType = UNSET
    water_velocity_m_s: Vec3 | UnsetType = UNSET
    sound_speed_m_s: float | UnsetType = UNSET
    """What the instrument took the speed of sound at its face to be."""


class HeadingRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="heading"):
    """Heading clockwise from north; roll positive starboard down, pitch positive bow up."""

    heading_deg: float | None = None
    reference: Literal["true", "magnetic"] = "true"
    roll_deg: float | None = None
    pitch_deg: float | None = None
    t_device_s: float | None = None
    valid: bool = True
    sd_deg: float | UnsetType = UNSET
    """1-sigma of the heading."""


class TimeRecord(Measured, frozen=True, kw_only=True, tag_field="record", tag="time"):
    """The time of day with its date, as the instrument's clock has it: ``unix_s``, UTC."""

    unix_s: float | None = None
    valid: bool = True


class DeviceStatus(Arrival, frozen=True, kw_only=True, tag_field="record", tag="status"):
    """What an instrument says about its own health (built-in test and the like)."""

    healthy: bool
    failed: tuple[str, ...] = ()


class NmeaSentence(Arrival, frozen=True, kw_only=True, tag_field="record", tag="nmea"):
    """A sentence of NMEA 0183 whose checksum held; ``fields`` as sent, without the address."""

    talker: str
    formatter: str
    fields: tuple[str, ...]


class OtherFrame(Arrival, frozen=True, kw_only=True, tag_field="record", tag="other"):
    """A frame whose check holds and of which nothing here makes use; ``name`` as its maker's."""

    name: str
    data: bytes = msgspec.field(name="bytes")


class Rejected(Arrival, frozen=True, kw_only=True, tag_field="record", tag="rejected"):
    """Bytes that made no record, and why. Nothing that arrives is dropped without one of these."""

    reason: Reason
    data: bytes = msgspec.field(name="bytes")


Record = (
    ImuRecord
    | CompensatedRecord
    | UsblRecord
    | LblRecord
    | GnssRecord
    | DepthRecord
    | DvlRecord
    | HeadingRecord
    | TimeRecord
    | DeviceStatus
    | NmeaSentence
    | OtherFrame
)


def to_json(record: Record | Rejected) -> bytes:
    """Write a record as one line of JSON (no newline); bytes are printed as hex."""
    if not isinstance(record, Rejected | OtherFrame):
        return msgspec.json.encode(record)
    fields = msgspec.structs.asdict(record)
    raw = fields.pop("data").hex()
    tag = record.__struct_config__.tag
    return msgspec.json.encode({"record": tag, **fields, "bytes": raw})
