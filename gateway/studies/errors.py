"""Seeded errors on a perfect voyage: inertial, acoustic, and of the first state."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gateway.config.blocks import Initial, InitialSigma
from gateway.emulator.acoustics import AcousticErrors, acoustic_errors
from gateway.emulator.sensors import ImuErrorSource
from gateway.emulator.streams import generator
from gateway.fusion.state import N_FULL
from gateway.messages import Fix, UsblFix
from gateway.nav.attitude import C_from_euler, euler_from_C, turn
from gateway.nav.earth import ecef_to_lla
from gateway.studies.voyage import Times, Voyage

Array = NDArray[np.float64]

Shape = Literal["gaussian", "uniform"]


@dataclass(frozen=True)
class Measured:
    """One run's measurements.

    Attributes
    ----------
    rows
        (n, 8) increments with their errors.
    fixes
        In the order of time.
    told_ns
        (k,) when a filter is told each fix; None tells it all beforehand, each at its own time.
    initial
        The first state a filter is told.
    constants
        (16,) true biases and acoustic errors, in the order of the full error state.
    """

    rows: Array
    fixes: Sequence[Fix]
    initial: Initial
    constants: Array
    told_ns: Times | None = None


def draw(voyage: Voyage, seed: int, attitude: Shape = "gaussian") -> Measured:
    """Draw all errors of a run from the scenario's sigmas.

    Parameters
    ----------
    attitude
        How the first attitude's error is drawn; uniform ones have the same sigma.
    """
    imu_name, imu = voyage.imu
    imu_errors = ImuErrorSource(imu, seed, imu_name)
    bias = imu_errors.bias.copy()
    rows = voyage.rows.copy()
    rows[:, 1:7] += imu_errors.next(len(rows))
    name, model = voyage.usbl
    acoustic = acoustic_errors(msgspec.structs.replace(voyage.scenario, seed=seed), name, model)
    constants = np.zeros(N_FULL - 9)
    constants[:6] = bias
    constants[6:12] = [
        *acoustic.theta,
        acoustic.elevation,
        acoustic.bearing,
        acoustic.range_scale,
    ]
    return Measured(
        rows, _fixes(voyage, seed, acoustic), first_state(voyage, seed, attitude), constants
    )


def without(voyage: Voyage) -> Measured:
    """A run without any error: what the filter does on it is linearised along the truth."""
    none = AcousticErrors(np.zeros(3), 0.0, 0.0, 0.0)
    zero = np.zeros(9)
    return Measured(
        voyage.rows,
        _sentences(voyage, none, np.zeros((len(voyage.replies.beacon), 3))),
        displaced(voyage, zero),
        np.zeros(N_FULL - 9),
    )


def first_state(voyage: Voyage, seed: int, attitude: Shape = "gaussian") -> Initial:
    """The true first state with errors drawn from the scenario's sigmas."""
    sigma = voyage.scenario.initial.sigma
    z = generator(seed, "initial").standard_normal(9)
    if attitude == "uniform":
        z[6:] = np.sqrt(3.0) * generator(seed, "initial", "uniform").uniform(-1.0, 1.0, 3)
    return displaced(voyage, z * _sigmas(sigma))


def _sigmas(sigma: InitialSigma) -> Array:
    return np.concatenate([sigma.position_m, [sigma.velocity_m_s] * 3, sigma.attitude_deg])


def displaced(voyage: Voyage, error: Array) -> Initial:
    """The true first state with a given (9,) error: NED m, NED m/s, Euler degrees."""
    truth = voyage.truth
    C = truth.C_en[0]
    lat, lon, h = ecef_to_lla(truth.r_e[0] + C @ error[:3])
    euler = np.degrees(np.array(euler_from_C(C.T @ truth.C_eb[0]))) + error[6:]
    turned = np.degrees(np.array(euler_from_C(C_from_euler(*np.radians(euler)))))
    v_n = C.T @ truth.v_eb_e[0] + error[3:6]
    roll, pitch, heading = turned.tolist()
    north, east, down = v_n.tolist()
    return Initial(
        lat_deg=float(np.degrees(lat)),
        lon_deg=float(np.degrees(lon)),
        height_m=float(h),
        attitude_deg=(roll, pitch, heading),
        velocity_ned_m_s=(north, east, down),
        sigma=voyage.scenario.initial.sigma,
    )


def _fixes(voyage: Voyage, seed: int, acoustic: AcousticErrors) -> list[UsblFix]:
    """The replies as the imperfect array states them."""
    name, model = voyage.usbl
    white = generator(seed, name, "noise").standard_normal((len(voyage.replies.beacon), 3))
    sigma = [np.radians(model.noise.elevation_deg), np.radians(model.noise.bearing_deg)]
    return _sentences(voyage, acoustic, white * [*sigma, model.noise.range_m])


def _sentences(voyage: Voyage, acoustic: AcousticErrors, noise: Array) -> list[UsblFix]:
    name, model = voyage.usbl
    replies = voyage.replies
    C_bu = C_from_euler(*np.radians(model.mounting_deg))
    turned = C_bu.T @ Rotation.from_rotvec(-acoustic.theta).as_matrix() @ C_bu
    x, y, z = (replies.direction_u @ turned.T).T
    elevation = np.arctan2(-z, np.hypot(x, y)) + acoustic.elevation + noise[:, 0]
    bearing = np.arctan2(y, x) + acoustic.bearing + noise[:, 1]
    bearing = turn(bearing)
    slant_range = replies.slant_range * (1.0 + acoustic.range_scale) + noise[:, 2]
    columns = (replies.t_ns, replies.beacon, elevation, bearing, slant_range)
    return [
        UsblFix(int(t), name, beacon, float(e), float(b), float(r))
        for t, beacon, e, b, r in zip(*columns, strict=True)
    ]
