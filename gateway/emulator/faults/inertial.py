"""Shaken beyond its range an inertial unit says the end of the range."""

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.faults.occasions import begins
from gateway.emulator.scenario import Scenario
from gateway.emulator.scenario.faults import Saturation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STANDARD_GRAVITY = 9.80665


def saturated(
    scenario: Scenario, name: str, t: Array, dt: float, sensed: Array, within: Mask
) -> tuple[Array, Mask]:
    """What is left of samples while ranges are narrow.

    Parameters
    ----------
    t
        (n,) end of each sample, s.
    sensed
        (n, 6) increments over ``dt``, rad and m/s.
    within
        (n,) whether they were within the unit's ranges.
    """
    for k, fault in enumerate(scenario.faults):
        if not isinstance(fault, Saturation) or fault.device != name:
            continue
        most = dt * np.repeat([np.deg2rad(fault.rate_deg_s), fault.accel_g * STANDARD_GRAVITY], 3)
        for begin in begins(scenario, k).tolist():
            cut = np.clip(sensed, -most, most)
            struck = (t >= begin) & (t < begin + fault.for_s) & (cut != sensed).any(axis=1)
            sensed = np.where(struck[:, None], cut, sensed)
            within = within & ~struck
    return sensed, within
