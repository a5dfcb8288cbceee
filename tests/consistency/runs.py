"""Monte Carlo runs of the whole estimator on the emulator's circle about a beacon, in process."""

from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.stats import chi2

from gateway.config import Config
from gateway.estimator import Estimator
from gateway.fusion.errors import FAMILY
from gateway.fusion.saved import state_of
from gateway.fusion.state import POS, State
from gateway.messages import Innovation, SavedState
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import T0_NS, Voyage, configuration

ADDITIVE = FAMILY["additive"]
LATENCY_S = 0.5
JUDGED_S = (60, 120, 200)
"""When the state is compared with the truth."""


def scenario_data(seed: int, duration_s: float = 201.0) -> dict:
    """Circle of 71.4 m at 3 m/s in a seaway, a fix every 2 s (000, section 3), as modelled."""
    data = demo_data() | {"seed": seed, "duration_s": duration_s}
    imu, usbl = data["devices"]["imu0"], data["devices"]["usbl0"]
    imu["rate_hz"] = 100.0
    imu["noise"] = {
        "angle_random_walk_deg_sqrt_h": 0.002,
        "gyro_bias_deg_h": 0.02,
        "velocity_random_walk_ug_sqrt_hz": 5,
        "accel_bias_ug": 500,
    }
    usbl["noise"] = {"bearing_deg": 1.0, "elevation_deg": 1.0, "range_m": 0.43}
    usbl["prior"] = {"mounting_deg": 0.2, "bearing_deg": 0.2, "elevation_deg": 0.2}
    usbl["prior"]["range_scale"] = 0.002
    usbl["outliers"] = {}
    sigma = {"position_m": [5, 5, 1], "velocity_m_s": 0.1, "attitude_deg": [0.02, 0.02, 0.2]}
    data["initial"] = {"sigma": sigma}
    return data


@dataclass
class Run:
    """Normalised squares of one run.

    Attributes
    ----------
    nis, rows
        (k,) of each innovation, and its degrees of freedom.
    nees
        (times, 3) of position, pose and all states at `JUDGED_S`.
    states
        Number of all states.
    """

    nis: np.ndarray
    rows: np.ndarray
    nees: np.ndarray
    states: int


def tuned(config: Config, angle_factor: float) -> Config:
    """The configuration with the angle noise it assumes changed."""
    plain = msgspec.to_builtins(config)
    for name in ("bearing_deg", "elevation_deg"):
        plain["devices"]["usbl0"]["noise"][name] *= angle_factor
    return msgspec.convert(plain, Config)


def run(seed: int, error: str = "right_invariant", angle_factor: float = 1.0) -> Run:
    """One seeded run; the estimator gets what a live gateway would get, in order of arrival."""
    voyage = Voyage(make(scenario_data(seed)))
    config = tuned(configuration(voyage.scenario, filter={"error": error}), angle_factor)
    estimator = Estimator(config, rate_hz=1.0)
    innovations, states = [], []
    for measurement in voyage.arrivals(LATENCY_S, block_s=0.5):
        for output in estimator.feed(measurement):
            if isinstance(output, Innovation):
                innovations.append(output)
            elif isinstance(output, SavedState):
                states.append(output)
    return Run(
        np.array([v.nis for v in innovations]),
        np.array([len(v.components) for v in innovations]),
        np.array([judge(voyage, states[k]) for k in JUDGED_S]),
        len(states[0].columns) // 8,
    )


def judge(voyage: Voyage, saved: SavedState) -> list[float]:
    """NEES of position, of the pose and of all states."""
    estimate = state_of(saved)
    P = estimate.P
    truth = State(voyage.state((saved.t_ns - T0_NS) * 1e-9).x, P, estimate.columns)
    xi = ADDITIVE.boxminus(estimate, truth, truth.r_e)
    scale = np.sqrt(P.diagonal())

    def square(part: slice) -> float:
        e, s = xi[part] / scale[part], scale[part]
        return float(e @ np.linalg.solve(P[part, part] / np.outer(s, s), e))

    return [square(POS), square(slice(0, 9)), square(slice(None))]


@dataclass
class Statistic:
    """Mean of many squares, per degree of freedom, with the bounds it should lie in."""

    name: str
    value: float
    low: float
    high: float

    @property
    def inside(self) -> bool:
        return self.low < self.value < self.high


def statistics(
    runs: list[Run], probability: float = 0.95, judged_s: tuple[int, ...] = JUDGED_S
) -> list[Statistic]:
    """NEES at each time, NIS over everything; a consistent filter has all of them inside.

    The bounds hold for all together with `probability` (Bonferroni).
    """
    nees = np.mean([r.nees for r in runs], axis=0)
    freedom = (3, 9, runs[0].states)
    names = ("position", "pose", "all states")
    squares = [
        (f"NEES of {name}, {t} s", nees[i, j] / dof, dof * len(runs))
        for i, t in enumerate(judged_s)
        for j, (name, dof) in enumerate(zip(names, freedom, strict=True))
    ]
    rows = int(sum(r.rows.sum() for r in runs))
    squares.append(("NIS", sum(r.nis.sum() for r in runs) / rows, rows))
    tail = 0.5 * (1.0 - probability) / len(squares)
    return [
        Statistic(name, float(value), *(chi2.ppf([tail, 1.0 - tail], dof) / dof))
        for name, value, dof in squares
    ]
