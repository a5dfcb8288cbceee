"""The blocks of devices: what each is, where its bytes come from, and how wrong it may be."""

from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, field

from drivers.settings import Link
from gateway.config.block import Angles, Block, NonNegative, Positive, PositiveTriple, Triple

DeviceKind = Literal["imu", "usbl", "lbl", "gnss", "depth", "dvl", "heading"]


class Clock(Block, frozen=True):
    """How a device's receive times become times of validity."""

    source: Literal["arrival", "device", "pps"] = "arrival"
    latency_ms: NonNegative = 0.0
    pulses: str | None = None
    """The file in which the kernel tells the edges of a pulse per second."""


class ImuNoise(Block, frozen=True):
    """Error budget of an IMU. A bias is constant unless a correlation time is given."""

    angle_random_walk_deg_sqrt_h: Positive
    gyro_bias_deg_h: NonNegative
    velocity_random_walk_ug_sqrt_hz: Positive
    accel_bias_ug: NonNegative
    gyro_bias_correlation_s: Positive | None = None
    accel_bias_correlation_s: Positive | None = None


class UsblNoise(Block, frozen=True):
    """White errors of one fix, 1 sigma."""

    bearing_deg: Positive
    elevation_deg: Positive
    range_m: Positive
    range_rate_m_s: Positive = 0.05
    tilt_deg: NonNegative = 0.0
    """Of the instrument's own motion sensor, where it has taken out roll and pitch."""
    heading_deg: NonNegative = 0.0
    """Of its own compass, where it has turned its fixes north."""


class GnssNoise(Block, frozen=True):
    """White errors of one fix, 1 sigma: north, east, down; each component of the velocity."""

    position_m: PositiveTriple
    velocity_m_s: Positive


class LblNoise(Block, frozen=True):
    """White errors of one reply, 1 sigma."""

    range_m: Positive
    range_rate_m_s: Positive = 0.05


class DepthNoise(Block, frozen=True):
    """White error of one depth, 1 sigma; waves are in it near the surface."""

    depth_m: Positive


class DvlNoise(Block, frozen=True):
    """White errors of one ping, 1 sigma: forward, starboard, down in the log's own axes."""

    velocity_m_s: PositiveTriple


class HeadingNoise(Block, frozen=True):
    """White error of one heading, 1 sigma."""

    heading_deg: Positive


class UsblPrior(Block, frozen=True):
    """1-sigma of the constant acoustic errors to estimate; 0 takes one as known."""

    mounting_deg: NonNegative = 0.0
    bearing_deg: NonNegative = 0.0
    elevation_deg: NonNegative = 0.0
    range_scale: NonNegative = 0.0
    lever_arm_m: NonNegative = 0.0
    latency_ms: NonNegative = 0.0


class LblPrior(Block, frozen=True):
    """1-sigma of the constant errors of ranges to estimate; 0 takes one as known."""

    range_scale: NonNegative = 0.0
    lever_arm_m: NonNegative = 0.0
    latency_ms: NonNegative = 0.0


class _Device(Block, frozen=True, kw_only=True):
    """What every device has: its wire format, where its bytes come from, and their time."""

    codec: str
    link: Link
    options: dict[str, Any] = field(default_factory=dict)
    clock: Clock = Clock()


class ImuDevice(_Device, frozen=True, kw_only=True, tag_field="kind", tag="imu"):
    """An inertial measurement unit."""

    kind: ClassVar[DeviceKind] = "imu"

    rate_hz: Annotated[float, Meta(gt=0, le=10_000)]
    noise: ImuNoise
    mounting_deg: Angles = (0.0, 0.0, 0.0)


class UsblDevice(_Device, frozen=True, kw_only=True, tag_field="kind", tag="usbl"):
    """An ultra-short-baseline array on the vehicle."""

    kind: ClassVar[DeviceKind] = "usbl"

    noise: UsblNoise
    mounting_deg: Angles = (0.0, 0.0, 0.0)
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    elements_m: tuple[Triple, ...] = ()
    """Places of the elements in array axes; radial rates refer to the array's origin without."""
    direction: Literal["told", "differences"] = "told"
    """Whether angles are taken as told, or made of the elements' time differences."""
    looks: Literal["down", "up"] = "down"
    """On which side of the elements' plane the beacons are."""
    navigates_by: Literal["itself", "gateway"] = "itself"
    """Whose attitude and place the topside uses where it levels, turns or places its fixes."""
    range_limits_m: tuple[NonNegative, Positive] | None = None
    """Slant ranges outside are not valid."""
    radial_rate: Literal["mean", "elements"] = "mean"
    prior: UsblPrior = UsblPrior()


class LblDevice(_Device, frozen=True, kw_only=True, tag_field="kind", tag="lbl"):
    """A transducer that interrogates moored transponders: ranges, no angles."""

    kind: ClassVar[DeviceKind] = "lbl"

    noise: LblNoise
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    beacons: tuple[str, ...] = ()
    """Whom it interrogates; all beacons of the file unless named."""
    prior: LblPrior = LblPrior()


class GnssDevice(_Device, frozen=True, kw_only=True, tag_field="kind", tag="gnss"):
    """A satellite receiver; the lever arm is its antenna's."""

    kind: ClassVar[DeviceKind] = "gnss"

    noise: GnssNoise
    lever_arm_m: Triple = (0.0, 0.0, 0.0)


class DepthDevice(_Device, frozen=True, kw_only=True, tag_field="kind", tag="depth"):
    """A pressure sensor; the height of the surface above it must be known."""

    kind: ClassVar[DeviceKind] = "depth"

    noise: DepthNoise
    surface_height_m: float
    """Of the water's surface above the ellipsoid: geoid and tide."""
    lever_arm_m: Triple = (0.0, 0.0, 0.0)


class DvlDevice(_Device, frozen=True, kw_only=True, tag_field="kind", tag="dvl"):
    """A Doppler velocity log that tracks the bottom."""

    kind: ClassVar[DeviceKind] = "dvl"

    noise: DvlNoise
    mounting_deg: Angles = (0.0, 0.0, 0.0)
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    scale: Annotated[float, Meta(ge=0.9, le=1.1)] = 1.0
    """True speed of sound at its transducers over the one it was told."""


class HeadingDevice(_Device, frozen=True, kw_only=True, tag_field="kind", tag="heading"):
    """A compass of true north."""

    kind: ClassVar[DeviceKind] = "heading"

    noise: HeadingNoise
    mounting_deg: Angles = (0.0, 0.0, 0.0)


Device = ImuDevice | UsblDevice | LblDevice | GnssDevice | DepthDevice | DvlDevice | HeadingDevice
