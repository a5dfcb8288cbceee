"""A vehicle at the surface, from two captures: its IMU and a receiver, no beacon in sight."""

import json
import subprocess
from pathlib import Path

import yaml

from gateway.emulator import twin
from gateway.emulator.pcap import PcapWriter
from gateway.emulator.player import emulate
from tests.gateway.emulated import START, demo_data, make
from tests.gateway.test_estimator_start import MOWING
from tests.gateway.test_gnss_course import GNSS, sentences
from tests.gateway.voyages import Voyage
from tests.integration.rig import USBLNAV
from tests.integration.scores import errors
from tests.shared_data import ROOT

DURATION_S, LEVEL_S, LATENCY_NS = 60.0, 20.0, 120_000_000


def test_a_replay_finds_its_heading_by_the_course(tmp_path: Path) -> None:
    data = demo_data() | {"duration_s": DURATION_S, "start": START, "trajectory": MOWING}
    scenario = twin.for_capture(make(data))
    imu, gnss, truth = (tmp_path / name for name in ("imu.pcap", "gnss.pcap", "truth.csv"))
    emulate(scenario, pcap=imu, truth=truth, say=lambda _line: None)
    with PcapWriter(gnss) as capture:
        for t_s, heard in sentences(Voyage(scenario), seed=1):
            t_ns = round((START + t_s) * 1e9) + LATENCY_NS
            capture.write(t_ns, 5003, ("127.0.0.1", 7003), heard)
    config = tmp_path / "surface.yaml"
    config.write_text(yaml.safe_dump(surfaced(twin.gateway_config(scenario))))
    done = subprocess.run(
        [*USBLNAV, "replay", imu, gnss, "-c", config, "-o", tmp_path / "out", "--json"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["devices"]["gnss0"]["measurements"] == 2 * DURATION_S
    rms = errors(tmp_path / "out" / "nav.csv", truth).rms(START + 40.0)
    assert rms["horizontal"] < 1.0
    assert rms["heading"] < 1.5


def surfaced(config: dict) -> dict:
    """The twin's configuration with a receiver in the array's stead, the attitude not known."""
    devices = {"imu0": config["devices"]["imu0"], "gnss0": GNSS}
    place = {key: config["initial"][key] for key in ("lat_deg", "lon_deg", "height_m")}
    first = place | {
        "align": {"heading": "gnss_course", "level_s": LEVEL_S, "crab_deg": 1.0},
        "sigma": {"position_m": [5, 5, 5], "velocity_m_s": 3.0},
    }
    return config | {"devices": devices, "beacons": {}, "initial": first}
