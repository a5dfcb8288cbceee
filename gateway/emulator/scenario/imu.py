"""Inertial measurement units and their errors."""

from typing import Annotated, Any

import msgspec
from msgspec import Meta

from gateway.config.block import Block, NonNegative, Positive, Triple
from gateway.config.devices import Clock, ImuNoise
from gateway.emulator.scenario.grades import GRADES, Grade, Sheet
from gateway.emulator.scenario.ports import AnyPort

Celsius = Annotated[float, Meta(ge=-60, le=85)]
Six = tuple[float, float, float, float, float, float]


class ImuErrors(Block, frozen=True):
    """Errors in sensor axes; constants that are not given are drawn from noise and grade.

    A misalignment says for x towards y and z, y towards x and z, z towards x and y how much of the
    other axis an axis senses. A quantum is what the unit counts in; nothing is lost between
    samples. What is beyond a range is cut, and the sample marked as not valid where its format can
    say so.
    """

    gyro_bias_deg_h: Triple | None = None
    accel_bias_ug: Triple | None = None
    gyro_scale_ppm: Triple | None = None
    accel_scale_ppm: Triple | None = None
    gyro_misalignment_urad: Six | None = None
    accel_misalignment_urad: Six | None = None
    angle_quantum_urad: Positive | None = None
    velocity_quantum_um_s: Positive | None = None
    gyro_range_deg_s: Positive | None = None
    accel_range_g: Positive | None = None


class Warming(Block, frozen=True):
    """How a unit warms up: by ``by_c`` in the end, two thirds of it after ``time_s``."""

    by_c: Annotated[float, Meta(ge=-40, le=40)]
    time_s: Positive


class ImuModel(Block, frozen=True, kw_only=True, tag_field="kind", tag="imu"):
    """An inertial measurement unit.

    ``noise`` is that of the ``grade`` unless it is given; one of them must be. ``uptime_s``: how
    long it has been powered at t = 0, which its counters and its time go by. ``age_ms``: from a
    sample to the first byte of its frame, as the frame itself says; ``clock.latency_ms`` adds to it
    what the frame does not say, ``jitter_ms`` the mean of an exponential extra delay.
    """

    codec: str
    port: AnyPort
    rate_hz: Annotated[float, Meta(gt=0, le=10_000)]
    grade: Grade | None = None
    noise: ImuNoise | None = None
    options: dict[str, Any] = msgspec.field(default_factory=dict)
    clock: Clock = Clock()
    age_ms: NonNegative = 0.0
    jitter_ms: NonNegative = 0.0
    uptime_s: NonNegative = 0.0
    mounting_deg: Triple = (0.0, 0.0, 0.0)
    temperature_c: Celsius = 20.0
    warming: Warming | None = None
    errors: ImuErrors = ImuErrors()

    @property
    def sheet(self) -> Sheet:
        """What grade, noise and errors say together of the unit (checked by `load`)."""
        if self.grade is None:
            assert self.noise is not None
            sheet = Sheet(noise=self.noise)
        else:
            sheet = GRADES[self.grade]
        given = {
            "noise": self.noise,
            "gyro_range_deg_s": self.errors.gyro_range_deg_s,
            "accel_range_g": self.errors.accel_range_g,
        }
        return msgspec.structs.replace(sheet, **{k: v for k, v in given.items() if v is not None})
