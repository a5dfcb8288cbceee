"""A ship circles over a target that moves: the whole estimator and its tracks against the truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec
import numpy as np

from gateway.config import Config
from gateway.emulator.trajectory import Trajectory
from gateway.estimator import Estimator
from gateway.messages import Measurement, NavSolution, TargetSighting, UsblFix
from gateway.nav import earth
from gateway.targets import Followed, Targets
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import T0_NS, Voyage, configuration

LATENCY_S = 0.5
"""From the reply's arrival to the sentence's."""
LEVER_M = (8.0, -3.0, 4.0)
SETTLED_S = 60.0
"""From when on the track is judged."""
STRAIGHT = {"type": "line", "speed_m_s": 1.0, "course_deg": 30.0}
TURNS = {
    "type": "legs",
    "speed_m_s": 1.0,
    "course_deg": 30.0,
    "leg_m": 40.0,
    "turn_m": 8.0,
    "turns_deg": [90.0, -90.0],
}
_BELOW = {"lat_deg": 39.7995, "lon_deg": 116.2, "height_m": -120.0}


def rov(**track: Any) -> dict[str, Any]:
    """A target's block, 120 m deep and under the circle."""
    return {"role": "target", "name": "rov", "trajectory": _BELOW | track}


@dataclass
class Tracked:
    """A target over one run: (n, 3) errors in north, east, down (m), (n, 3, 3) as claimed."""

    t_s: np.ndarray
    error: np.ndarray
    P: np.ndarray

    @cached_property
    def horizontal_m(self) -> float:
        """RMS."""
        return float(np.sqrt(np.mean(np.sum(self.error[:, :2] ** 2, axis=1))))

    @cached_property
    def nees(self) -> np.ndarray:
        """(n,) squares of the errors by what was claimed; 3 on average where that is right."""
        solved = np.linalg.solve(self.P, self.error[:, :, None])[:, :, 0]
        return np.asarray(np.sum(self.error * solved, axis=1))


class Sea(Voyage):
    """One run's arrivals; what the gateway is told of them may be wrong."""

    @cached_property
    def paths(self) -> dict[str, Trajectory]:
        """True ways of the targets."""
        mobile = self.scenario.mobile
        return {n: Trajectory(b.trajectory, self.scenario.duration_s) for n, b in mobile.items()}

    def told(self, declared_s: float, late_s: float) -> Iterator[Measurement]:
        """Arrivals `late_s` after the replies, timed as `declared_s` of `LATENCY_S` has it."""
        off_ns = round((LATENCY_S - declared_s) * 1e9)
        for one in self.arrivals(late_s, block_s=0.5):
            if isinstance(one, UsblFix):
                yield msgspec.structs.replace(one, t_ns=one.t_ns + off_ns)
            else:
                yield one

    def compare(self, one: Followed) -> tuple[float, np.ndarray, np.ndarray]:
        """Time (s), error (3,) in north, east, down (m), and its covariance as claimed."""
        place = one.place
        assert place is not None
        t_s = (place.t_ns - T0_NS) * 1e-9
        true_e = self.paths[one.beacon].pose(np.array([t_s])).r_e[0]
        found_e = earth.lla_to_ecef(place.lat, place.lon, place.h)
        C_ne = earth.C_en(place.lat, place.lon).T
        return t_s, C_ne @ (found_e - true_e), place.P[:3, :3]


def sea(
    seed: int, duration_s: float = 240.0, targets: dict[str, Any] | None = None, **usbl: Any
) -> Sea:
    """Circle of 150 m at 3 m/s; one moored beacon and the targets are asked in turn."""
    data = demo_data() | {"seed": seed, "duration_s": duration_s, "vehicle": "ship"}
    place = {"lat_deg": 39.8, "lon_deg": 116.2}
    data["trajectory"] = place | {
        "type": "circle",
        "height_m": 0.0,
        "radius_m": 150.0,
        "speed_m_s": 3.0,
    }
    data["beacons"] = {"1": place | {"height_m": -80.0}} | (targets or {"2": rov(**STRAIGHT)})
    data["devices"]["imu0"]["rate_hz"] = 50.0
    noise = {"bearing_deg": 0.3, "elevation_deg": 0.3, "range_m": 0.2}
    data["devices"]["usbl0"] |= {
        "lever_arm_m": list(LEVER_M),
        "period_s": 1.0,
        "outliers": {},
        "noise": noise,
    } | usbl
    return Sea(make(data))


def told_otherwise(
    config: Config, lever_m: tuple[float, float, float], acceleration_m_s2: float | None
) -> Config:
    """The configuration told of another lever arm, and of another motion of the targets."""
    plain = msgspec.to_builtins(config)
    plain["devices"]["usbl0"]["lever_arm_m"] = list(lever_m)
    if acceleration_m_s2 is not None:
        for address in config.targets:
            plain["beacons"][address]["acceleration_m_s2"] = acceleration_m_s2
    return msgspec.convert(plain, Config)


def run(
    of: Sea,
    *,
    declared_s: float = LATENCY_S,
    lever_m: tuple[float, float, float] = LEVER_M,
    late_s: float = LATENCY_S,
    acceleration_m_s2: float | None = None,
    settled_s: float = SETTLED_S,
) -> dict[str, Tracked]:
    """The tracks of one run by the beacons' addresses, once a second.

    Parameters
    ----------
    declared_s, lever_m
        What the gateway is told.
    late_s
        When a fix really arrives.
    """
    config = told_otherwise(configuration(of.scenario), lever_m, acceleration_m_s2)
    estimator, targets = Estimator(config, rate_hz=1.0), Targets(config.targets)
    rows: dict[str, list[tuple[float, np.ndarray, np.ndarray]]] = {b: [] for b in config.targets}
    for measurement in of.told(declared_s, late_s):
        for output in estimator.feed(measurement):
            if isinstance(output, TargetSighting):
                targets.take(output)
            elif isinstance(output, NavSolution):
                for one in targets.due(output.t_ns):
                    rows[one.beacon].append(of.compare(one))
    settled = {n: [row for row in found if row[0] > settled_s] for n, found in rows.items()}
    return {n: Tracked(*map(np.array, zip(*found, strict=True))) for n, found in settled.items()}
