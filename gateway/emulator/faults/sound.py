"""Beacons that die or are dragged away, and echoes."""

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.faults.occasions import Occasions, begins
from gateway.emulator.scenario import Scenario
from gateway.emulator.scenario.faults import BeaconDead, BeaconMoved, Multipath
from gateway.emulator.streams import generator

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


def dead(scenario: Scenario, beacon: str, t: Array) -> Mask:
    """Whether a beacon leaves pings at ascending times (n,) s without an answer."""
    silent = np.zeros(t.size, np.bool_)
    for k, fault in enumerate(scenario.faults):
        if isinstance(fault, BeaconDead) and fault.beacon == beacon:
            when = Occasions(begins(scenario, k), fault.for_s)
            silent |= [when.strike(at) for at in t.tolist()]
    return silent


def astray(scenario: Scenario, name: str, t: Array) -> Mask:
    """Whether the replies to pings at ascending times (n,) s reach a device by other ways."""
    struck = np.zeros(t.size, np.bool_)
    for k, fault in enumerate(scenario.faults):
        if isinstance(fault, Multipath) and fault.device == name:
            when = Occasions(begins(scenario, k), fault.for_s)
            by_chance = generator(scenario.seed, "faults", str(k), "draws").random(t.size)
            met = np.array([when.strike(at) for at in t.tolist()], np.bool_)
            struck |= met & (by_chance < fault.probability)
    return struck
