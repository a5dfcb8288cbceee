"""Where a beacon that moves was when it replied, by a fix and our own solution.

The array hears the reply from the place at which the beacon sent it; the range is half the way that
the sound went, from the array as it was when the ping left and to the array as it is. Nothing of
our own state is corrected.  # (M.170)-(M.172)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.engine import Track
from gateway.fusion import loose
from gateway.fusion.axes import told_axes
from gateway.fusion.kinematics import earlier
from gateway.fusion.observation import Model, departure
from gateway.fusion.ranging import Past
from gateway.fusion.state import State
from gateway.fusion.usbl import ArrayGeometry, Sighting, direction, turned_back
from gateway.messages import Covariance3, TargetSighting, UsblFix
from gateway.nav.earth import ecef_to_lla

Array = NDArray[np.float64]


class _Found(NamedTuple):
    """A place (3,) in e, and how far it is from the array at reception (m)."""

    r_e: Array
    range_m: float


def sighting(model: Model, state: State, fix: UsblFix, track: Track) -> TargetSighting | None:
    """The place of a target at its reply; None for a fix that does not tell one.

    Parameters
    ----------
    state
        At the reply's arrival.
    track
        What may be asked about the time before.
    """
    array, target = model.arrays[fix.device], model.targets[fix.beacon]
    if fix.elevation is None or fix.bearing is None or fix.slant_range is None:
        return None
    sent = departure(model, target, fix.t_ns, None, fix.slant_range, track)
    measured = np.array([fix.elevation, fix.bearing, fix.slant_range])
    told: Sighting | None = Sighting(
        measured, array.sigma, np.zeros(3), sent, fix.axes, array.sensor_sd
    )
    if array.goes_by_us and fix.axes != "array":
        assert told is not None
        told = turned_back(state, array.geometry, told)
    found = None if told is None else _place(state, array.geometry, told)
    if told is None or found is None:
        return None
    lat, lon, h = (float(value) for value in ecef_to_lla(found.r_e))
    there = Sighting(told.measured, told.sigma, found.r_e, sent, told.axes, told.sensor_sd)
    z = loose.linearise(state, array.geometry, there, None)
    if z is None:
        return None
    return TargetSighting(
        t_ns=fix.t_ns - round(found.range_m / model.sound_speed * 1e9),
        device=fix.device,
        beacon=fix.beacon,
        lat=lat,
        lon=lon,
        h=h,
        cov=_told(z.R),
        own_cov=_told(z.H @ state.P @ z.H.T),
    )


def _told(P: Array) -> Covariance3:
    """A covariance (3, 3) as a message has it."""
    nn, ee, dd = P.diagonal().tolist()
    return nn, ee, dd, float(P[0, 1]), float(P[0, 2]), float(P[1, 2])


def _place(state: State, geometry: ArrayGeometry, sight: Sighting) -> _Found | None:
    """Along the told direction, as far as the sound's whole way allows.  # (M.170), (M.171)"""
    state, _ = earlier(state)
    axes = told_axes(state, geometry.C_bu, sight.axes)
    if axes is None:
        return None
    elevation, bearing = sight.measured[:2] - state.angle_offsets
    u_e = axes.C_ea @ direction(float(elevation), float(bearing))
    lever_b = geometry.lever_b + state.lever_b
    here_e = state.r_e + state.C_eb @ lever_b
    half_way = float(sight.measured[2]) / (1.0 + state.range_scale)
    range_m = half_way
    if sight.transmit is not None:
        moved = here_e - _then(state, lever_b, sight.transmit)
        range_m = (4.0 * half_way**2 - float(moved @ moved)) / (
            4.0 * half_way + 2.0 * float(moved @ u_e)
        )
    return _Found(here_e + range_m * u_e, range_m) if range_m > 0.0 else None


def _then(state: State, lever_b: Array, when: Past) -> Array:
    """(3,) where the array was at an earlier moment."""
    C = state.C_eb @ (state.chain.T @ when.chain)
    there: Array = state.r_e - (state.s_e - when.s_e) + C @ lever_b
    return there
