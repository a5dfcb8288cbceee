"""Voyages of the emulator as the mathematics sees them: increments, fixes and truth, no bytes."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.acoustics import Fixes, acoustic_errors, measure
from gateway.emulator.scenario import Scenario
from gateway.emulator.scenario.trajectory import Track
from gateway.emulator.sensors import ImuErrorSource, increments
from gateway.emulator.trajectory import Trajectory
from gateway.fusion.state import N_FULL, N_STATES, State
from gateway.messages import ImuBlock, Measurement, UsblFix
from gateway.nav import earth
from gateway.schema import build
from tests.gateway.emulated import demo_data, make, track

T0_NS = 1_000_000_000_000
"""Host time of the start of every voyage."""


def trajectory(kind: str, duration_s: float = 120.0, **changes: Any) -> Trajectory:
    data = demo_data() | {"trajectory": track(kind, **changes), "duration_s": duration_s}
    return Trajectory(make(data).trajectory, duration_s)


def true_state(truth: Trajectory, t_s: float) -> State:
    """The state that knows the pose exactly and takes all constants as zero."""
    at = np.array([t_s])
    pose, g = truth.pose(at), truth.geodetic(at)
    v_e = earth.C_en(g.lat[0], g.lon[0]) @ g.v_eb_n[0]
    return State.at(pose.C_eb[0], v_e, pose.r_e[0], np.zeros((N_STATES, N_STATES)))


def epochs(duration_s: float, rate_hz: float) -> np.ndarray:
    return (np.arange(round(duration_s * rate_hz)) + 1) / rate_hz


@lru_cache(maxsize=4)
def sensed(block: Track, duration_s: float, rate_hz: float) -> np.ndarray:
    """(k, 6) increments of a perfect IMU: the same for every seed."""
    truth = Trajectory(block, duration_s)
    return increments(truth, epochs(duration_s, rate_hz), 1.0 / rate_hz)


def rows_of(inc: np.ndarray, dt: float) -> np.ndarray:
    """Increments (k, 6) as the (k, 8) rows of the strapdown."""
    rows = np.zeros((len(inc), 8))
    rows[:, 0] = dt
    rows[:, 1:7] = inc
    return rows


def perfect_rows(truth: Trajectory, t_s: float, rate_hz: float) -> np.ndarray:
    """Rows of a perfect IMU from 0 to `t_s`."""
    dt = 1.0 / rate_hz
    return rows_of(increments(truth, epochs(t_s, rate_hz), dt), dt)


def block(t_ns: np.ndarray, rows: np.ndarray) -> ImuBlock:
    return ImuBlock(t_ns.astype(np.int64).tobytes(), np.ascontiguousarray(rows).tobytes())


def configuration(scenario: Scenario, **blocks: Any) -> Config:
    """The configuration that matches a scenario, some of its blocks replaced."""
    faults: list[str] = []
    config = build(Config, twin.gateway_config(scenario) | blocks, faults)
    assert config is not None, faults
    return config


@dataclass
class Voyage:
    """One scenario's measurements, with ``imu0`` and ``usbl0``."""

    scenario: Scenario

    @cached_property
    def truth(self) -> Trajectory:
        return Trajectory(self.scenario.trajectory, self.scenario.duration_s)

    @cached_property
    def errors(self) -> ImuErrorSource:
        return ImuErrorSource(self.scenario.devices["imu0"], self.scenario.seed, "imu0")

    @cached_property
    def rate_hz(self) -> float:
        return self.scenario.devices["imu0"].rate_hz

    @cached_property
    def t_imu(self) -> np.ndarray:
        return epochs(self.scenario.duration_s, self.rate_hz)

    @cached_property
    def t_ns(self) -> np.ndarray:
        return T0_NS + np.rint(self.t_imu * 1e9).astype(np.int64)

    @cached_property
    def rows(self) -> np.ndarray:
        inc = sensed(self.scenario.trajectory, self.scenario.duration_s, self.rate_hz)
        return rows_of(inc + self.errors.next(len(inc)), 1.0 / self.rate_hz)

    @cached_property
    def heard(self) -> Fixes:
        return measure(self.scenario, "usbl0", self.scenario.devices["usbl0"], self.truth)

    @cached_property
    def fixes(self) -> list[UsblFix]:
        """In the order of time."""
        f = self.heard
        columns = (f.t_rx.tolist(), f.beacon, f.elevation, f.bearing, f.slant_range)
        found = [
            UsblFix(T0_NS + round(t * 1e9), "usbl0", b, float(e), float(a), float(r))
            for t, b, e, a, r in zip(*columns, strict=True)
        ]
        return sorted(found, key=lambda fix: fix.t_ns)

    @cached_property
    def constants(self) -> np.ndarray:
        """True (16,) biases and acoustic errors, in the order of the full error state."""
        a = acoustic_errors(self.scenario, "usbl0", self.scenario.devices["usbl0"])
        acoustic = [*a.theta, a.elevation, a.bearing, a.range_scale, 0.0, 0.0, 0.0, 0.0]
        return np.concatenate([self.errors.bias, acoustic])

    def state(self, t_s: float) -> State:
        """The true state, constants too, certain of everything."""
        pose = true_state(self.truth, t_s)
        state = State.at(pose.C_eb, pose.v_eb_e, pose.r_e, np.zeros((N_FULL, N_FULL)))
        state.add_constants(self.constants)
        return state

    def arrivals(self, latency_s: float, block_s: float = 0.05) -> Iterator[Measurement]:
        """Blocks and fixes in the order in which a live gateway would get them."""
        waiting = list(self.fixes)
        step = max(1, round(block_s * self.rate_hz))
        for k in range(0, len(self.t_ns), step):
            part = slice(k, k + step)
            yield block(self.t_ns[part], self.rows[part])
            while waiting and waiting[0].t_ns + latency_s * 1e9 <= self.t_ns[part][-1]:
                yield waiting.pop(0)
