"""From a measurement's message to its linearised model: which beacon, which noise, which past."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.fusion import usbl
from gateway.fusion.errors import ErrorDefinition
from gateway.fusion.kalman import Linearised
from gateway.fusion.ranging import Past
from gateway.fusion.state import State
from gateway.messages import UsblFix
from gateway.timeline import Track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Transponder:
    """A moored beacon: ECEF position, turn-around time, and whether its range is two-way."""

    r_e: Array
    turnaround_s: float
    two_way: bool


@dataclass(frozen=True)
class AcousticArray:
    """An array of the vehicle: geometry and white noise of elevation, bearing (rad), range (m)."""

    geometry: usbl.ArrayGeometry
    sigma: Array


@dataclass(frozen=True)
class Model:
    """All that the filter takes as known.

    Attributes
    ----------
    error
        The error definition in whose coordinates updates are made.
    q
        (4,) noise densities of the IMU, see `gateway.nav.strapdown.predict`.
    gate
        Probability inside the chi-squared gate.
    """

    error: ErrorDefinition
    q: Array
    gate: float
    sound_speed: float
    arrays: dict[str, AcousticArray]
    beacons: dict[str, Transponder]


def observe(model: Model, state: State, fix: UsblFix, track: Track) -> Linearised | str:
    """Linearise a measurement at the state of its time, or say in a word why it has no model."""
    array, beacon = model.arrays[fix.device], model.beacons.get(fix.beacon)
    if beacon is None:
        return "unknown_beacon"
    rows = (fix.elevation, fix.bearing, fix.slant_range)
    measured = np.array([np.nan if v is None else v for v in rows])
    transmit = None
    if beacon.two_way and fix.slant_range is not None:
        age_s = 2.0 * fix.slant_range / model.sound_speed + beacon.turnaround_s
        transmit = past(track, fix.t_ns, age_s)
    sight = usbl.Sighting(measured, array.sigma, beacon.r_e, transmit)
    return usbl.linearise(state, array.geometry, sight) or "geometry"


def past(track: Track, t_ns: int, age_s: float) -> Past:
    """The moment `age_s` before `t_ns`."""
    row = track.at(t_ns - round(age_s * 1e9))
    return Past(row[:3], row[3:].reshape(3, 3), age_s)
