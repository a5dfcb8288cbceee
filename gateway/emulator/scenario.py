"""The scenario file: one vehicle's true motion, instruments, their errors and the wires they use.

Where a block says the same thing as in the gateway's configuration it is the very same block, so
`gateway.emulator.twin` can give the configuration that matches a scenario.
"""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from drivers import registry
from drivers.settings import Port
from gateway.config.blocks import (
    Beacon,
    Clock,
    ImuNoise,
    InitialSigma,
    Latitude,
    Longitude,
    Name,
    NonNegative,
    Positive,
    Triple,
    UsblNoise,
    UsblPrior,
)

Probability = Annotated[float, Meta(ge=0, le=1)]
SoundSpeed = Annotated[float, Meta(ge=1300, le=1700)]


class _Block(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A block of the file: unknown keys are errors."""


class UdpPort(_Block, frozen=True, tag_field="type", tag="udp"):
    """One datagram a frame to ``host``:``port``."""

    port: Port
    host: str = "127.0.0.1"


class TcpServerPort(_Block, frozen=True, tag_field="type", tag="tcp-server"):
    """A TCP server; every client gets the bytes sent while it is connected."""

    port: Port
    bind: str = "127.0.0.1"


class PtyPort(_Block, frozen=True, tag_field="type", tag="pty"):
    """A pseudo terminal found under ``symlink``; bytes leave at the line rate."""

    symlink: str
    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 9600


class SerialPort(_Block, frozen=True, tag_field="type", tag="serial"):
    """A real serial port, for hardware in the loop through a cable."""

    port: str
    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 9600


AnyPort = UdpPort | TcpServerPort | PtyPort | SerialPort


class Wave(_Block, frozen=True):
    """``amplitude`` sin(2 pi t / period + phase); amplitude in deg, of a displacement in m."""

    amplitude: NonNegative
    period_s: Positive
    phase_deg: float = 0.0


class Sway(_Block, frozen=True):
    """What waves add to the smooth path; each is a sum of oscillations, heave upward."""

    roll: tuple[Wave, ...] = ()
    pitch: tuple[Wave, ...] = ()
    yaw: tuple[Wave, ...] = ()
    heave: tuple[Wave, ...] = ()
    north: tuple[Wave, ...] = ()
    east: tuple[Wave, ...] = ()


class _Track(_Block, frozen=True, kw_only=True):
    """Where a vehicle goes.

    ``ramp_s``: time to reach the speed from rest; 0 starts under way. ``descent``: metres down for
    each metre of way, the vehicle staying level: a circle becomes a spiral.
    """

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float = 0.0
    speed_m_s: NonNegative
    ramp_s: NonNegative = 0.0
    descent: float = 0.0
    sway: Sway = Sway()


class Circle(_Track, frozen=True, kw_only=True, tag_field="type", tag="circle"):
    """Round and round the given point, starting on the given bearing from it."""

    radius_m: Positive
    start_bearing_deg: float = 0.0
    turn: Literal["starboard", "port"] = "starboard"


class Line(_Track, frozen=True, kw_only=True, tag_field="type", tag="line"):
    """Straight from the given point."""

    course_deg: float = 0.0


class Lawnmower(_Track, frozen=True, kw_only=True, tag_field="type", tag="lawnmower"):
    """Parallel legs from the given point, the first turn to starboard, until the time is over."""

    course_deg: float = 0.0
    leg_m: Positive
    spacing_m: Positive


class Legs(_Track, frozen=True, kw_only=True, tag_field="type", tag="legs"):
    """Legs of one length from the given point, a turn (positive to starboard) after each.

    Every turn takes the way ``turn_m``; the leg after the last one goes on.
    """

    course_deg: float = 0.0
    leg_m: Positive
    turn_m: Positive
    turns_deg: tuple[float, ...] = ()


Track = Circle | Line | Lawnmower | Legs


class ImuErrors(_Block, frozen=True):
    """Biases in sensor axes; what is not given is drawn from the noise block."""

    gyro_bias_deg_h: Triple | None = None
    accel_bias_ug: Triple | None = None


class ImuModel(_Block, frozen=True, kw_only=True, tag_field="kind", tag="imu"):
    """An inertial measurement unit; ``jitter_ms`` is the mean of an exponential extra delay."""

    codec: str
    port: AnyPort
    rate_hz: Annotated[float, Meta(gt=0, le=10_000)]
    noise: ImuNoise
    options: dict[str, Any] = {}
    clock: Clock = Clock()
    jitter_ms: NonNegative = 0.0
    mounting_deg: Triple = (0.0, 0.0, 0.0)
    temperature_c: float = 20.0
    errors: ImuErrors = ImuErrors()


class UsblErrors(_Block, frozen=True):
    """Constant errors; what is not given is drawn from the prior.

    ``mounting_deg``: rotation vector about the body axes from the nominal to the true mounting.
    """

    mounting_deg: Triple | None = None
    bearing_deg: float | None = None
    elevation_deg: float | None = None
    range_scale: float | None = None


class Outliers(_Block, frozen=True):
    """Multipath: now and then a longer way (exponential) from another direction (Gaussian)."""

    probability: Probability = 0.0
    extra_range_m: NonNegative = 30.0
    angle_deg: NonNegative = 20.0


class UsblModel(_Block, frozen=True, kw_only=True, tag_field="kind", tag="usbl"):
    """An acoustic array that pings the beacons in turn, one every ``period_s``."""

    codec: str
    port: AnyPort
    noise: UsblNoise
    period_s: Positive = 2.0
    options: dict[str, Any] = {}
    clock: Clock = Clock()
    mounting_deg: Triple = (0.0, 0.0, 0.0)
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    prior: UsblPrior = UsblPrior()
    errors: UsblErrors = UsblErrors()
    outliers: Outliers = Outliers()
    missed_probability: Probability = 0.0
    max_range_m: Positive = 5000.0


DeviceModel = ImuModel | UsblModel


class Initial(_Block, frozen=True):
    """How well the vehicle knows its first state; the errors are drawn from it."""

    sigma: InitialSigma


class Scenario(_Block, frozen=True, kw_only=True):
    """The whole file.

    Attributes
    ----------
    start
        Unix time of t = 0. A live run waits for it; one already over, or "now", begins at once.
    sound_speed_m_s
        What the instruments are told; the water has ``true_sound_speed_m_s``, by default the same.
    """

    seed: Annotated[int, Meta(ge=0)]
    duration_s: Annotated[float, Meta(gt=0, le=7 * 86400)]
    trajectory: Track
    devices: dict[Name, DeviceModel]
    initial: Initial
    beacons: dict[str, Beacon] = {}
    vehicle: Name = "emulated"
    start: Annotated[float, Meta(ge=0)] | Literal["now"] = "now"
    sound_speed_m_s: SoundSpeed = 1500.0
    true_sound_speed_m_s: SoundSpeed | None = None


def codec_options(device: DeviceModel) -> Any:
    """Options of the device's codec as its own Struct (checked by `load`)."""
    return msgspec.convert(device.options, registry.lookup(device.codec).options)
