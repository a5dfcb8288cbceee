"""What the state says in the words of its users: geodetic solution and estimated constants."""

import math

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.initial import DEG_H, UG
from gateway.fusion.kalman import Linearised
from gateway.fusion.state import ATT, BG, State
from gateway.messages import Calibration, Component, Constant, NavSolution
from gateway.modes import Mode, claimable
from gateway.nav.attitude import euler_error_map, euler_from_C
from gateway.nav.earth import C_en, ecef_to_lla
from gateway.nav.geodetic import words

Array = NDArray[np.float64]

_DEG = math.radians(1.0)
_CONSTANTS: tuple[tuple[str, float], ...] = (
    *((f"gyro_bias_{axis}_deg_h", DEG_H) for axis in "xyz"),
    *((f"accel_bias_{axis}_ug", UG) for axis in "xyz"),
    *((f"mounting_{axis}_deg", _DEG) for axis in "xyz"),
    ("elevation_offset_deg", _DEG),
    ("bearing_offset_deg", _DEG),
    ("range_scale", 1.0),
    *((f"lever_arm_{axis}_m", 1.0) for axis in "xyz"),
    ("latency_ms", 1e-3),
)


def solution(
    state: State, t_ns: int, mode: Mode, fix_age_s: float | None, used: int, rejected: int
) -> NavSolution:
    """The navigation solution with its 1-sigma errors in NED and Euler angles.  # (M.50)

    `mode` is what fixes allow it to claim; a heading that is not known makes it less.
    """
    w = words(state.x, state.P).tolist()
    return NavSolution(
        t_ns=t_ns,
        mode=claimable(mode, w[17]),
        lat=w[0],
        lon=w[1],
        h=w[2],
        v_eb_n=(w[3], w[4], w[5]),
        roll=w[6],
        pitch=w[7],
        heading=w[8],
        sd_position=(w[9], w[10], w[11]),
        sd_velocity=(w[12], w[13], w[14]),
        sd_attitude=(w[15], w[16], w[17]),
        cov_ne=w[18],
        fix_age_s=fix_age_s,
        fixes_used=used,
        fixes_rejected=rejected,
    )


def calibration(state: State, t_ns: int) -> Calibration:
    """Estimated constants with sigma, in the units of their names."""
    names = [_CONSTANTS[i] for i in state.columns[9:] - 9]
    sigma = np.sqrt(np.maximum(state.P.diagonal()[BG.start :], 0.0))
    return Calibration(
        t_ns,
        tuple(
            Constant(name, float(value / unit), float(sd / unit))
            for (name, unit), value, sd in zip(names, state.constants, sigma, strict=True)
        ),
    )


def calibration_covariance(state: State) -> tuple[list[str], Array]:
    """Names and covariance of the estimated constants and of roll, pitch and heading.

    The attitude is there because it is what a mounting angle is most easily taken for.

    Returns
    -------
    names, P
        n names with their units at the end, (n, n) in the products of these units.
    """
    C = C_en(*ecef_to_lla(state.r_e)[:2])
    _, pitch, heading = (float(v) for v in euler_from_C(C.T @ state.C_eb))
    constants = [_CONSTANTS[i] for i in state.columns[BG.start :] - BG.start]
    A = np.zeros((3 + len(constants), len(state.P)))
    A[:3, ATT] = np.degrees(np.linalg.inv(euler_error_map(pitch, heading)) @ C.T)
    A[3:, BG.start :] = np.diag([1.0 / unit for _, unit in constants])
    return [
        "roll_deg",
        "pitch_deg",
        "heading_deg",
        *(name for name, _ in constants),
    ], A @ state.P @ A.T


def components_of(z: Linearised, S: Array) -> tuple[Component, ...]:
    """Rows of an innovation in edge units: measured minus predicted, degrees and metres."""
    out = []
    for name, residual, variance in zip(z.names, z.residual, S.diagonal(), strict=True):
        unit = np.degrees(1.0) if name.endswith("_deg") else 1.0
        out.append(Component(name, float(-residual * unit), float(np.sqrt(variance) * unit)))
    return tuple(out)
