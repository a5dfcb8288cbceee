"""Emulated missions by each family of acoustic instrument, replayed and held against the truth."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gateway import replay
from gateway.config import load
from gateway.emulator import twin
from gateway.emulator.player import emulate
from tests.gateway.emulated import demo_data
from tests.integration.scores import errors, read

START = 1_780_012_770.0
"""Half a minute before midnight."""
DURATION_S, SETTLED_S = 75.0, 20.0
OUTAGE_S = (40.0, 65.0)
IMU = {
    "kind": "imu",
    "codec": "kvh1750",
    "port": {"type": "udp", "port": 7001},
    "options": {"gyro": "delta_angle_rad", "accel": "g"},
    "rate_hz": 50,
    "clock": {"source": "device", "latency_ms": 0.5},
    "noise": {
        "angle_random_walk_deg_sqrt_h": 0.012,
        "gyro_bias_deg_h": 0.1,
        "velocity_random_walk_ug_sqrt_hz": 50,
        "accel_bias_ug": 100,
    },
}
S2C = {
    "kind": "usbl",
    "codec": "evologics",
    "port": {"type": "udp", "port": 7002},
    "options": {"velocity_positive": "closing"},
    "says": ["rate", "fix", "differences"],
    "direction": "differences",
    "age_ms": 250.0,
    "jitter_ms": 5.0,
    "no_fix_s": [OUTAGE_S],
    "elements_m": [[0.1, 0, 0], [0, 0.1, 0], [-0.1, 0, 0], [0, -0.1, 0], [0, 0, 0]],
    "element_noise_us": 0.4,
    "clock": {"source": "device", "latency_ms": 20.0},
    "time": {"since": "start", "offset_s": 600.0, "drift_ppm": 15.0},
    "period_s": 1.0,
    "lever_arm_m": [0.5, 0.0, 0.8],
    "noise": {"bearing_deg": 0.5, "elevation_deg": 0.5, "range_m": 0.2, "range_rate_m_s": 0.02},
    "prior": {"mounting_deg": 0.2, "range_scale": 0.002},
    "missed_probability": 0.1,
    "outliers": {"probability": 0.03},
}
HIPAP = {
    "kind": "usbl",
    "codec": "psimssb",
    "port": {"type": "udp", "port": 7002},
    "clock": {"source": "device", "latency_ms": 400.0},
    "jitter_ms": 20.0,
    "period_s": 1.0,
    "lever_arm_m": [0.5, 0.0, 0.8],
    "noise": {
        "bearing_deg": 0.3,
        "elevation_deg": 0.3,
        "range_m": 0.2,
        "tilt_deg": 0.1,
        "heading_deg": 0.5,
    },
    "prior": {"bearing_deg": 0.3, "range_scale": 0.002},
    "outliers": {"probability": 0.03},
    "missed_probability": 0.1,
    "no_reply": "NRy",
    "timeout_s": 0.7,
}
LBL = {
    "kind": "lbl",
    "codec": "micromodem",
    "port": {"type": "udp", "port": 7002},
    "clock": {"source": "device", "latency_ms": 30.0},
    "lever_arm_m": [1.0, 0.0, -0.3],
    "noise": {"range_m": 1.0},
    "period_s": 5.0,
    "missed_probability": 0.05,
    "timeout_s": 3.0,
    "prior": {"range_scale": 0.001},
}
SIGMAS = {"north": "sd_n_m", "east": "sd_e_m", "up": "sd_d_m", "heading": "sd_heading_deg"}
CORNERS = {"A": (-0.004, -0.004), "B": (0.004, -0.004), "C": (0.004, 0.005), "D": (-0.004, 0.005)}


def mission(device: dict[str, Any], beacons: dict[str, Any], seed: int, folder: Path) -> Path:
    """Emulate into a capture and replay it with the configuration that matches; the files' folder.

    The errors stay within three of the filter's own sigmas from `SETTLED_S` on, all the time.
    """
    whole = {
        "seed": seed,
        "duration_s": DURATION_S,
        "start": START,
        "trajectory": demo_data()["trajectory"] | {"height_m": -10.0},
        "devices": {"imu0": IMU, "a0": device},
        "beacons": beacons,
        "initial": {
            "sigma": {"position_m": [5, 5, 1], "velocity_m_s": 0.2, "attitude_deg": [0.1, 0.1, 0.5]}
        },
    }
    (folder / "scenario.yaml").write_text(yaml.safe_dump(whole))
    scenario = twin.load(folder / "scenario.yaml")
    capture, truth = folder / "sea.pcap", folder / "truth.csv"
    emulate(scenario, pcap=capture, truth=truth, say=lambda _line: None)
    config = twin.gateway_config(twin.for_capture(scenario))
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    replay.run([capture], load(folder / "config.yaml"), out=folder, rate_hz=2.0)
    nav = read(folder / "nav.csv")
    error = errors(folder / "nav.csv", truth)
    settled = error.t > START + SETTLED_S
    for name in ("north", "east", "up", "heading"):
        sigma = nav[SIGMAS[name]][: len(error.t)]
        assert np.abs(getattr(error, name) / sigma)[settled].max() < 3.0, name
    return folder


def used(folder: Path, component: str) -> Any:
    """Times (s after the start) of the fixes of which a component was used."""
    with (folder / "innovations.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["component"] == component]
    return np.array([float(row["t_s"]) - START for row in rows if row["accepted"] == "1"])


def test_differences_and_rates_through_an_outage(tmp_path: Path) -> None:
    """Seed 002: angles by the elements, and while there is no fix the rate goes on."""
    beacons = {"7": {"lat_deg": 39.8004, "lon_deg": 116.2, "height_m": -60.0}}
    folder = mission(S2C, beacons, 4, tmp_path)
    begin, end = OUTAGE_S
    for component in ("bearing_deg", "range_m"):
        t = used(folder, component)
        assert not np.any((t > begin) & (t < end))
        assert len(t) > 30
    t = used(folder, "range_rate_m_s")
    assert np.sum((t > begin) & (t < end)) > 0.8 * (end - begin)


def test_four_ranges_of_a_long_baseline(tmp_path: Path) -> None:
    """Seed 001: ranges alone, each of the moment at which its reply was heard."""
    beacons = {
        name: {
            "lat_deg": 39.8 + north,
            "lon_deg": 116.2 + east,
            "height_m": -70.0,
            "turnaround_ms": 50.0,
        }
        for name, (north, east) in CORNERS.items()
    }
    folder = mission(LBL, beacons, 3, tmp_path)
    assert len(used(folder, "range_m")) > 45


@pytest.mark.parametrize("axes", ["level", "north"])
def test_fixes_that_a_topside_has_turned(axes: str, tmp_path: Path) -> None:
    """Two beacons in turn, by the second of the day in the sentences, midnight among them."""
    beacons = {
        "B01": {"lat_deg": 39.8004, "lon_deg": 116.2, "height_m": -60.0},
        "B02": {"lat_deg": 39.7997, "lon_deg": 116.2005, "height_m": -70.0, "turnaround_ms": 40.0},
    }
    folder = mission(HIPAP | {"axes": axes}, beacons, 5, tmp_path)
    assert len(used(folder, "range_m")) > 50
