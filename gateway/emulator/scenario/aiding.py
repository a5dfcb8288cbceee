"""Aiding instruments: satellite receiver, depth sensor, Doppler log, compass."""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from gateway.config.block import Block, NonNegative, Positive, Probability, Triple
from gateway.config.devices import Clock, DepthNoise, DvlNoise, GnssNoise, HeadingNoise
from gateway.emulator.scenario.ports import AnyPort

Quality = Annotated[int, Meta(ge=1, le=5)]
Sentence = Literal["GGA", "GNS", "RMC", "VTG", "ZDA"]


class _Aiding(Block, frozen=True, kw_only=True):
    """What all of them have in common.

    ``jitter_ms`` is the mean of an exponential extra latency, ``missed_probability`` that of a
    measurement of which nothing is said.
    """

    codec: str
    port: AnyPort
    rate_hz: Annotated[float, Meta(gt=0, le=100)] = 1.0
    options: dict[str, Any] = msgspec.field(default_factory=dict)
    clock: Clock = Clock()
    jitter_ms: NonNegative = 0.0
    missed_probability: Probability = 0.0


class GnssModel(_Aiding, frozen=True, kw_only=True, tag_field="kind", tag="gnss"):
    """A satellite receiver; the lever arm is its antenna's.

    Attributes
    ----------
    says
        The sentences of an epoch, in this order; epochs are at whole periods of UTC.
    max_depth_m
        How far below the surface the antenna still has a fix; deeper it says that it has none.
    quality
        As GGA counts it: 1 autonomous, 2 differential, 3 precise, 4 fixed, 5 float.
    geoid_m
        Height of the geoid above the ellipsoid, which its sentences tell.
    """

    noise: GnssNoise
    says: Annotated[tuple[Sentence, ...], Meta(min_length=1)] = ("GGA", "RMC", "ZDA")
    max_depth_m: NonNegative = 0.3
    quality: Quality = 1
    satellites: Annotated[int, Meta(ge=0, le=99)] = 12
    geoid_m: float = 0.0
    lever_arm_m: Triple = (0.0, 0.0, 0.0)


class DepthModel(_Aiding, frozen=True, kw_only=True, tag_field="kind", tag="depth"):
    """A pressure sensor, or an echo sounder; ``offset_m`` is a constant error of its depth."""

    noise: DepthNoise
    offset_m: float = 0.0
    lever_arm_m: Triple = (0.0, 0.0, 0.0)


class DvlErrors(Block, frozen=True):
    """Constant errors.

    ``mounting_deg``: rotation vector about the body axes from the nominal to the true mounting.
    ``scale``: by how much (1) it measures speeds too great.
    """

    mounting_deg: Triple = (0.0, 0.0, 0.0)
    scale: float = 0.0


class DvlModel(_Aiding, frozen=True, kw_only=True, tag_field="kind", tag="dvl"):
    """A Doppler log over a flat bed.

    Attributes
    ----------
    altitude_limits_m, max_speed_m_s
        Within them it has a lock on the bottom; elsewhere it says that it has none.
    age_ms
        From a ping to the first byte of what it says about it, as it says itself.
    scale
        True speed of sound at its transducers over the one it was told.
    """

    noise: DvlNoise
    rate_hz: Annotated[float, Meta(gt=0, le=100)] = 5.0
    age_ms: NonNegative = 0.0
    altitude_limits_m: tuple[NonNegative, Positive] = (0.3, 200.0)
    max_speed_m_s: Annotated[float, Meta(gt=0, le=30)] = 10.0
    mounting_deg: Triple = (0.0, 0.0, 0.0)
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    scale: Annotated[float, Meta(ge=0.9, le=1.1)] = 1.0
    errors: DvlErrors = DvlErrors()


class HeadingModel(_Aiding, frozen=True, kw_only=True, tag_field="kind", tag="heading"):
    """A compass of true north.

    It tells its time where ``clock.source`` is ``device``, roll and pitch with ``attitude``;
    ``offset_deg`` is a constant error of its heading.
    """

    noise: HeadingNoise
    rate_hz: Annotated[float, Meta(gt=0, le=100)] = 10.0
    attitude: bool = False
    offset_deg: float = 0.0
    mounting_deg: Triple = (0.0, 0.0, 0.0)


AidingModel = GnssModel | DepthModel | DvlModel | HeadingModel
