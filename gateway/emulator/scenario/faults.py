"""The faults of a scenario file: what goes wrong, with whom, when.

A fault comes at ``at_s``, or ``per_hour`` times an hour at random, and lasts ``for_s``; one that
lasts 0 strikes the next frame only.
"""

from typing import Annotated

from msgspec import Meta

from gateway.config.block import Block, Name, NonNegative, Positive

Share = Annotated[float, Meta(gt=0, le=1)]
Count = Annotated[int, Meta(ge=1, le=65_536)]


class Fault(Block, frozen=True, kw_only=True):
    """When it comes, and for how long: either of the first two is given."""

    at_s: NonNegative | None = None
    per_hour: Positive | None = None
    for_s: NonNegative = 0.0


class _OfDevice(Fault, frozen=True, kw_only=True):
    """A fault of one device."""

    device: Name


class _OfFrames(_OfDevice, frozen=True, kw_only=True):
    """A fault that strikes each frame meanwhile with a probability."""

    probability: Share = 1.0


class Flip(_OfFrames, frozen=True, kw_only=True, tag_field="fault", tag="flip"):
    """Some bits of the frame are turned over."""

    bits: Count = 1


class Truncate(_OfFrames, frozen=True, kw_only=True, tag_field="fault", tag="truncate"):
    """The frame ends early."""


class Junk(_OfFrames, frozen=True, kw_only=True, tag_field="fault", tag="junk"):
    """Up to so many bytes at random stand before the frame."""

    bytes: Count = 64


class Duplicate(_OfFrames, frozen=True, kw_only=True, tag_field="fault", tag="duplicate"):
    """The frame comes again."""


class Reorder(_OfFrames, frozen=True, kw_only=True, tag_field="fault", tag="reorder"):
    """The frame comes after the one that follows it."""


class Drop(_OfFrames, frozen=True, kw_only=True, tag_field="fault", tag="drop"):
    """The frame never comes."""


class Burst(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="burst"):
    """All frames wait for the end and come at once."""


class Delay(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="delay"):
    """Frames come later."""

    delay_ms: Positive


class Jitter(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="jitter"):
    """Frames come later, each by an exponential draw."""

    mean_ms: Positive


class Unplug(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="unplug"):
    """The cable is pulled: a live port is closed and opened again, what is said meanwhile lost."""


class PowerCycle(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="power_cycle"):
    """Silence, then an IMU's number and time begin at 0 again."""


class ClockDrift(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="clock_drift"):
    """The device's clock runs fast by so much, to the end unless ``for_s`` is given."""

    ppm: float
    for_s: NonNegative = 7 * 86400.0


class ClockStep(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="clock_step"):
    """The device's clock is set: what it tells jumps by ``step_s``."""

    step_s: float


class ClockWrap(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="clock_wrap"):
    """The device's number and time turn over at ``at_s``, where the format lets them."""


class Saturation(_OfDevice, frozen=True, kw_only=True, tag_field="fault", tag="saturation"):
    """An IMU's ranges are so narrow: what is beyond is cut, and marked where the format can."""

    rate_deg_s: Positive
    accel_g: Positive


class Multipath(_OfFrames, frozen=True, kw_only=True, tag_field="fault", tag="multipath"):
    """Sound reaches the device by other ways, as far off as its ``outliers`` say."""


class _OfBeacon(Fault, frozen=True, kw_only=True):
    """A fault of one beacon."""

    beacon: str


class BeaconDead(_OfBeacon, frozen=True, kw_only=True, tag_field="fault", tag="beacon_dead"):
    """It does not answer."""


class BeaconMoved(_OfBeacon, frozen=True, kw_only=True, tag_field="fault", tag="beacon_moved"):
    """It is dragged away, and stays there; nobody is told."""

    north_m: float = 0.0
    east_m: float = 0.0
    down_m: float = 0.0


Garbling = Flip | Truncate | Junk | Duplicate | Reorder | Drop
WireFault = Garbling | Burst | Delay | Jitter | Unplug | PowerCycle
ClockFault = ClockDrift | ClockStep | ClockWrap
SoundFault = Multipath | BeaconDead | BeaconMoved
AnyFault = WireFault | ClockFault | SoundFault | Saturation
