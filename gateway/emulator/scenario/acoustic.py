"""Acoustic instruments and their errors."""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from gateway.config.block import Block, NonNegative, Positive, Probability, SigmaTriple, Triple
from gateway.config.devices import Clock, LblNoise, LblPrior, UsblNoise, UsblPrior
from gateway.emulator.scenario.ports import AnyPort

Message = Literal["fix", "angles", "differences", "rate"]
"""What an array says of one reply: all it knows, or a part of it."""
Element = Annotated[int, Meta(ge=1)]
Axes = Literal["array", "level", "north", "earth"]
"""What a fix is said in: the array's axes; the same with its tilt taken out; north, east,
down; or as a place on the Earth."""


class ToldTime(Block, frozen=True):
    """The clock by which an instrument tells times.

    It shows ``offset_s`` at the start of the scenario on top of Unix time (``since: start``: of
    zero), gains ``drift_ppm`` and begins anew every ``wraps_s``.
    """

    since: Literal["unix", "start"] = "unix"
    offset_s: float = 0.0
    drift_ppm: Annotated[float, Meta(ge=-10_000, le=10_000)] = 0.0
    wraps_s: Positive | None = None


class Outliers(Block, frozen=True):
    """Multipath: now and then a longer way (exponential) from another direction (Gaussian)."""

    probability: Probability = 0.0
    extra_range_m: NonNegative = 30.0
    angle_deg: NonNegative = 20.0


class OwnPlace(Block, frozen=True):
    """Errors (north, east, down) of the place to which the instrument adds its fixes."""

    noise_m: SigmaTriple = (0.0, 0.0, 0.0)
    offset_m: Triple = (0.0, 0.0, 0.0)


class UsblErrors(Block, frozen=True):
    """Constant errors; what is not given is drawn from the prior.

    ``mounting_deg``: rotation vector about the body axes from the nominal to the true mounting.
    ``lever_arm_m``, ``latency_ms``: true less stated. ``attitude_deg``: of its own motion sensor,
    about north, east, down.
    """

    mounting_deg: Triple | None = None
    bearing_deg: float | None = None
    elevation_deg: float | None = None
    range_scale: float | None = None
    lever_arm_m: Triple | None = None
    latency_ms: float | None = None
    attitude_deg: Triple = (0.0, 0.0, 0.0)


class LblErrors(Block, frozen=True):
    """Constant errors; what is not given is drawn from the prior.

    ``lever_arm_m``, ``latency_ms``: true less stated.
    """

    range_scale: float | None = None
    lever_arm_m: Triple | None = None
    latency_ms: float | None = None


class _Acoustic(Block, frozen=True, kw_only=True):
    """What all that hear beacons have in common.

    ``beacons`` are those it asks: all of the file unless named. ``jitter_ms`` is the mean of an
    exponential extra latency, ``timeout_s`` how long a reply is waited for (by default twice the
    way over ``max_range_m``).
    """

    codec: str
    port: AnyPort
    options: dict[str, Any] = msgspec.field(default_factory=dict)
    beacons: tuple[str, ...] = ()
    clock: Clock = Clock()
    jitter_ms: NonNegative = 0.0
    time: ToldTime = ToldTime()
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    outliers: Outliers = Outliers()
    missed_probability: Probability = 0.0
    max_range_m: Positive = 5000.0
    timeout_s: Positive | None = None


class UsblModel(_Acoustic, frozen=True, kw_only=True, tag_field="kind", tag="usbl"):
    """An acoustic array that asks its beacons in turn, one every ``period_s``.

    Attributes
    ----------
    says
        The messages about one reply, in this order.
    axes
        What fixes are said in; anything but ``array`` is made with the instrument's own motion
        sensor, places on the Earth with ``place`` as well.
    age_ms
        How much later than a rate the other messages come, which they tell.
    no_reply
        The fault it names when a beacon does not answer; without, it says nothing then.
    no_fix_s
        Times (from, to) in which it hears beacons but finds neither their range nor direction.
    pairs
        Elements of which it tells by how much the first heard later than the second, numbered from
        1; each with the last one unless given.
    element_noise_us
        White error of the moment at which sound reaches an element.
    """

    noise: UsblNoise
    period_s: Positive = 2.0
    says: Annotated[tuple[Message, ...], Meta(min_length=1)] = ("fix",)
    axes: Axes = "array"
    place: OwnPlace = OwnPlace()
    age_ms: NonNegative = 0.0
    no_reply: str | None = None
    no_fix_s: tuple[tuple[NonNegative, Positive], ...] = ()
    mounting_deg: Triple = (0.0, 0.0, 0.0)
    elements_m: tuple[Triple, ...] = ()
    pairs: tuple[tuple[Element, Element], ...] = ()
    element_noise_us: NonNegative = 0.0
    direction: Literal["told", "differences"] = "told"
    looks: Literal["down", "up"] = "down"
    prior: UsblPrior = UsblPrior()
    errors: UsblErrors = UsblErrors()


class LblModel(_Acoustic, frozen=True, kw_only=True, tag_field="kind", tag="lbl"):
    """A transducer that asks moored transponders every ``period_s``.

    Attributes
    ----------
    asks
        ``together``: one ping for all, said when the last has answered or the time is over.
        ``in_turn``: one beacon a ping, said when it answers.
    rate_of
        The beacon whose Doppler it tells, too.
    """

    noise: LblNoise
    period_s: Positive = 10.0
    asks: Literal["together", "in_turn"] = "together"
    rate_of: str | None = None
    prior: LblPrior = LblPrior()
    errors: LblErrors = LblErrors()
