"""The blocks of the configuration file: every key with its type, bounds and default."""

from typing import Annotated, Any, ClassVar, Literal, get_args

import msgspec
from msgspec import Meta

from drivers.settings import Link
from gateway.config.nmea import Name, NmeaOutput
from gateway.config.zenoh import ZenohOutput

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=360)]
Triple = tuple[float, float, float]
Angle = Annotated[float, Meta(ge=-360, le=360)]
Angles = tuple[Angle, Angle, Angle]
PositiveTriple = tuple[Positive, Positive, Positive]
SigmaTriple = tuple[NonNegative, NonNegative, NonNegative]
DeviceKind = Literal["imu", "usbl", "lbl", "gnss", "depth", "dvl", "heading"]


class _Block(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A block of the file: unknown keys are errors."""


class Clock(_Block, frozen=True):
    """How a device's receive times become times of validity."""

    source: Literal["arrival", "device", "pps"] = "arrival"
    latency_ms: NonNegative = 0.0
    pulses: str | None = None
    """The file in which the kernel tells the edges of a pulse per second."""


class ImuNoise(_Block, frozen=True):
    """Error budget of an IMU. A bias is constant unless a correlation time is given."""

    angle_random_walk_deg_sqrt_h: Positive
    gyro_bias_deg_h: NonNegative
    velocity_random_walk_ug_sqrt_hz: Positive
    accel_bias_ug: NonNegative
    gyro_bias_correlation_s: Positive | None = None
    accel_bias_correlation_s: Positive | None = None


class UsblNoise(_Block, frozen=True):
    """White errors of one fix, 1 sigma."""

    bearing_deg: Positive
    elevation_deg: Positive
    range_m: Positive
    range_rate_m_s: Positive = 0.05
    tilt_deg: NonNegative = 0.0
    """Of the instrument's own motion sensor, where it has taken out roll and pitch."""
    heading_deg: NonNegative = 0.0
    """Of its own compass, where it has turned its fixes north."""


class GnssNoise(_Block, frozen=True):
    """White errors of one fix, 1 sigma: north, east, down; each component of the velocity."""

    position_m: PositiveTriple
    velocity_m_s: Positive


class LblNoise(_Block, frozen=True):
    """White errors of one reply, 1 sigma."""

    range_m: Positive
    range_rate_m_s: Positive = 0.05


class DepthNoise(_Block, frozen=True):
    """White error of one depth, 1 sigma; waves are in it near the surface."""

    depth_m: Positive


class DvlNoise(_Block, frozen=True):
    """White errors of one ping, 1 sigma: forward, starboard, down in the log's own axes."""

    velocity_m_s: PositiveTriple


class HeadingNoise(_Block, frozen=True):
    """White error of one heading, 1 sigma."""

    heading_deg: Positive


class UsblPrior(_Block, frozen=True):
    """1-sigma of the constant acoustic errors to estimate; 0 takes one as known."""

    mounting_deg: NonNegative = 0.0
    bearing_deg: NonNegative = 0.0
    elevation_deg: NonNegative = 0.0
    range_scale: NonNegative = 0.0
    lever_arm_m: NonNegative = 0.0
    latency_ms: NonNegative = 0.0


class LblPrior(_Block, frozen=True):
    """1-sigma of the constant errors of ranges to estimate; 0 takes one as known."""

    range_scale: NonNegative = 0.0
    lever_arm_m: NonNegative = 0.0
    latency_ms: NonNegative = 0.0


class _Device(_Block, frozen=True, kw_only=True):
    """What every device has: its wire format, where its bytes come from, and their time."""

    codec: str
    link: Link
    options: dict[str, Any] = {}
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


class Beacon(_Block, frozen=True, tag_field="role", tag="moored"):
    """A transponder moored at a known place: the role where none is given."""

    is_meant_untagged: ClassVar[bool] = True

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float
    turnaround_ms: NonNegative = 0.0
    travel: Literal["two_way", "one_way"] = "two_way"


class Target(_Block, frozen=True, tag_field="role", tag="target"):
    """A transponder on something that moves: it is followed, and says nothing of our own place."""

    name: Name
    turnaround_ms: NonNegative = 0.0
    travel: Literal["two_way", "one_way"] = "two_way"
    acceleration_m_s2: Positive = 0.05
    """White noise of its acceleration over one second: how sharply it may turn."""
    max_age_s: Positive = 30.0
    """Without a fix for longer it is lost."""


class Filter(_Block, frozen=True):
    """The estimator's choices."""

    error: Literal["right_invariant", "left_invariant", "additive"] = "right_invariant"
    coupling: Literal["tight", "loose"] = "tight"
    loose_noise: Literal["mapped", "fixed"] = "mapped"
    loose_sigma_m: Positive = 1.0
    """White error of each component of a loose position where its noise is fixed."""
    robust: Literal["none", "huber", "student_t"] = "none"
    """How an unlikely fix that the gate lets through is weighed."""
    adaptive_noise: bool = False
    """Whether a device's noise is learnt from its innovations, within a third to three times."""
    innovation_gate: Annotated[float, Meta(gt=0.5, lt=1)] = 0.999
    history_s: Annotated[float, Meta(gt=0, le=120)] = 10.0
    max_gap_s: Annotated[float, Meta(gt=0, le=3600)] = 30.0
    """Longest silence of the IMU that is bridged; after more the filter begins again."""
    max_fix_age_s: Positive = 10.0


class StartSigma(_Block, frozen=True):
    """1-sigma of the initial solution: north, east, down; velocity; roll, pitch, heading."""

    position_m: SigmaTriple
    velocity_m_s: Positive
    attitude_deg: SigmaTriple | None = None


class InitialSigma(StartSigma, frozen=True):
    """The same where the attitude is given."""

    attitude_deg: SigmaTriple


class Align(_Block, frozen=True):
    """How the first attitude is found: roll and pitch by the IMU, the heading as it says."""

    heading: Literal["config", "gyrocompass", "gnss_course", "unknown"] = "config"
    level_s: Annotated[float, Meta(ge=5, le=600)] = 30.0
    gyrocompass_s: Annotated[float, Meta(ge=60, le=3600)] = 300.0
    crab_deg: NonNegative = 5.0
    """1-sigma of the angle between bow and course, which current and wind make."""

    @property
    def window_s(self) -> float:
        """How long the samples are that it is found from."""
        return self.gyrocompass_s if self.heading == "gyrocompass" else self.level_s


class Initial(_Block, frozen=True, kw_only=True):
    """Where the first solution comes from; the attitude may be left to `align`."""

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float
    attitude_deg: Angles | None = None
    sigma: StartSigma
    velocity_ned_m_s: Triple = (0.0, 0.0, 0.0)
    align: Align | None = None


Output = NmeaOutput | ZenohOutput


class Realtime(_Block, frozen=True):
    """What the system is asked for so that nothing else holds up navigation."""

    priority: Annotated[int, Meta(ge=1, le=98)] | None = None
    """Of SCHED_FIFO, for the daemon and the filter."""
    lock_memory: bool = False
    wake_us: Annotated[int, Meta(ge=0, le=1_000_000)] | None = None
    """Longest that an idle core may sleep on when it is wanted; 0 keeps cores awake."""


class StateFile(_Block, frozen=True):
    """Where the newest state is kept, for a gateway that was away to begin with again.

    Without a file it is ``state`` in the folder that the service manager gives, if it does.
    """

    file: Annotated[str, Meta(min_length=1)] | None = None
    max_age_s: NonNegative = 300.0
    period_s: Positive = 2.0
    """How often it is written."""


class Recording(_Block, frozen=True):
    """Everything written down as MCAP files, for replays and for Foxglove."""

    folder: Annotated[str, Meta(min_length=1)]
    """It must exist; relative to where the daemon runs."""
    max_file_mb: Annotated[float, Meta(ge=0.1, le=10_000)] = 100.0
    max_file_s: Annotated[float, Meta(ge=1, le=86_400)] = 3600.0
    quota_mb: Annotated[float, Meta(gt=0)] = 10_000.0
    """For all recordings of the vehicle in the folder; beyond it the oldest are removed."""
    records: bool = True
    """Whether decoded records are written beside the bytes, to be looked at."""


class Config(_Block, frozen=True):
    """The whole file."""

    vehicle: Name
    devices: dict[Name, Device]
    initial: Initial
    beacons: dict[str, Beacon | Target] = {}
    sound_speed_m_s: Annotated[float, Meta(ge=1300, le=1700)] = 1500.0
    filter: Filter = Filter()
    state: StateFile = StateFile()
    outputs: tuple[Output, ...] = ()
    realtime: Realtime = Realtime()
    recording: Recording | None = None

    @property
    def lines(self) -> tuple[tuple[str, ...], ...]:
        """Names of the devices line by line: those of the same link and codec share one.

        The first of a line gives it its name; which one that is depends on the kinds alone.
        """
        sharing: dict[object, list[str]] = {}
        for name, device in self.devices.items():
            sharing.setdefault((device.link, device.codec), []).append(name)
        kinds = get_args(DeviceKind)
        return tuple(
            tuple(sorted(names, key=lambda name: kinds.index(self.devices[name].kind)))
            for names in sharing.values()
        )

    @property
    def imu(self) -> tuple[str, ImuDevice]:
        """Name and block of the one IMU (its presence is checked by `load`)."""
        return next((n, d) for n, d in self.devices.items() if isinstance(d, ImuDevice))

    @property
    def usbl(self) -> dict[str, UsblDevice]:
        """The acoustic arrays by name."""
        return {n: d for n, d in self.devices.items() if isinstance(d, UsblDevice)}

    @property
    def lbl(self) -> dict[str, LblDevice]:
        """The interrogators of moored transponders by name."""
        return {n: d for n, d in self.devices.items() if isinstance(d, LblDevice)}

    @property
    def moored(self) -> dict[str, Beacon]:
        """The beacons whose place is known, by address."""
        return {n: b for n, b in self.beacons.items() if isinstance(b, Beacon)}

    @property
    def targets(self) -> dict[str, Target]:
        """The beacons that are followed, by address."""
        return {n: b for n, b in self.beacons.items() if isinstance(b, Target)}

    @property
    def acoustic(self) -> dict[str, UsblDevice | LblDevice]:
        """All that hear beacons, by name."""
        return {**self.usbl, **self.lbl}

    @property
    def gnss(self) -> dict[str, GnssDevice]:
        """The satellite receivers by name."""
        return {n: d for n, d in self.devices.items() if isinstance(d, GnssDevice)}
