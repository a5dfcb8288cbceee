"""What the aiding instruments have in common: their place, their noise, the time they tell."""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.faults.clocks import ahead
from gateway.emulator.scenario import (
    DepthModel,
    DvlModel,
    GnssModel,
    HeadingModel,
    Scenario,
)
from gateway.emulator.streams import generator
from gateway.emulator.trajectory import Trajectory

Array = NDArray[np.float64]
Model = TypeVar("Model", GnssModel, DepthModel, DvlModel, HeadingModel)


@dataclass(frozen=True)
class Aboard(Generic[Model]):
    """One instrument on its vehicle."""

    scenario: Scenario
    name: str
    model: Model
    trajectory: Trajectory
    start_unix_s: float

    def draws(self) -> np.random.Generator:
        """Its white noise; drawn in the order of time."""
        return generator(self.scenario.seed, self.name, "noise")

    def told_unix_s(self, t: Array) -> Array:
        """What its clock tells as Unix time, (n,) s."""
        told: Array = self.start_unix_s + t + ahead(self.scenario, self.name, t)
        return told

    def altitude_m(self, h: Array) -> Array | None:
        """Height above the bed of what is at heights (n,) m; None without a bed."""
        bed_m = self.scenario.sea_bed_depth_m
        if bed_m is None:
            return None
        altitude: Array = h - (self.scenario.surface_height_m - bed_m)
        return altitude
