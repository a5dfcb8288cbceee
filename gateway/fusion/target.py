"""Where a beacon that moves was when it replied, by a fix and our own solution.

The array hears the reply from the place at which the beacon sent it; the range is half the way that
the sound went, from the array as it was when the ping left and to the array as it is. Nothing of
our own state is corrected.  # (M.170)-(M.172)
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.engine import Track
from gateway.fusion import loose
from gateway.fusion.axes import told_axes
from gateway.fusion.kinematics import earlier
from gateway.fusion.observation import Model, departure
from gateway.fusion.ranging import pose_then
from gateway.fusion.state import State
from gateway.fusion.usbl import ArrayGeometry, Sighting, direction
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
    fix
        As the array saw it, see `gateway.fusion.observation.settled`.
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
    told = Sighting(measured, array.sigma, np.zeros(3), sent, fix.axes, array.sensor_sd, fix.t_sd_s)
    found = _place(state, array.geometry, told)
    if found is None:
        return None
    lat, lon, h = (float(value) for value in ecef_to_lla(found.r_e))
    z = loose.linearise(state, array.geometry, replace(told, beacon_e=found.r_e), None)
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
        C, r_e = pose_then(state, sight.transmit)
        moved = here_e - (r_e + C @ lever_b)
        range_m = (4.0 * half_way**2 - float(moved @ moved)) / (
            4.0 * half_way + 2.0 * float(moved @ u_e)
        )
    return _Found(here_e + range_m * u_e, range_m) if range_m > 0.0 else None
