"""The whole file: one vehicle's true motion, its instruments and the world around them."""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from drivers import registry
from gateway.config.block import Block, Name, NonNegative, Positive, SoundSpeed
from gateway.config.blocks import Beacon, InitialSigma
from gateway.emulator.scenario.acoustic import LblModel, UsblModel
from gateway.emulator.scenario.aiding import AidingModel
from gateway.emulator.scenario.faults import AnyFault
from gateway.emulator.scenario.imu import ImuModel
from gateway.emulator.scenario.trajectory import Track

DeviceModel = ImuModel | UsblModel | LblModel | AidingModel


class Initial(Block, frozen=True):
    """How well the vehicle knows its first state; the errors are drawn from it."""

    sigma: InitialSigma


class Mobile(Block, frozen=True, kw_only=True, tag_field="role", tag="target"):
    """A beacon on something that moves along a track of its own, at its IMU's place."""

    name: Name
    trajectory: Track
    turnaround_ms: NonNegative = 0.0
    travel: Literal["two_way", "one_way"] = "two_way"


class Scenario(Block, frozen=True, kw_only=True):
    """The whole file.

    Attributes
    ----------
    start
        Unix time of t = 0. A live run waits for it; one already over, or "now", begins at once.
    sound_speed_m_s
        What the instruments are told; the water has ``true_sound_speed_m_s``, by default the same.
    surface_height_m
        Of the water's surface above the ellipsoid.
    sea_bed_depth_m
        Of a flat bed below the surface.
    """

    seed: Annotated[int, Meta(ge=0)]
    duration_s: Annotated[float, Meta(gt=0, le=7 * 86400)]
    trajectory: Track
    devices: dict[Name, DeviceModel]
    initial: Initial
    beacons: dict[str, Beacon | Mobile] = msgspec.field(default_factory=dict)
    vehicle: Name = "emulated"
    start: Annotated[float, Meta(ge=0)] | Literal["now"] = "now"
    sound_speed_m_s: SoundSpeed = 1500.0
    true_sound_speed_m_s: SoundSpeed | None = None
    surface_height_m: float = 0.0
    sea_bed_depth_m: Positive | None = None
    faults: tuple[AnyFault, ...] = ()

    @property
    def moored(self) -> dict[str, Beacon]:
        """The beacons that stay where they are, by address."""
        return {n: b for n, b in self.beacons.items() if isinstance(b, Beacon)}

    @property
    def mobile(self) -> dict[str, Mobile]:
        """The beacons that move, by address."""
        return {n: b for n, b in self.beacons.items() if isinstance(b, Mobile)}


def codec_options(device: DeviceModel) -> Any:
    """Options of the device's codec as its own Struct (checked by `load`)."""
    return msgspec.convert(device.options, registry.lookup(device.codec).options)
