"""Inertial measurement units and their errors."""

from typing import Annotated, Any

import msgspec
from msgspec import Meta

from gateway.config.blocks import Clock, ImuNoise, NonNegative, Triple
from gateway.emulator.scenario.block import Block
from gateway.emulator.scenario.ports import AnyPort


class ImuErrors(Block, frozen=True):
    """Biases in sensor axes; what is not given is drawn from the noise block."""

    gyro_bias_deg_h: Triple | None = None
    accel_bias_ug: Triple | None = None


class ImuModel(Block, frozen=True, kw_only=True, tag_field="kind", tag="imu"):
    """An inertial measurement unit; ``jitter_ms`` is the mean of an exponential extra delay."""

    codec: str
    port: AnyPort
    rate_hz: Annotated[float, Meta(gt=0, le=10_000)]
    noise: ImuNoise
    options: dict[str, Any] = msgspec.field(default_factory=dict)
    clock: Clock = Clock()
    jitter_ms: NonNegative = 0.0
    mounting_deg: Triple = (0.0, 0.0, 0.0)
    temperature_c: float = 20.0
    errors: ImuErrors = ImuErrors()
