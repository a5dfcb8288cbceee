"""Loose coupling: elevation, bearing and range as one position of the vehicle.

The innovation is a vector in north, east, down at the beacon. Its noise is that of the angles and
the range carried into it (seed 004), or one sigma for all (seeds 000 and 002); the constant errors
of the array are the states of the tight model.  # (M.82)-(M.84)
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.axes import told_axes
from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import add_latency, earlier
from gateway.fusion.position import ROW_NAMES
from gateway.fusion.ranging import leg
from gateway.fusion.state import (
    ATT,
    DALPHA,
    DBETA,
    DKD,
    LATENCY,
    LEVER,
    N_FULL,
    POS,
    THETA,
    State,
)
from gateway.fusion.usbl import ArrayGeometry, Sighting, angles, by_polar
from gateway.nav.earth import C_en, ecef_to_lla
from gateway.nav.lie import skew

Array = NDArray[np.float64]


def linearise(
    state: State, geometry: ArrayGeometry, sight: Sighting, sigma_m: float | None
) -> Linearised | None:
    """Predict the position error at the state of the reply's arrival.

    `sigma_m` is the noise of each component; None carries that of the fix. None is given back for a
    fix that is not complete, or whose range is nothing beside the motion.
    """
    if np.isnan(sight.measured).any():
        return None
    state, omega_e = earlier(state)
    axes = told_axes(state, geometry.C_bu, sight.axes)
    if axes is None:
        return None
    k = 1.0 + state.range_scale
    H = np.zeros((3, N_FULL))
    alpha, beta = sight.measured[:2] - state.angle_offsets
    range_m, by_range = _range_at_reception(state, geometry, sight)
    if not range_m > 0.0:
        return None
    E = axes.C_ea @ by_polar(float(alpha), float(beta), range_m)
    C = state.C_eb
    r_e, l_e = range_m * E[:, 2], C @ (geometry.lever_b + state.lever_b)
    H[:, ATT] = -skew(r_e) @ axes.turning - skew(l_e)
    H[:, POS] = np.eye(3)
    H[:, LEVER] = C
    H[:, THETA] = -skew(r_e) @ C @ axes.by_mounting
    H[:, DALPHA], H[:, DBETA] = -E[:, 0], -E[:, 1]
    H[:, DKD] = -E[:, 2] * sight.measured[2] / k**2
    H += np.outer(E[:, 2], by_range)
    add_latency(state, omega_e, H)
    residual = r_e + l_e + state.r_e - sight.beacon_e
    lat, lon, _ = ecef_to_lla(sight.beacon_e)
    C_ne = C_en(lat, lon).T
    if sigma_m is None:
        elevation, bearing = angles(tuple((axes.C_eu.T @ r_e).tolist()))
        measured = axes.C_eu @ by_polar(elevation, bearing, range_m)
        noise = measured * sight.sigma * np.array([1.0, 1.0, 1.0 / k])
        turned = skew(r_e) @ axes.C_ea * np.sqrt(sight.sensor_variance())
        moved = sight.t_sd_s * H[:, LATENCY]  # (M.180)
        R = C_ne @ (noise @ noise.T + turned @ turned.T + np.outer(moved, moved)) @ C_ne.T
    else:
        R = np.eye(3) * sigma_m**2
    H = np.ascontiguousarray(C_ne @ H[:, state.columns])
    return Linearised(C_ne @ residual, H, R, ROW_NAMES)


def turning_the_beacon(z: Linearised, beacon_e: Array, turning: Array) -> Linearised:
    """The same position for a right-invariant error of any size.  # (M.139)

    Its derivative at the estimate turns the place that the fix gives, as far as the told axes turn
    (`gateway.fusion.axes`). That place may be far from the beacon; what the error turns is the
    beacon.
    """
    lat, lon, _ = ecef_to_lla(beacon_e)
    H = z.H.copy()
    H[:, ATT] += skew(z.residual) @ C_en(lat, lon).T @ turning
    return replace(z, H=H)


def _range_at_reception(
    state: State, geometry: ArrayGeometry, sight: Sighting
) -> tuple[float, Array]:
    """Measured range freed of its scale and of the motion since the ping.  # (M.83)

    The (25,) derivatives are those of the motion.
    """
    range_m = float(sight.measured[2]) / (1.0 + state.range_scale)
    by_range = np.zeros(N_FULL)
    if sight.transmit is not None:
        lever_b = geometry.lever_b + state.lever_b
        there, by_there = leg(state, lever_b, sight.beacon_e, sight.transmit)
        back, by_back = leg(state, lever_b, sight.beacon_e, None)
        range_m += 0.5 * (back - there)
        by_range = 0.5 * (by_back - by_there)
    return range_m, by_range
