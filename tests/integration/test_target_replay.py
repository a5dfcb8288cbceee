"""From the array's sentences in a capture to targets.csv: bytes in, the target's truth out."""

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
from tests.consistency.following import STRAIGHT, rov
from tests.gateway.emulated import demo_data

DURATION_S, SETTLED_S = 90.0, 40.0
FORMATS: dict[str, dict[str, Any]] = {
    "array": {"codec": "tracklink-lxt"},
    "level": {"codec": "psimssb", "axes": "level"},
}
OWN: dict[str, dict[str, Any]] = {
    "gnss0": {
        "kind": "gnss",
        "codec": "nmea-gnss",
        "clock": {"latency_ms": 80},
        "lever_arm_m": [-5.0, 0.0, -12.0],
        "noise": {"position_m": [0.5, 0.5, 1.0], "velocity_m_s": 0.1},
        "port": {"type": "udp", "port": 7002},
    },
    "compass0": {
        "kind": "heading",
        "codec": "nmea-heading",
        "noise": {"heading_deg": 0.5},
        "port": {"type": "udp", "port": 7003},
    },
}
"""Receiver and compass of a ship that hears no moored beacon."""


def scenario(axes: str, own: str) -> dict[str, Any]:
    """A ship that circles over a target, its array's direction told in some axes."""
    data = demo_data() | {"duration_s": DURATION_S}
    data["trajectory"] |= {"height_m": 0.0, "radius_m": 150.0}
    data["devices"]["imu0"]["rate_hz"] = 50
    noise = {"bearing_deg": 0.3, "elevation_deg": 0.3, "range_m": 0.2}
    usbl = {"lever_arm_m": [8.0, -3.0, 4.0], "outliers": {}, "period_s": 1.0, "prior": {}}
    if axes == "level":
        noise |= {"tilt_deg": 0.05}
    data["devices"]["usbl0"] |= usbl | FORMATS[axes] | {"noise": noise}
    data["beacons"] = {"B01": data["beacons"]["1"], "B02": rov(**STRAIGHT)}
    if axes == "array":
        data["beacons"] = dict(zip(("1", "2"), data["beacons"].values(), strict=True))
    if own == "gnss":
        data["devices"] |= OWN
        del data["beacons"][min(data["beacons"])]
    return data


def table(path: Path) -> dict[str, np.ndarray]:
    with path.open() as file:
        rows = [{k: v for k, v in row.items() if k != "state"} for row in csv.DictReader(file)]
    names = {row.pop("name") for row in rows if "name" in row}
    assert names <= {"rov"}
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}


@pytest.mark.parametrize(
    ("axes", "own"), [("array", "beacon"), ("level", "beacon"), ("array", "gnss")]
)
def test_a_target_is_where_truth_has_it(tmp_path: Path, axes: str, own: str) -> None:
    sea = twin.for_capture(twin.sound(scenario(axes, own)))
    emulate(sea, pcap=tmp_path / "sea.pcap", truth=tmp_path / "t.csv", say=lambda _line: None)
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(twin.gateway_config(sea)))
    replay.run([tmp_path / "sea.pcap"], load(tmp_path / "c.yaml"), out=tmp_path, rate_hz=1.0)
    truth, found = table(tmp_path / "t-rov.csv"), table(tmp_path / "targets.csv")
    t_s = found["t_s"]
    late = (t_s > truth["t_s"][0] + SETTLED_S) & (t_s < truth["t_s"][0] + DURATION_S - 1.0)
    assert late.sum() > 40
    north, east, up = (
        scale * (found[key] - np.interp(t_s, truth["t_s"], truth[key]))[late]
        for key, scale in (("lat_deg", 111_132.0), ("lon_deg", 85_530.0), ("height_m", 1.0))
    )
    for error, sd in ((north, "sd_n_m"), (east, "sd_e_m"), (up, "sd_d_m")):
        assert np.mean(np.abs(error) < 3.0 * found[sd][late]) > 0.95
    assert np.hypot(north, east).max() < 5.0
