"""Emulated receivers, depth sensors, logs and compasses, through the gateway's intake."""

from typing import Any

import numpy as np
import pytest
import yaml

from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.instruments import stream
from gateway.emulator.scenario import Scenario
from gateway.emulator.trajectory import Trajectory
from gateway.errors import ConfigError
from gateway.ingest import DeviceCounts, intakes
from gateway.messages import (
    BottomVelocity,
    Depth,
    HeadingFix,
    Measurement,
    PositionFix,
    VelocityFix,
)
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler
from gateway.schema import build
from tests.gateway.emulated import START, demo_data, make, track

T0_NS = 5_000_000_000
DURATION_S = 30.0
LEVER = [1.5, -0.5, 0.75]
MOUNTING = [1.0, -2.0, 45.0]
LATE = {"latency_ms": 120.0}
PORT = {"type": "udp", "port": 7009}
SURFACE_M, BED_M = -19.5, 40.0
"""The swaying tracks are at -20 m, above or below by half a metre."""

Fixes = list[tuple[float, Measurement]]
"""Times of validity (s after the start), and what was true then as the gateway has it."""


def scenario_of(device: dict[str, Any], **more: Any) -> Scenario:
    data = demo_data() | {"duration_s": DURATION_S, "trajectory": track("line"), "beacons": {}}
    data |= {"surface_height_m": SURFACE_M, "sea_bed_depth_m": BED_M} | more
    return make(
        data | {"devices": {"imu0": data["devices"]["imu0"], "it": {"port": PORT} | device}}
    )


def heard(scenario: Scenario) -> tuple[Fixes, DeviceCounts, int]:
    """Fixes, counts and the number of frames sent."""
    faults: list[str] = []
    config = build(Config, twin.gateway_config(scenario), faults)
    assert config is not None, faults
    intake = intakes(config)["it"]
    trajectory = Trajectory(scenario.trajectory, scenario.duration_s)
    frames = list(stream(scenario, "it", scenario.devices["it"], trajectory, START, 7.0))
    for frame in frames:
        intake.feed(frame.data, T0_NS + round(frame.t * 1e9))
    intake.close()
    fixes = [((fix.t_ns - T0_NS) * 1e-9, fix) for fix in intake.flush()]
    return fixes, intake.counts, len(frames)


def rigid(scenario: Scenario, t: np.ndarray, lever: Any = LEVER) -> tuple[np.ndarray, ...]:
    """Place, velocity by central differences, and C_en and C_eb, of a point on the vehicle."""
    truth, eps = Trajectory(scenario.trajectory, DURATION_S), 1e-3

    def place(t: np.ndarray) -> np.ndarray:
        pose = truth.pose(t)
        return pose.r_e + pose.C_eb @ np.array(lever)

    lat, lon, _ = earth.ecef_to_lla(place(t))
    velocity = (place(t + eps) - place(t - eps)) / (2 * eps)
    return place(t), velocity, earth.C_en(lat, lon), truth.pose(t).C_eb


def normal(errors: np.ndarray, sigma: Any) -> None:
    """Errors (n, k) have no mean and the stated 1-sigma, within what n of them can show."""
    n = len(errors)
    np.testing.assert_array_less(np.abs(errors.mean(axis=0)), 4.5 * np.array(sigma) / np.sqrt(n))
    spread = errors.std(axis=0, ddof=1) / sigma
    np.testing.assert_array_less(np.abs(spread - 1.0), 4.5 / np.sqrt(2 * n))


LOG = {
    "kind": "dvl",
    "mounting_deg": MOUNTING,
    "lever_arm_m": LEVER,
    "noise": {"velocity_m_s": [0.02, 0.03, 0.01]},
}
LOGS: dict[str, dict[str, Any]] = {
    "pd0": {"codec": "pd0", "age_ms": 150.0},
    "pd6": {"codec": "pd6", "clock": LATE},
    "pd6 of Water Linked": {
        "codec": "pd6",
        "options": {"axes": "forward_starboard_down"},
        "scale": 1.02,
    },
    "nortek": {"codec": "nortek-dvl", "age_ms": 80.0, "clock": {"latency_ms": 20.0}},
    "waterlinked": {"codec": "waterlinked-dvl", "age_ms": 60.0, "rate_hz": 8.0},
    "waterlinked by its clock": {"codec": "waterlinked-dvl", "clock": {"source": "device"}},
}


@pytest.mark.parametrize("log", LOGS)
def test_a_log_says_the_velocity_over_the_bottom(log: str) -> None:
    scenario = scenario_of(LOG | LOGS[log])
    fixes, counts, _ = heard(scenario)
    rate = scenario.devices["it"].rate_hz
    assert len(fixes) == DURATION_S * rate
    assert counts.rejected_bytes == 0
    t = np.array([t for t, _ in fixes])
    np.testing.assert_allclose(t, np.arange(len(fixes)) / rate, atol=2e-6)
    assert all(isinstance(fix, BottomVelocity) for _, fix in fixes)
    found = np.array([fix.v for _, fix in fixes])
    _, velocity, _, C_eb = rigid(scenario, t)
    true = np.einsum("nij,ni->nj", C_eb @ C_from_euler(*np.radians(MOUNTING)), velocity)
    normal(found - true, LOG["noise"]["velocity_m_s"])


def test_without_the_bottom_a_log_says_so() -> None:
    """The bed is 38.75 m below the log on the mean, 38.2 to 39.3 m with the swell."""
    scenario = scenario_of(LOG | {"codec": "pd0", "altitude_limits_m": [1.0, 38.7]})
    fixes, counts, frames = heard(scenario)
    assert 0 < counts.ignored["no_lock"] < frames == DURATION_S * 5
    assert len(fixes) + counts.ignored["no_lock"] == frames
    r_e, *_ = rigid(scenario, np.array([t for t, _ in fixes]))
    assert np.all(earth.ecef_to_lla(r_e)[2] - (SURFACE_M - BED_M) <= 38.7 + 1e-9)


def test_a_log_that_is_too_fast_loses_the_bottom() -> None:
    scenario = scenario_of(LOG | {"codec": "pd6", "max_speed_m_s": 2.0})
    fixes, counts, _ = heard(scenario)
    assert 0 < len(fixes) < counts.ignored["invalid"]
    assert max(np.linalg.norm(fix.v) for _, fix in fixes) <= 2.0 + 1e-3


def test_constant_errors_of_a_log_are_as_stated() -> None:
    errors = {"mounting_deg": [0.0, 0.0, 2.0], "scale": 0.01}
    still = LOG | {"codec": "waterlinked-dvl", "noise": {"velocity_m_s": [1e-9] * 3}}
    (plain, _, _), (wrong, _, _) = (
        heard(scenario_of(still | {"mounting_deg": [0, 0, 0]} | more))
        for more in ({}, {"errors": errors})
    )
    true, found = (np.array([fix.v for _, fix in fixes]) for fixes in (plain, wrong))
    turned = 1.01 * true @ C_from_euler(0.0, 0.0, np.radians(2.0))
    np.testing.assert_allclose(found, turned, atol=1e-7)


DEPTH = {
    "kind": "depth",
    "rate_hz": 4.0,
    "lever_arm_m": LEVER,
    "noise": {"depth_m": 0.05},
    "clock": LATE,
}
SENSORS: dict[str, dict[str, Any]] = {
    "nmea": {"codec": "nmea-depth", "options": {"measures": "depth"}},
    "psi": {"codec": "paroscientific"},
    "bar": {"codec": "paroscientific", "options": {"unit": "bar", "latitude_deg": -33.0}},
}


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_depth_is_that_of_the_sensor(sensor: str) -> None:
    scenario = scenario_of(DEPTH | SENSORS[sensor])
    fixes, counts, frames = heard(scenario)
    assert len(fixes) == frames == DURATION_S * 4
    assert counts.rejected_bytes == 0
    t = np.array([t for t, _ in fixes])
    np.testing.assert_allclose(t, np.arange(frames) / 4.0, atol=1e-6)
    assert all(isinstance(fix, Depth) for _, fix in fixes)
    r_e, *_ = rigid(scenario, t)
    heights = np.array([[fix.h] for _, fix in fixes])
    normal(heights - np.array(earth.ecef_to_lla(r_e)[2])[:, None], [0.05])


def test_a_sounder_measures_to_the_bed() -> None:
    options = {"measures": "altitude"}
    scenario = scenario_of(DEPTH | {"codec": "nmea-depth", "options": options})
    fixes, counts, frames = heard(scenario)
    assert not fixes
    assert +counts.ignored == {"altitude": frames}


COMPASS = {
    "kind": "heading",
    "rate_hz": 5.0,
    "mounting_deg": MOUNTING,
    "noise": {"heading_deg": 0.3},
    "clock": LATE,
}
COMPASSES: dict[str, dict[str, Any]] = {
    "hdt": {"codec": "nmea-heading"},
    "prdid": {"codec": "nmea-heading", "attitude": True},
    "pashr": {"codec": "nmea-heading", "clock": LATE | {"source": "device"}},
    "phins": {"codec": "phins", "attitude": True},
}


@pytest.mark.parametrize("compass", COMPASSES)
def test_a_heading_is_that_of_the_compass(compass: str) -> None:
    scenario = scenario_of(COMPASS | COMPASSES[compass])
    fixes, counts, _ = heard(scenario)
    assert len(fixes) == DURATION_S * 5
    assert counts.rejected_bytes == 0
    t = np.array([t for t, _ in fixes])
    np.testing.assert_allclose(t, np.arange(len(fixes)) / 5.0, atol=1e-6)
    assert all(isinstance(fix, HeadingFix) for _, fix in fixes)
    _, _, C_en, C_eb = rigid(scenario, t, [0, 0, 0])
    axis = np.einsum("nji,njk,k->ni", C_en, C_eb, C_from_euler(*np.radians(MOUNTING))[:, 0])
    wrong = np.array([fix.heading for _, fix in fixes]) - np.arctan2(axis[:, 1], axis[:, 0])
    normal(np.degrees((wrong + np.pi) % (2 * np.pi) - np.pi)[:, None], [0.3])


RECEIVER = {
    "kind": "gnss",
    "codec": "nmea-gnss",
    "rate_hz": 4.0,
    "lever_arm_m": LEVER,
    "noise": {"position_m": [1.0, 1.5, 2.0], "velocity_m_s": 0.1},
    "clock": LATE,
    "geoid_m": 30.0,
    "quality": 4,
    "max_depth_m": 10.0,
}


@pytest.mark.parametrize(
    ("says", "source"),
    [(["GGA", "RMC", "ZDA"], "arrival"), (["RMC", "GNS"], "device"), (["VTG", "GGA"], "device")],
)
def test_a_receiver_says_where_its_antenna_is(says: list[str], source: str) -> None:
    told = {"says": says, "clock": LATE | {"source": source}}
    scenario = scenario_of(RECEIVER | told, start=START)
    fixes, counts, frames = heard(scenario)
    assert frames == DURATION_S * 4 * len(says)
    assert counts.rejected_bytes == 0
    places = [(t, fix) for t, fix in fixes if isinstance(fix, PositionFix)]
    speeds = [(t, fix) for t, fix in fixes if isinstance(fix, VelocityFix)]
    assert len(places) == len(speeds) == DURATION_S * 4
    t = np.array([t for t, _ in places])
    np.testing.assert_allclose(t, np.arange(len(places)) / 4.0, atol=1e-6)
    r_e, v_e, C_en, _ = rigid(scenario, t)
    found = np.array([earth.lla_to_ecef(fix.lat, fix.lon, fix.h) for _, fix in places])
    normal(np.einsum("nij,ni->nj", C_en, found - r_e), RECEIVER["noise"]["position_m"])
    true = np.einsum("nij,ni->nj", C_en, v_e)[:, :2]
    normal(np.array([[f.north, f.east] for _, f in speeds]) - true, [0.1, 0.1])


def test_under_water_a_receiver_says_that_it_has_no_fix() -> None:
    """The antenna heaves from 0.75 to 1.75 m below the surface."""
    scenario = scenario_of(RECEIVER | {"max_depth_m": 1.2})
    fixes, counts, _ = heard(scenario)
    t = np.arange(DURATION_S * 4) / 4.0
    afloat = earth.ecef_to_lla(rigid(scenario, t)[0])[2] > SURFACE_M - 1.2
    assert len(fixes) == 2 * afloat.sum()
    assert counts.ignored["invalid"] == 2 * (~afloat).sum() > 0
    assert counts.rejected_bytes == 0


def test_epochs_are_at_whole_periods_of_utc() -> None:
    scenario = scenario_of(RECEIVER | {"says": ["GGA"], "rate_hz": 1.0})
    trajectory = Trajectory(scenario.trajectory, DURATION_S)
    frames = list(stream(scenario, "it", scenario.devices["it"], trajectory, START + 0.3, 7.0))
    assert len(frames) == DURATION_S
    assert frames[0].t == pytest.approx(0.7 + 0.12, abs=1e-6)
    assert frames[0].data.split(b",")[1].endswith(b".00")


ALL: dict[str, dict[str, Any]] = {
    "gnss": RECEIVER,
    "depth": DEPTH | SENSORS["nmea"],
    "dvl": LOG | LOGS["pd0"],
    "heading": COMPASS | COMPASSES["hdt"],
}


@pytest.mark.parametrize("kind", ALL)
def test_the_seed_makes_every_byte_whatever_the_block(kind: str) -> None:
    changed = ALL[kind] | {"jitter_ms": 5.0, "missed_probability": 0.2}
    said: list[Any] = []
    for seed, block_s in ((1, 0.1), (1, 5.0), (2, 5.0)):
        scenario = scenario_of(changed, seed=seed, duration_s=8.0)
        model, trajectory = scenario.devices["it"], Trajectory(scenario.trajectory, DURATION_S)
        said.append(list(stream(scenario, "it", model, trajectory, START, block_s)))
    assert said[0] == said[1] != said[2]


@pytest.mark.parametrize(
    ("device", "more", "fault"),
    [
        (LOG | {"codec": "pd0"}, {"sea_bed_depth_m": None}, "kind: it measures the bottom"),
        (LOG | {"codec": "pd6", "age_ms": 5}, {}, "age_ms: pd6 does not say how old a ping is"),
        (LOG | {"codec": "nmea-gnss"}, {}, "codec: nmea-gnss is of kind gnss"),
        (RECEIVER | {"says": ["GSV"]}, {}, "says[0]: expected one of"),
        (RECEIVER | {"quality": 6}, {}, "quality: expected an integer from 1 to 5"),
        (DEPTH | SENSORS["psi"] | {"rate_hz": 0}, {}, "rate_hz: expected a number > 0"),
        (COMPASS | {"codec": "nmea-heading", "offset": 1}, {}, "offset: unknown key; did you mean"),
    ],
)
def test_faults_name_the_key(
    tmp_path, device: dict[str, Any], more: dict[str, Any], fault: str
) -> None:
    data = demo_data() | {"sea_bed_depth_m": BED_M} | more
    data["devices"] = data["devices"] | {"it": {"port": PORT} | device}
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as caught:
        twin.load(path)
    wanted = f"devices.it.{fault}"
    assert any(line.startswith(wanted) for line in caught.value.faults), caught.value.faults
