"""A dive without a beacon: receiver at the surface, log, depth and compass under it."""

from pathlib import Path
from typing import Any

import numpy as np

from gateway import replay
from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.schema import build
from tests.gateway.emulated import START
from tests.integration.scores import errors, read

DIVE: dict[str, Any] = {
    "seed": 4,
    "duration_s": 60.0,
    "start": START,
    "surface_height_m": 12.0,
    "sea_bed_depth_m": 45.0,
    "trajectory": {
        "type": "transit",
        "lat_deg": 63.4,
        "lon_deg": 10.4,
        "height_m": 12.0,
        "course_deg": 300.0,
        "distance_m": 90.0,
        "speed_m_s": 2.0,
        "ramp_s": 10.0,
        "cruise_height_m": 4.0,
        "dive_m": 25.0,
        "pitches": True,
        "sway": {
            "roll": [{"amplitude": 3.0, "period_s": 7.0}],
            "yaw": [{"amplitude": 2.0, "period_s": 9.0}],
        },
    },
    "initial": {
        "sigma": {"position_m": [5, 5, 2], "velocity_m_s": 0.2, "attitude_deg": [0.3, 0.3, 2.0]}
    },
    "devices": {
        "imu0": {
            "kind": "imu",
            "codec": "stim300",
            "grade": "mems",
            "rate_hz": 125,
            "age_ms": 1.0,
            "port": {"type": "udp", "port": 7001},
        },
        "gnss0": {
            "kind": "gnss",
            "codec": "nmea-gnss",
            "clock": {"latency_ms": 80},
            "lever_arm_m": [0.2, 0.0, -0.2],
            "noise": {"position_m": [1.0, 1.0, 2.0], "velocity_m_s": 0.1},
            "port": {"type": "udp", "port": 7002},
        },
        "dvl0": {
            "kind": "dvl",
            "codec": "nortek-dvl",
            "age_ms": 60,
            "mounting_deg": [0, 0, 45],
            "lever_arm_m": [-0.4, 0.0, 0.3],
            "noise": {"velocity_m_s": [0.01, 0.01, 0.01]},
            "port": {"type": "udp", "port": 7003},
        },
        "depth0": {
            "kind": "depth",
            "codec": "paroscientific",
            "rate_hz": 2,
            "options": {"latitude_deg": 63.4},
            "noise": {"depth_m": 0.05},
            "port": {"type": "udp", "port": 7004},
        },
        "heading0": {
            "kind": "heading",
            "codec": "nmea-heading",
            "rate_hz": 2,
            "noise": {"heading_deg": 1.0},
            "port": {"type": "udp", "port": 7005},
        },
    },
}
SD = {"north": "sd_n_m", "east": "sd_e_m", "up": "sd_d_m", "heading": "sd_heading_deg"}


def test_the_gateway_follows_a_dive(tmp_path: Path) -> None:
    """All that was said is understood, and the error is within three sigma."""
    scenario = twin.sound(DIVE)
    sea, truth = tmp_path / "sea.pcap", tmp_path / "truth.csv"
    emulate(scenario, pcap=sea, truth=truth, say=lambda _line: None)
    faults: list[str] = []
    config = build(Config, twin.gateway_config(scenario), faults)
    assert config is not None, faults
    summary = replay.run([sea], config, out=tmp_path / "out")
    understood(summary["devices"])
    within_three_sigma(tmp_path / "out" / "nav.csv", truth)


def understood(devices: dict[str, Any]) -> None:
    """The receiver has a fix at the beginning and at the end."""
    assert all(not device["rejected"] for device in devices.values())
    assert devices["dvl0"]["measurements"] == 300
    assert devices["depth0"]["measurements"] == devices["heading0"]["measurements"] == 120
    assert 2 * 10 < devices["gnss0"]["measurements"] < 2 * 35
    assert devices["gnss0"]["ignored"]["invalid"] > 2 * 25


def within_three_sigma(nav: Path, truth: Path) -> None:
    found, solved = errors(nav, truth), read(nav)
    inside = (solved["t_s"] >= found.t[0]) & (solved["t_s"] <= found.t[-1])
    for name, sd in SD.items():
        share = np.mean(np.abs(getattr(found, name)) <= 3.0 * solved[sd][inside])
        assert share > 0.99, (name, share)
    rms = found.rms(START + 10.0)
    assert rms["horizontal"] < 2.0
    assert rms["vertical"] < 0.2
    assert rms["heading"] < 1.5
