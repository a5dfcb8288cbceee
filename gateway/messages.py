"""What passes between ingest, the filter process and the outputs. Radians and SI units inside.

Times ``t_ns`` are host monotonic nanoseconds of *validity*; wall time appears only at outputs.
Vectors are tuples (messages cross a process boundary as msgpack), blocks of IMU samples are bytes
of float64 rows, see `ImuBlock`.
"""

from typing import ClassVar, Literal

import msgspec

from gateway.modes import Mode

Vec3 = tuple[float, float, float]
Covariance3 = tuple[float, float, float, float, float, float]
"""Three variances, then the covariances of first and second, first and third, second and third."""


class ImuBlock(msgspec.Struct, frozen=True, array_like=True, tag="imu"):
    """Consecutive samples of the IMU in body axes (FRD), oldest first.

    ``t_ns`` (n,) int64 little-endian: end of each sample's interval, strictly increasing.
    ``rows`` (n, 8) float64: interval dt (s), angle increment (rad) x 3, velocity increment
    (m/s) x 3, and the part of dt for which no data came and the sample stands in (s; mostly 0).
    """

    t_ns: bytes
    rows: bytes

    @property
    def t_last_ns(self) -> int:
        """End of the last sample."""
        return int.from_bytes(self.t_ns[-8:], "little", signed=True)


class _Heard(msgspec.Struct, frozen=True, array_like=True):
    """Sound of a beacon that reached an array of the vehicle at ``t_ns``."""

    locates: ClassVar[bool] = True
    """Whether it bounds the error of the position: the age of a solution counts from these."""

    t_ns: int
    device: str
    beacon: str


class _Own(msgspec.Struct, frozen=True, array_like=True):
    """A measurement by the device, in which no beacon takes part."""

    locates: ClassVar[bool] = False
    beacon: ClassVar[str] = ""

    t_ns: int
    device: str


class UsblFix(_Heard, frozen=True, tag="usbl"):
    """One acoustic fix at the moment the reply reached the array.

    Angles in rad in array axes `u` (bearing to starboard, elevation up), slant range in m as the
    instrument computed it with the nominal sound speed; None where the sentence did not carry it.
    ``axes`` other than the array's are those that the instrument has levelled or turned north.
    """

    elevation: float | None
    bearing: float | None
    slant_range: float | None
    axes: Literal["array", "level", "north"] = "array"
    horizontal: bool = False
    """Whether only its north and east were told, and down by the chart."""
    t_sd_s: float = 0.0
    """1-sigma of its time, where something may have held it up."""


class BeaconPlace(_Heard, frozen=True, tag="place"):
    """Where a topside that goes by this gateway's own solution places a beacon (WGS84, rad)."""

    lat: float
    lon: float


class BeaconRange(_Heard, frozen=True, tag="range"):
    """One slant range (m) of a long baseline, at the moment this beacon's reply was heard.

    ``t_transmit_ns`` is when the ping left, the same for all beacons it asked; None where the
    instrument does not say: it follows from the range then.
    """

    slant_range: float
    t_transmit_ns: int | None = None


class RadialRate(_Heard, frozen=True, tag="rate"):
    """Rate of the distance to a beacon (m/s, positive when it grows) by the Doppler of its sound.

    ``rates`` holds one for each element of the array, or the one that the instrument made of them.
    """

    locates: ClassVar[bool] = False

    rates: tuple[float, ...]


class PositionFix(_Own, frozen=True, tag="position"):
    """Geodetic WGS84 position of an antenna (rad, m) with 1-sigma north, east, down (m).

    ``h`` is None where only the horizontal position is known.
    """

    locates: ClassVar[bool] = True

    lat: float
    lon: float
    h: float | None
    sd: Vec3


class VelocityFix(_Own, frozen=True, tag="velocity"):
    """Velocity of an antenna over ground, north, east, down (m/s), with 1-sigma of each.

    ``down`` is None where only speed and course are known.
    """

    north: float
    east: float
    down: float | None
    sd: Vec3


class Depth(_Own, frozen=True, tag="depth"):
    """Ellipsoidal height ``h`` of a pressure sensor (m; it falls as the depth grows), 1-sigma."""

    h: float
    sd: float


class BottomVelocity(_Own, frozen=True, tag="bottom_velocity"):
    """Velocity over the bottom (m/s), with 1-sigma of each component.

    Forward, starboard, down in the sensor's own axes.
    """

    v: Vec3
    sd: Vec3


class HeadingFix(_Own, frozen=True, tag="heading"):
    """True heading of the sensor's forward axis (rad, from north to the east), 1-sigma."""

    heading: float
    sd: float


class Stationary(_Own, frozen=True, tag="stationary"):
    """The vehicle rests on the Earth: its velocity is zero, 1-sigma of each component (m/s)."""

    sd: float


Acoustic = UsblFix | BeaconPlace | BeaconRange | RadialRate
OfTheVehicle = PositionFix | VelocityFix | Depth | BottomVelocity | HeadingFix | Stationary
Fix = Acoustic | OfTheVehicle
"""What corrects the state."""
Measurement = ImuBlock | Fix


class NavSolution(msgspec.Struct, frozen=True, array_like=True, tag="nav"):
    """The fused solution of the vehicle at its IMU.

    ``lat``, ``lon`` (rad) and ``h`` (m above the ellipsoid) are WGS84; ``v_eb_n`` is the velocity
    over the Earth, north, east, down (m/s); ``roll``, ``pitch`` and ``heading`` (rad, the heading
    in [0, 2 pi]) are those of ``C_nb``, see `gateway.nav.attitude`.
    """

    t_ns: int
    mode: Mode
    lat: float
    lon: float
    h: float
    v_eb_n: Vec3
    roll: float
    pitch: float
    heading: float
    sd_position: Vec3
    """1-sigma north, east, down (m)."""
    sd_velocity: Vec3
    """1-sigma north, east, down (m/s)."""
    sd_attitude: Vec3
    """1-sigma of roll, pitch, heading (rad)."""
    cov_ne: float
    """Covariance of north and east position (m^2), for the error ellipse."""
    fix_age_s: float | None
    """Seconds since the last fix that was used; None before the first."""
    fixes_used: int
    fixes_rejected: int


class Component(msgspec.Struct, frozen=True, array_like=True):
    """One row of an innovation: ``value`` = measured - predicted, ``sigma`` from S."""

    name: str
    value: float
    sigma: float


class Innovation(msgspec.Struct, frozen=True, array_like=True, tag="innovation"):
    """What the filter made of one fix. ``reason`` is "" for a used one."""

    t_ns: int
    device: str
    beacon: str
    components: tuple[Component, ...]
    nis: float
    accepted: bool
    reason: str
    quality: float | None = None
    """Running mean of the beacon's NIS per row, near 1 as declared; None where no beacon is."""
    moved: Vec3 | None = None
    """How far it took the place, north, east, down (m), where the filter doubted itself."""


class TargetSighting(msgspec.Struct, frozen=True, array_like=True, tag="sighting"):
    """Where a beacon that is followed was when it replied (WGS84, rad, m), by one fix.

    ``t_ns`` is the reply's own time, earlier than that of the fix. Covariances are the variances of
    north, east, down and then north-east, north-down, east-down (m^2): ``cov`` of the fix alone,
    ``own_cov`` of our own state, which all fixes of a while share.
    """

    accepted: ClassVar[bool] = False
    """It corrects nothing."""

    t_ns: int
    device: str
    beacon: str
    lat: float
    lon: float
    h: float
    cov: Covariance3
    own_cov: Covariance3


Verdict = Innovation | TargetSighting
"""What a fix leads to."""


class Constant(msgspec.Struct, frozen=True, array_like=True):
    """One estimated constant; its unit stands at the end of its name (edge units: degrees)."""

    name: str
    value: float
    sigma: float


class Calibration(msgspec.Struct, frozen=True, array_like=True, tag="calibration"):
    """The constants the filter estimates beside the motion: IMU biases and acoustic errors."""

    t_ns: int
    constants: tuple[Constant, ...]


class FilterTotals(msgspec.Struct, frozen=True):
    """What the filter has taken, used and refused so far."""

    imu_samples: int
    fixes_used: int
    fixes_gated: int
    fixes_late: int
    fixes_too_late: int
    fixes_too_early: int
    fixes_duplicate: int
    resets: int


class FilterCounts(FilterTotals, frozen=True, array_like=True, tag="counts"):
    """The same as the filter process says it, at ``t_ns``."""

    t_ns: int


class SavedState(msgspec.Struct, frozen=True, array_like=True, tag="state"):
    """The filter at ``t_ns``: what a gateway that was away begins with again.

    ``x`` (50,) and ``P`` (n, n) are the float64 bytes of mean and covariance, ``columns`` (n,) the
    int64 bytes of what the covariance holds, see `gateway.fusion.state.State`. The rest is that of
    `gateway.fusion.memory.Memory`.
    """

    t_ns: int
    x: bytes
    P: bytes
    columns: bytes
    used: int
    gated: int
    refused_in_a_row: int
    t_used_ns: int | None
    quality: dict[str, tuple[int, float]] = {}
    noise: dict[str, float] = {}
    aided: bool = False
    velocity_refused: dict[str, tuple[int, float, int]] = {}


class Second(msgspec.Struct, frozen=True, array_like=True):
    """What the samples of a second hold: turn (rad) and mean specific force (m/s^2), body axes.

    ``told_s`` is how long they are by their intervals, ``passed_s`` by their times.
    """

    turned: Vec3
    force: Vec3
    told_s: float
    passed_s: float


class Aligning(msgspec.Struct, frozen=True, array_like=True):
    """An alignment under way: when it began, and the samples of the window in hand.

    With ``again`` the state was taken up again, and is all that is known but for the attitude.
    """

    again: bool
    t_first_ns: int
    samples: ImuBlock


class Checkpoint(msgspec.Struct, frozen=True, array_like=True, tag="checkpoint"):
    """A moment of the past from which a new process says what the old one says, bit for bit.

    It is given all measurements again but the first ``received``, in the order of their arrival;
    its first output then is the one after ``said`` of the old process. Both count from the very
    first process on; states and checkpoints are not counted among the outputs.

    ``origin_e`` (m, ECEF) is the local origin of the invariant errors, ``began_ns`` the moment
    before the first sample. ``state`` holds all measurements up to its time that ever came, later
    ones too. ``fixes`` are those that had come by then: their repetition is told, those that lie
    ahead still wait. ``past`` is the (12,) float64 track before the state's time, by time in ns, as
    far as fixes after it ask for it. The rest are the totals of then. While ``aligning``, ``fixes``
    wait for the attitude, and there is no past.
    """

    state: SavedState
    received: int
    said: int
    began_ns: int
    origin_e: Vec3
    fixes: tuple[Fix, ...]
    past: dict[int, bytes]
    consumed: int
    """Samples since the filter began; ``imu_samples`` are all, those of an alignment too."""
    imu_samples: int
    fixes_late: int
    fixes_too_late: int
    fixes_too_early: int
    fixes_duplicate: int
    resets: int
    aligning: Aligning | None = None
    seconds: tuple[Second, ...] = ()
    """See `gateway.fusion.credible`, as ``is_credible``."""
    is_credible: bool = True

    @property
    def t_ns(self) -> int:
        """Time of the state."""
        return self.state.t_ns


FilterOutput = NavSolution | Verdict | Calibration | FilterCounts | SavedState | Checkpoint
"""What the estimator says; the last two are for its keeper."""
