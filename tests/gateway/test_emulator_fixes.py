"""Every acoustic format of the registry: a short mission said by the emulator, read by the gateway.

Truth comes from the trajectory's places alone: where array and beacon are when the reply is heard.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from msgspec import UNSET

from drivers import registry
from drivers.records import UsblRecord
from gateway.config.blocks import Config
from gateway.emulator import acoustics, twin
from gateway.emulator.instruments import stream
from gateway.emulator.scenario import Scenario, codec_options
from gateway.emulator.trajectory import Trajectory
from gateway.ingest import intakes
from gateway.messages import Measurement, RadialRate, UsblFix
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler
from gateway.schema import build
from tests.gateway.emulated import START, demo_data, make, track

T0_NS = 5_000_000_000_000
DURATION_S = 20.0
LEVER = np.array([0.5, -0.2, 0.8])
MOUNTING_DEG = (2.0, -3.0, 30.0)
NOISE = {"bearing_deg": 0.2, "elevation_deg": 0.2, "range_m": 0.1, "range_rate_m_s": 0.02}
BEACONS = {
    "1": {"lat_deg": -33.0006, "lon_deg": -71.9994, "height_m": -140.0, "turnaround_ms": 30.0},
    "2": {"lat_deg": -33.0004, "lon_deg": -72.0009, "height_m": -110.0},
}
ELEMENTS = ((0.1, 0, 0), (0, 0.1, 0), (-0.1, 0, 0), (0, -0.1, 0), (0, 0, 0))
S2C = {
    "options": {"velocity_positive": "closing"},
    "says": ["rate", "fix", "differences"],
    "age_ms": 250.0,
    "elements_m": ELEMENTS,
    "element_noise_us": 0.02,
    "clock": {"source": "device", "latency_ms": 5.0},
    "time": {"since": "start", "offset_s": 1234.5, "drift_ppm": 20.0},
}
CASES: dict[str, dict[str, Any]] = {
    "tracklink-lxt": {},
    "tracklink-lxt, by north": {"axes": "north", "options": {"bearing_reference": "north"}},
    "tracklink-tp2": {},
    "tracklink-tp2, by north": {"axes": "north", "options": {"bearing_reference": "north"}},
    "tracklink-log": {},
    "tracklink-gll": {"axes": "earth", "options": {"beacon": "1"}},
    "evologics": S2C,
    "evologics, angles": {"says": ["angles"]},
    "evologics, its differences": S2C | {"direction": "differences"},
    "psimssb": {"no_reply": "NRy", "options": {"levelled": False}},
    "psimssb, levelled": {"axes": "level"},
    "psimssb, by north": {"axes": "north"},
    "gaps, PTSAX": {"axes": "level"},
    "gaps, PTSAY": {"axes": "north", "options": {"array_depth_m": 20.0}},
    "gaps, PTSAG": {"axes": "earth"},
    "psonlld": {"axes": "earth"},
    "pazm3": {"no_reply": "timeout"},
    "usrth": {"options": {"beacon": "1"}},
    "usrth, true": {"options": {"beacon": "1", "angles": "true"}, "axes": "north"},
    "seatrac": {},
    "micronnav": {"axes": "level"},
    "micronnav, by its head": {"options": {"levelled": False}},
}


@dataclass(frozen=True)
class Said:
    """A mission as the gateway's decoder and its intake have it."""

    scenario: Scenario
    records: list[Any]
    measurements: list[Measurement]
    rejected: int


def scenario_of(device: dict[str, Any], **changes: Any) -> Scenario:
    data = demo_data() | {"trajectory": track("circle", radius_m=60.0), "duration_s": DURATION_S}
    data |= {"beacons": BEACONS, "seed": 3} | changes
    if device.get("options", {}).get("beacon") == "1":
        data["beacons"] = {"1": BEACONS["1"]}
    data["devices"] = {"imu0": data["devices"]["imu0"], "a0": device}
    scenario = make(data)
    assert not list(acoustics.faults(scenario, "a0", scenario.devices["a0"]))
    return scenario


def array(codec: str, **changes: Any) -> dict[str, Any]:
    common = {
        "kind": "usbl",
        "codec": codec,
        "port": {"type": "udp", "port": 7002},
        "period_s": 0.5,
        "clock": {"source": "arrival", "latency_ms": 150.0},
        "mounting_deg": MOUNTING_DEG,
        "lever_arm_m": LEVER.tolist(),
        "noise": NOISE,
    }
    return common | changes


def heard(scenario: Scenario) -> Said:
    model = scenario.devices["a0"]
    truth = Trajectory(scenario.trajectory, scenario.duration_s)
    faults: list[str] = []
    config = build(Config, twin.gateway_config(scenario), faults)
    assert config is not None, faults
    intake = intakes(config)["a0"]
    decoder = registry.lookup(model.codec).decoder(codec_options(model))
    records = []
    for emission in stream(scenario, "a0", model, truth, START, 1.0):
        t_ns = T0_NS + round(1e9 * emission.t)
        intake.feed(emission.data, t_ns)
        records += decoder.feed(emission.data, t_ns)
    records += decoder.close()
    intake.close()
    return Said(scenario, records, intake.flush(), intake.counts.rejected_bytes)


class Geometry:
    """Where array and beacons really are at (n,) moments."""

    def __init__(self, scenario: Scenario, t: list[float], beacons: list[str]) -> None:
        model = scenario.devices["a0"]
        self.t = np.array(t)
        self._truth = Trajectory(scenario.trajectory, scenario.duration_s)
        self._lever = np.array(model.lever_arm_m)
        blocks = [scenario.beacons[beacon] for beacon in beacons]
        lat, lon = np.deg2rad([[b.lat_deg for b in blocks], [b.lon_deg for b in blocks]])
        self.height = np.array([b.height_m for b in blocks])
        self.lat, self.lon = lat, lon
        self._b_e = earth.lla_to_ecef(lat, lon, self.height)
        self._turnaround = np.array([1e-3 * b.turnaround_ms for b in blocks])

    def distance(self, t: np.ndarray, place_b: np.ndarray | None = None) -> np.ndarray:
        pose = self._truth.pose(t)
        l_b = self._lever if place_b is None else place_b
        return np.linalg.norm(pose.r_e + pose.C_eb @ l_b - self._b_e, axis=1)

    @cached_property
    def two_way(self) -> np.ndarray:
        """Half the way out and back, the reply heard at ``t``."""
        back = self.distance(self.t)
        out = back
        for _ in range(6):
            out = self.distance(self.t - (out + back) / 1500.0 - self._turnaround)
        return 0.5 * (out + back)

    @cached_property
    def rate(self) -> np.ndarray:
        return (self.distance(self.t + 0.02) - self.distance(self.t - 0.02)) / 0.04

    def polar(self, axes: str, mounting_deg: Any) -> tuple[np.ndarray, np.ndarray]:
        """Bearing and elevation in the axes of a record, deg."""
        pose, g = self._truth.pose(self.t), self._truth.geodetic(self.t)
        r_e = self._b_e - pose.r_e - pose.C_eb @ self._lever
        C_bu = C_from_euler(*np.deg2rad(mounting_deg))
        C_nu = C_from_euler(g.roll, g.pitch, g.heading) @ C_bu
        r_u = np.einsum("nji,nj->ni", pose.C_eb @ C_bu, r_e)
        x, y, z = np.einsum("nij,nj->in", C_nu, r_u) if axes != "array" else r_u.T
        bearing = np.arctan2(y, x)
        if axes == "level":
            bearing = bearing - np.arctan2(C_nu[:, 1, 0], C_nu[:, 0, 0])
        return np.rad2deg(bearing), np.rad2deg(np.arctan2(-z, np.hypot(x, y)))


def turn(a: Any, b: Any) -> np.ndarray:
    return (np.asarray(a) - b + 180.0) % 360.0 - 180.0


def sightings(
    said: Said, wanted: Callable[[UsblRecord], bool]
) -> tuple[list[UsblRecord], Geometry]:
    """Records of a sort with the truth of when they were heard, by when they left."""
    model = said.scenario.devices["a0"]
    late_ms = model.clock.latency_ms
    chosen, t = [], []
    for record in said.records:
        assert isinstance(record, UsblRecord), record
        assert record.valid, record
        age_ms = 0.0 if record.range_rate_m_s is not None else model.age_ms
        if wanted(record):
            chosen.append(record)
            t.append((record.t_rx_ns - T0_NS) * 1e-9 - 1e-3 * (late_ms + age_ms))
    return chosen, Geometry(said.scenario, t, [record.beacon for record in chosen])


@pytest.fixture(params=CASES, scope="module")
def said(request: pytest.FixtureRequest) -> Said:
    case: str = request.param
    return heard(scenario_of(array(case.split(",")[0], **CASES[case])))


def test_every_acoustic_codec_is_here() -> None:
    acoustic = {c.name for c in registry.all_codecs() if c.kind in ("usbl", "lbl")}
    assert acoustic == {case.split(",")[0] for case in CASES} | {"micromodem"}


def test_records_say_where_the_beacons_are(said: Said) -> None:
    model = said.scenario.devices["a0"]
    records, true = sightings(said, lambda r: r.bearing_deg is not None)
    if model.axes == "earth":
        assert not records
        return
    assert said.rejected == 0
    assert len(records) == pytest.approx(DURATION_S / model.period_s, abs=2)
    assert {r.beacon for r in records} == said.scenario.beacons.keys()
    bearing_deg, elevation_deg = true.polar(records[0].axes, model.mounting_deg)
    level = np.cos(np.deg2rad(elevation_deg))
    across = level * turn([r.bearing_deg for r in records], bearing_deg)
    upward = np.array([r.elevation_deg for r in records]) - elevation_deg
    wanted = 0.2 * np.sqrt(
        1.0 + level**2
    )  # across the line of sight: the elevation's and the bearing's
    assert np.mean((across**2 + upward**2) / wanted**2) == pytest.approx(1.0, abs=0.4)
    assert np.abs([across.mean(), upward.mean()]).max() < 0.1
    ranges = [r.slant_range_m for r in records]
    if "fix" in model.says:
        assert np.std(ranges - true.two_way) == pytest.approx(0.1, rel=0.3)
        assert abs(np.mean(ranges - true.two_way)) < 0.05
    else:
        assert ranges == [None] * len(ranges)


def test_places_on_the_earth_are_the_beacons(said: Said) -> None:
    """Wrong by no more than angle, range and the format's own steps explain."""
    if said.scenario.devices["a0"].axes != "earth":
        return
    records, true = sightings(said, lambda r: r.lat_deg is not UNSET)
    assert said.rejected == 0
    assert len(records) == pytest.approx(DURATION_S / 0.5, abs=2)
    R_M, R_N = earth.radii(true.lat)
    north = (np.deg2rad([r.lat_deg for r in records]) - true.lat) * R_M
    east = (np.deg2rad([r.lon_deg for r in records]) - true.lon) * R_N * np.cos(true.lat)
    deep = [0.0 if r.depth_m is UNSET else r.depth_m for r in records]
    deep += np.where(np.array(deep) == 0.0, 0.0, true.height)
    coarse_m = 18.0 if records[0].depth_m is UNSET else 0.1
    sigma_m = np.hypot(np.deg2rad(0.2) * true.two_way, 0.1)
    assert np.all(np.linalg.norm([north, east, deep], axis=0) < 4.0 * sigma_m + coarse_m)


def test_rates_and_differences_are_those_of_the_elements(said: Said) -> None:
    model = said.scenario.devices["a0"]
    records, true = sightings(said, lambda r: r.range_rate_m_s is not None)
    assert bool(records) == ("rate" in model.says)
    if records:
        errors = np.array([r.range_rate_m_s for r in records]) - true.rate
        assert errors.std() == pytest.approx(0.02, rel=0.3)
        assert abs(errors.mean()) < 0.01
    records, true = sightings(said, lambda r: r.differences is not UNSET)
    assert bool(records) == ("differences" in model.says)
    if records:
        places = LEVER + np.array(ELEMENTS) @ C_from_euler(*np.deg2rad(MOUNTING_DEG)).T
        distances = np.array([true.distance(true.t, place) for place in places])
        expected_s = (distances[:4] - distances[4]) / (1500.0 - true.rate)
        told_s = np.array([[d.delay_s for d in r.differences] for r in records]).T
        assert {(d.element, d.than) for d in records[0].differences} == {(k, "5") for k in "1234"}
        assert np.std(told_s - expected_s) == pytest.approx(0.02e-6 * np.sqrt(2.0), rel=0.2)
        assert abs(np.mean(told_s - expected_s)) < 0.01e-6


def test_the_gateway_measures_the_truth(said: Said) -> None:
    """What its intake makes of them; places on the Earth are none of its measurements."""
    model = said.scenario.devices["a0"]
    if model.axes == "earth":
        assert not said.measurements
        return
    fixes = [fix for fix in said.measurements if isinstance(fix, UsblFix)]
    rates = [fix for fix in said.measurements if isinstance(fix, RadialRate)]
    assert len(fixes) + len(rates) == len(said.measurements)
    assert bool(rates) == ("rate" in model.says)
    if rates:
        told = np.array([fix.rates[0] for fix in rates])
        assert np.abs(told - of(said, rates).rate).max() < 0.1
    seen = [fix for fix in fixes if fix.bearing is not None]
    assert {fix.axes for fix in seen} == {model.axes}
    bearing_deg, elevation_deg = of(said, seen).polar(model.axes, model.mounting_deg)
    across = turn(np.rad2deg([fix.bearing for fix in seen]), bearing_deg)
    assert np.abs(across * np.cos(np.deg2rad(elevation_deg))).max() < 0.8
    assert np.abs(np.rad2deg([fix.elevation for fix in seen]) - elevation_deg).max() < 0.8
    ranged = [fix for fix in fixes if fix.slant_range is not None]
    assert bool(ranged) == ("fix" in model.says)
    if ranged:
        assert np.abs([f.slant_range for f in ranged] - of(said, ranged).two_way).max() < 0.45


def of(said: Said, fixes: list[Any]) -> Geometry:
    times = [(fix.t_ns - T0_NS) * 1e-9 for fix in fixes]
    return Geometry(said.scenario, times, [fix.beacon for fix in fixes])
