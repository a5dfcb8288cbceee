"""The blocks of the configuration file: every key with its type, bounds and default."""

from typing import Annotated, ClassVar, Literal, get_args

from msgspec import Meta, field

from gateway.config.block import (
    Angles,
    Block,
    Latitude,
    Longitude,
    Name,
    NonNegative,
    Positive,
    SigmaTriple,
    SoundSpeed,
    Triple,
)
from gateway.config.devices import Device, DeviceKind, GnssDevice, ImuDevice, LblDevice, UsblDevice
from gateway.config.nmea import NmeaOutput
from gateway.config.zenoh import ZenohOutput


class Beacon(Block, frozen=True, tag_field="role", tag="moored"):
    """A transponder moored at a known place: the role where none is given."""

    is_meant_untagged: ClassVar[bool] = True

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float
    turnaround_ms: NonNegative = 0.0
    travel: Literal["two_way", "one_way"] = "two_way"


class Target(Block, frozen=True, tag_field="role", tag="target"):
    """A transponder on something that moves: it is followed, and says nothing of our own place."""

    name: Name
    turnaround_ms: NonNegative = 0.0
    travel: Literal["two_way", "one_way"] = "two_way"
    acceleration_m_s2: Positive = 0.05
    """White noise of its acceleration over one second: how sharply it may turn."""
    max_age_s: Positive = 30.0
    """Without a fix for longer it is lost."""


class Filter(Block, frozen=True):
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


class StartSigma(Block, frozen=True):
    """1-sigma of the initial solution: north, east, down; velocity; roll, pitch, heading."""

    position_m: SigmaTriple
    velocity_m_s: Positive
    attitude_deg: SigmaTriple | None = None


class InitialSigma(StartSigma, frozen=True):
    """The same where the attitude is given."""

    attitude_deg: SigmaTriple


class Align(Block, frozen=True):
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


class Initial(Block, frozen=True, kw_only=True):
    """Where the first solution comes from; the attitude may be left to `align`."""

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float
    attitude_deg: Angles | None = None
    sigma: StartSigma
    velocity_ned_m_s: Triple = (0.0, 0.0, 0.0)
    align: Align | None = None


Output = NmeaOutput | ZenohOutput


class Realtime(Block, frozen=True):
    """What the system is asked for so that nothing else holds up navigation."""

    priority: Annotated[int, Meta(ge=1, le=98)] | None = None
    """Of SCHED_FIFO, for the daemon and the filter."""
    lock_memory: bool = False
    wake_us: Annotated[int, Meta(ge=0, le=1_000_000)] | None = None
    """Longest that an idle core may sleep on when it is wanted; 0 keeps cores awake."""


class StateFile(Block, frozen=True):
    """Where the newest state is kept, for a gateway that was away to begin with again.

    Without a file it is ``state`` in the folder that the service manager gives, if it does.
    """

    file: Annotated[str, Meta(min_length=1)] | None = None
    max_age_s: NonNegative = 300.0
    period_s: Positive = 2.0
    """How often it is written."""


class Recording(Block, frozen=True):
    """Everything written down as MCAP files, for replays and for Foxglove."""

    folder: Annotated[str, Meta(min_length=1)]
    """It must exist; relative to where the daemon runs."""
    max_file_mb: Annotated[float, Meta(ge=0.1, le=10_000)] = 100.0
    max_file_s: Annotated[float, Meta(ge=1, le=86_400)] = 3600.0
    quota_mb: Annotated[float, Meta(gt=0)] = 10_000.0
    """For all recordings of the vehicle in the folder; beyond it the oldest are removed."""
    records: bool = True
    """Whether decoded records are written beside the bytes, to be looked at."""


class Config(Block, frozen=True):
    """The whole file."""

    vehicle: Name
    devices: dict[Name, Device]
    initial: Initial
    beacons: dict[str, Beacon | Target] = field(default_factory=dict)
    sound_speed_m_s: SoundSpeed = 1500.0
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
