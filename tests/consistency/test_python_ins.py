"""The inertial part against python-ins: the same increments, the same loose positions, two filters.

python-ins keeps its state in north, east and down, its errors as modified phi angles and its mean
and covariance in pandas: nothing of it is shared with this project. Biases are constant, noise and
first covariance the same on both sides. The long form: ``pytest -m slow tests/consistency``.
"""

import warnings
from dataclasses import dataclass
from functools import cache

import numpy as np
import pandas as pd
import pyins
import pytest

from gateway.fusion.errors import FAMILY
from gateway.fusion.kalman import Linearised, update
from gateway.fusion.state import ATT, BA, BG, POS, VEL, State
from gateway.nav import earth, strapdown
from gateway.nav.attitude import C_from_euler, euler_error_map, euler_from_C
from tests.gateway.voyages import perfect_rows, trajectory

SIGMA_FIX_M = 1.0
PERIOD_S = 2.0
SIGMA_POSITION_M, SIGMA_VELOCITY, SIGMA_LEVEL, SIGMA_HEADING = 3.0, 0.1, 0.02, 0.2
"""m, m/s, deg, deg. Heading errors of 1 deg part any two error definitions by centimetres."""
AGREE_M, AGREE_DEG = 0.005, 0.01


@dataclass(frozen=True)
class Grade:
    """Bias sigmas and random walks of an IMU, SI units."""

    gyro_bias: float
    arw: float
    accel_bias: float
    vrw: float


GRADES = {
    "navigation": Grade(9.7e-8, 5.8e-7, 5e-4, 5e-5),  # 0.02 deg/h, 0.002 deg/sqrt(h), 50 and 5 ug
    "tactical": Grade(4.8e-6, 3.6e-5, 1e-2, 5e-4),  # 1 deg/h, 0.12 deg/sqrt(h), 1000 and 50 ug
}


class Problem:
    """One seeded voyage: first state with its errors, increments, positions."""

    def __init__(self, grade: Grade, seconds: float, rate_hz: float, seed: int) -> None:
        self.grade, self.rate_hz = grade, rate_hz
        rng = np.random.default_rng(seed)
        self.truth = trajectory("lawnmower", seconds + 10.0, lat_deg=40.0, height_m=0.0)
        dt = 1.0 / rate_hz
        self.rows = perfect_rows(self.truth, seconds, rate_hz)
        n = len(self.rows)
        bias = rng.normal(0.0, np.repeat([grade.gyro_bias, grade.accel_bias], 3))
        white = rng.normal(0.0, np.repeat([grade.arw, grade.vrw], 3), (n, 6))
        self.rows[:, 1:7] += bias * dt + white * np.sqrt(dt)
        self.t = (np.arange(n) + 1) * dt
        self.t_fix = np.arange(PERIOD_S, seconds, PERIOD_S)
        g = self.truth.geodetic(self.t_fix)
        self.fixes = _moved(g.lat, g.lon, g.h, rng.normal(0.0, SIGMA_FIX_M, (len(g.lat), 3)))
        g = self.truth.geodetic(np.zeros(1))
        shift = rng.normal(0.0, SIGMA_POSITION_M, (1, 3))
        self.lla0 = np.array([x[0] for x in _moved(g.lat, g.lon, g.h, shift)])
        self.v0 = g.v_eb_n[0] + rng.normal(0.0, SIGMA_VELOCITY, 3)
        sigma = np.radians([SIGMA_LEVEL, SIGMA_LEVEL, SIGMA_HEADING])
        self.euler0 = np.array([g.roll[0], g.pitch[0], g.heading[0]]) + rng.normal(0.0, sigma)


def _moved(lat, lon, h, ned):
    R_M, R_N = earth.radii(lat)
    dlon = ned[:, 1] / ((R_N + h) * np.cos(lat))
    return lat + ned[:, 0] / (R_M + h), lon + dlon, h - ned[:, 2]


@dataclass(frozen=True)
class Answer:
    """What a filter says after each fix: latitude, longitude (rad), height (m), heading (rad).

    ``sd_end`` (3,) m: sigma of north, east and down position after the last fix.
    """

    table: np.ndarray
    sd_end: np.ndarray


def ours(problem: Problem, error: str) -> Answer:
    grade, (lat, lon, h) = problem.grade, problem.lla0
    C, r0 = earth.C_en(lat, lon), earth.lla_to_ecef(lat, lon, h)
    M = C @ euler_error_map(*problem.euler0[1:])
    sigma = np.radians([SIGMA_LEVEL, SIGMA_LEVEL, SIGMA_HEADING])
    P = np.zeros((15, 15))
    P[ATT, ATT] = M @ np.diag(sigma**2) @ M.T
    sigmas = (SIGMA_VELOCITY, SIGMA_POSITION_M, grade.gyro_bias, grade.accel_bias)
    for part, sd in zip((VEL, POS, BG, BA), sigmas, strict=True):
        P[part, part] = sd**2 * np.eye(3)
    state = State.at(C @ C_from_euler(*problem.euler0), C @ problem.v0, r0, P)
    q = np.array([grade.arw**2, grade.vrw**2, 0.0, 0.0])
    H = np.zeros((3, 15))
    H[:, POS] = np.eye(3)
    step = round(PERIOD_S * problem.rate_hz)
    table, names = [], ("x_m", "y_m", "z_m")
    for k, measured in enumerate(earth.lla_to_ecef(*problem.fixes)):
        rows = problem.rows[k * step : (k + 1) * step]
        strapdown.run(state.x, state.P, rows, q, np.empty((step, 12)))
        z = Linearised(state.r_e - measured, H, SIGMA_FIX_M**2 * np.eye(3), names)
        update(state, z, FAMILY[error], r0)
        lla = earth.ecef_to_lla(state.r_e)
        C = earth.C_en(lla[0], lla[1])
        table.append([*lla, euler_from_C(C.T @ state.C_eb)[2]])
    return Answer(np.array(table, dtype=float), np.sqrt((C.T @ state.P[POS, POS] @ C).diagonal()))


@cache
def theirs(problem: Problem) -> Answer:
    grade, degrees = problem.grade, np.degrees
    start = pd.Series(
        [*degrees(problem.lla0[:2]), problem.lla0[2], *problem.v0, *degrees(problem.euler0)],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        name=0.0,
    )
    imu = pd.DataFrame(
        np.vstack([np.zeros(6), problem.rows[:, 1:7]]),
        index=np.concatenate([[0.0], problem.t]),
        columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"],
    )
    lat, lon, h = problem.fixes
    data = pd.DataFrame({"lat": degrees(lat), "lon": degrees(lon), "alt": h}, problem.t_fix)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pandas, at what python-ins asks of it
        result = pyins.filters.run_feedback_filter(
            start,
            SIGMA_POSITION_M,
            SIGMA_VELOCITY,
            SIGMA_LEVEL,
            SIGMA_HEADING,
            pyins.strapdown.compute_increments_from_imu(imu, "increment"),
            pyins.inertial_sensor.EstimationModel(grade.gyro_bias, grade.arw),
            pyins.inertial_sensor.EstimationModel(grade.accel_bias, grade.vrw),
            [pyins.measurements.Position(data, SIGMA_FIX_M)],
            time_step=1.0,
        )
    nearest = np.searchsorted(result.trajectory.index + 1e-6, problem.t_fix)
    at_fixes = result.trajectory.iloc[nearest]
    assert np.abs(at_fixes.index - problem.t_fix).max() < 1e-6
    table = at_fixes[["lat", "lon", "alt", "heading"]].to_numpy(copy=True)
    table[:, [0, 1, 3]] = np.radians(table[:, [0, 1, 3]])
    sd = result.trajectory_sd[["north", "east", "down"]]
    return Answer(table, sd[sd.index < problem.t_fix[-1] + 1e-6].iloc[-1].to_numpy())


@cache
def problem(grade: str, seconds: float, rate_hz: float) -> Problem:
    return Problem(GRADES[grade], seconds, rate_hz, seed=1)


def apart(a: Answer, b: Answer) -> tuple[np.ndarray, np.ndarray]:
    """North, east, down (n, 3) in m and heading (n,) in deg between two answers."""
    d = a.table - b.table
    R_M, R_N = earth.radii(b.table[:, 0])
    metres = np.column_stack([d[:, 0] * R_M, d[:, 1] * R_N * np.cos(b.table[:, 0]), -d[:, 2]])
    return metres, np.degrees((d[:, 3] + np.pi) % (2.0 * np.pi) - np.pi)


def check(p: Problem, error: str) -> None:
    mine, other = ours(p, error), theirs(p)
    metres, degrees = apart(mine, other)
    worst = np.abs(metres).max(axis=0)
    print(f"{error}: {worst * 1e3} mm, {np.abs(degrees).max():.4f} deg")
    assert worst.max() < AGREE_M
    assert np.abs(degrees).max() < AGREE_DEG
    np.testing.assert_allclose(mine.sd_end, other.sd_end, rtol=0.02)
    g = p.truth.geodetic(p.t_fix)
    truth = Answer(np.column_stack([g.lat, g.lon, g.h, g.heading]), mine.sd_end)
    half = len(p.t_fix) // 2
    assert np.sqrt(np.mean(apart(mine, truth)[0][half:] ** 2)) < 0.7 * SIGMA_FIX_M


@pytest.mark.parametrize("error", sorted(FAMILY))
@pytest.mark.parametrize("grade", sorted(GRADES))
def test_a_minute_agrees_to_millimetres(grade, error):
    check(problem(grade, 60.0, 100.0), error)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("error", sorted(FAMILY))
@pytest.mark.parametrize("grade", sorted(GRADES))
def test_a_thousand_seconds_agree_to_millimetres(grade, error):
    check(problem(grade, 1000.0, 200.0), error)
