"""Acoustic instruments and their errors."""

from typing import Any

import msgspec

from gateway.config.blocks import Clock, NonNegative, Positive, Triple, UsblNoise, UsblPrior
from gateway.emulator.scenario.block import Block, Probability
from gateway.emulator.scenario.ports import AnyPort


class UsblErrors(Block, frozen=True):
    """Constant errors; what is not given is drawn from the prior.

    ``mounting_deg``: rotation vector about the body axes from the nominal to the true mounting.
    """

    mounting_deg: Triple | None = None
    bearing_deg: float | None = None
    elevation_deg: float | None = None
    range_scale: float | None = None


class Outliers(Block, frozen=True):
    """Multipath: now and then a longer way (exponential) from another direction (Gaussian)."""

    probability: Probability = 0.0
    extra_range_m: NonNegative = 30.0
    angle_deg: NonNegative = 20.0


class UsblModel(Block, frozen=True, kw_only=True, tag_field="kind", tag="usbl"):
    """An acoustic array that pings the beacons in turn, one every ``period_s``."""

    codec: str
    port: AnyPort
    noise: UsblNoise
    period_s: Positive = 2.0
    options: dict[str, Any] = msgspec.field(default_factory=dict)
    clock: Clock = Clock()
    mounting_deg: Triple = (0.0, 0.0, 0.0)
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    prior: UsblPrior = UsblPrior()
    errors: UsblErrors = UsblErrors()
    outliers: Outliers = Outliers()
    missed_probability: Probability = 0.0
    max_range_m: Positive = 5000.0
