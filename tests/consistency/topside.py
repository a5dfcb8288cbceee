"""A topside that levels, turns or places what its array hears, from the emulator's truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from gateway.config import Config
from gateway.emulator.acoustics import acoustic_errors
from gateway.emulator.scenario import Scenario
from gateway.emulator.streams import generator
from gateway.estimator import Estimator
from gateway.messages import BeaconPlace, Innovation, NavSolution, SavedState, UsblFix
from gateway.nav import earth
from tests.consistency import runs
from tests.gateway.emulated import make
from tests.gateway.voyages import T0_NS, Voyage, configuration

TILT_DEG, HEADING_DEG = 0.3, 0.6
MOUNTING_DEG = (5.0, -3.0, 40.0)
Words = Literal["level", "north", "place"]
Polar = tuple[float, float, float]
"""Elevation, bearing (rad) and range (m)."""
DURATION_S = 81.0
JUDGED_S = (40, 80)


@dataclass
class Heard:
    """One reply at the array: its (3,) place in array axes (m) and (3, 3) attitude, array to e."""

    t_ns: int
    beacon: str
    r_u: np.ndarray
    C_eu: np.ndarray
    r_e: np.ndarray
    """(3,) the array's own place."""


class Topside(Voyage):
    """What one run's array hears, and how its topside tells it."""

    def heard_at_array(self) -> Iterator[Heard]:
        """The beacon as the array has it at each reply; the range is the measured one."""
        block = self.scenario.devices["usbl0"]
        roll, pitch, heading = block.mounting_deg
        C_bu = Rotation.from_euler("ZYX", [heading, pitch, roll], degrees=True).as_matrix()
        f = self.heard
        pose = self.truth.pose(f.t_rx)
        for k in np.argsort(f.t_rx):
            b = self.scenario.beacons[f.beacon[k]]
            b_e = earth.lla_to_ecef(np.radians(b.lat_deg), np.radians(b.lon_deg), b.height_m)
            r_e = pose.r_e[k] + pose.C_eb[k] @ block.lever_arm_m
            C_eu = pose.C_eb[k] @ C_bu
            r_u = C_eu.T @ (b_e - r_e)
            r_u *= f.slant_range[k] / np.linalg.norm(r_u)
            yield Heard(T0_NS + round(f.t_rx[k] * 1e9), f.beacon[k], r_u, C_eu, r_e)

    def told(self, h: Heard, words: Words, nav: NavSolution | None) -> UsblFix | BeaconPlace:
        """A reply in words: turned by its own sensor or, where it follows one, by a solution."""
        rng = generator(self.scenario.seed, "topside", str(h.t_ns))
        if nav is None:
            told = _turned(h, _vector(self._noisy(h.r_u, rng)), words, rng)
            return _fix(h, self._offset(_polar(told)), words)
        roll, pitch, heading = self.scenario.devices["usbl0"].mounting_deg
        C_bu = Rotation.from_euler("ZYX", [heading, pitch, roll], degrees=True)
        C_nb = Rotation.from_euler("ZYX", [nav.heading, nav.pitch, nav.roll])
        seen_n = (C_nb * C_bu).apply(_vector(self._offset(self._noisy(h.r_u, rng))))
        if words == "place":
            from_imu = C_nb.apply(self.scenario.devices["usbl0"].lever_arm_m) + seen_n
            at = earth.lla_to_ecef(nav.lat, nav.lon, nav.h)
            lat, lon, _ = earth.ecef_to_lla(at + earth.C_en(nav.lat, nav.lon) @ from_imu)
            return BeaconPlace(h.t_ns, "usbl0", h.beacon, float(lat), float(lon))
        if words == "level":
            ahead = (C_nb * C_bu).as_euler("ZYX")[0]
            seen_n = Rotation.from_euler("Z", ahead).inv().apply(seen_n)
        return _fix(h, _polar(seen_n), words)

    def _noisy(self, r_u: np.ndarray, rng: np.random.Generator) -> Polar:
        """Elevation, bearing and range of a place, the angles with the declared white errors."""
        noise = self.scenario.devices["usbl0"].noise
        by_elevation, by_bearing = rng.normal(size=2)
        elevation, bearing, range_m = _polar(r_u)
        elevation += np.radians(noise.elevation_deg) * by_elevation
        return elevation, bearing + np.radians(noise.bearing_deg) * by_bearing, range_m

    def _offset(self, told: Polar) -> Polar:
        """The same with the constant errors of what is told."""
        constant = acoustic_errors(self.scenario, "usbl0", self.scenario.devices["usbl0"])
        elevation, bearing, range_m = told
        return elevation + constant.elevation, bearing + constant.bearing, range_m


def _turned(h: Heard, r_u: np.ndarray, words: Words, rng: np.random.Generator) -> np.ndarray:
    """A place (3,) in array axes, turned by the topside's own motion sensor: its error is white."""
    tilt, turn = np.radians([TILT_DEG, HEADING_DEG])
    heading, pitch, roll = Rotation.from_matrix(_C_en(h.r_e).T @ h.C_eu).as_euler("ZYX")
    heading = heading + turn * rng.normal() if words == "north" else 0.0
    by_sensor = [heading, pitch + tilt * rng.normal(), roll + tilt * rng.normal()]
    return Rotation.from_euler("ZYX", by_sensor).apply(r_u)


def _polar(place: np.ndarray) -> Polar:
    x, y, z = place
    elevation, bearing = np.arctan2(-z, np.hypot(x, y)), np.arctan2(y, x)
    return float(elevation), float(bearing), float(np.linalg.norm(place))


def _vector(polar: Polar) -> np.ndarray:
    elevation, bearing, range_m = polar
    level = range_m * np.cos(elevation)
    return np.array(
        [level * np.cos(bearing), level * np.sin(bearing), -range_m * np.sin(elevation)]
    )


def _fix(h: Heard, polar: Polar, axes: Words) -> UsblFix:
    return UsblFix(h.t_ns, "usbl0", h.beacon, *polar, axes)


def _C_en(r_e: np.ndarray) -> np.ndarray:
    lat, lon, _ = earth.ecef_to_lla(r_e)
    return earth.C_en(lat, lon)


def scenario(seed: int) -> Scenario:
    """The circle of `runs`, the array mounted askew but no further out than by its offsets."""
    data = runs.scenario_data(seed, DURATION_S)
    usbl = data["devices"]["usbl0"]
    usbl["mounting_deg"] = list(MOUNTING_DEG)
    usbl["prior"] = {"bearing_deg": 0.2, "elevation_deg": 0.2, "range_scale": 0.002}
    return make(data)


def with_sensor(config: Config, factor: float, follows: bool) -> Config:
    """The configuration told of the motion sensor's noise, or of whom it follows."""
    plain = msgspec.to_builtins(config)
    block = plain["devices"]["usbl0"]
    block["noise"] |= {"tilt_deg": factor * TILT_DEG, "heading_deg": factor * HEADING_DEG}
    block["navigates_by"] = "gateway" if follows else "itself"
    return msgspec.convert(plain, Config)


def run(
    seed: int,
    words: Words,
    error: str = "right_invariant",
    follows: bool = False,
    sensor: float = 1.0,
) -> runs.Run:
    """One seeded run; the estimator gets what a live gateway would get, in order of arrival."""
    topside = Topside(scenario(seed))
    config = configuration(topside.scenario, filter={"error": error})
    estimator = Estimator(with_sensor(config, sensor, follows), rate_hz=100.0 if follows else 1.0)
    heard = {h.t_ns: h for h in topside.heard_at_array()}
    navs: dict[int, NavSolution] = {}
    innovations, states = [], []
    for measurement in topside.arrivals(runs.LATENCY_S, block_s=0.5):
        if isinstance(measurement, UsblFix):
            h = heard[measurement.t_ns]
            nav = navs.get(_hundredth(h.t_ns))
            measurement = topside.told(h, words, nav if follows else None)
        for output in estimator.feed(measurement):
            if isinstance(output, Innovation):
                innovations.append(output)
            elif isinstance(output, SavedState):
                states.append(output)
            elif isinstance(output, NavSolution):
                navs[_hundredth(output.t_ns)] = output
    return runs.Run(
        np.array([v.nis for v in innovations]),
        np.array([len(v.components) for v in innovations]),
        np.array([runs.judge(topside, states[k]) for k in JUDGED_S]),
        len(states[0].columns) // 8,
    )


def _hundredth(t_ns: int) -> int:
    return round((t_ns - T0_NS) * 1e-7)
