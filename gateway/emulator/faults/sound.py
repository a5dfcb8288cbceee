"""Beacons that die or are dragged away, and echoes."""

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.faults.occasions import begins
from gateway.emulator.scenario import Scenario
from gateway.emulator.scenario.faults import BeaconDead, BeaconMoved, Multipath
from gateway.emulator.streams import Draws

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def dragged(scenario: Scenario, beacon: str, t: Array) -> Array:
    """How far a beacon has been moved at times (n,) s: (n, 3) m north, east, down."""
    away = np.zeros((t.size, 3))
    for k, fault in enumerate(scenario.faults):
        if isinstance(fault, BeaconMoved) and fault.beacon == beacon:
            times = np.searchsorted(begins(scenario, k), t, side="right")
            away += np.outer(times, [fault.north_m, fault.east_m, fault.down_m])
    return away


def dead(scenario: Scenario, beacon: str, t: Array, period_s: float) -> Mask:
    """Whether a beacon leaves pings at times (n,) s, one a period, without an answer."""
    silent = np.zeros(t.size, np.bool_)
    for k, fault in enumerate(scenario.faults):
        if isinstance(fault, BeaconDead) and fault.beacon == beacon:
            silent |= _struck(begins(scenario, k), fault.for_s or period_s, t)
    return silent


def astray(scenario: Scenario, name: str, t: Array, period_s: float, draws: Draws) -> Mask:
    """Whether the replies to pings at times (n,) s, one a period, reach a device by other ways."""
    echoed = np.zeros(t.size, np.bool_)
    for k, fault in enumerate(scenario.faults):
        if isinstance(fault, Multipath) and fault.device == name:
            chosen = draws(f"multipath {k}").random(t.size) < fault.probability
            echoed |= chosen & _struck(begins(scenario, k), fault.for_s or period_s, t)
    return echoed


def _struck(begin: Array, for_s: float, t: Array) -> Mask:
    since = t[:, None] - begin
    struck: Mask = np.any((since >= 0.0) & (since < for_s), axis=1)
    return struck
