"""Every block of docs/emulator.md is one that the emulator takes."""

import re
from typing import Any

import pytest
import yaml

from gateway.emulator import twin
from gateway.emulator.instruments import emissions
from gateway.emulator.scenario import GRADES
from gateway.emulator.trajectory import Trajectory
from tests.gateway.emulated import START
from tests.shared_data import ROOT

TEXT = (ROOT / "docs" / "emulator.md").read_text(encoding="utf-8")
WHOLE, *PARTS = [
    yaml.safe_load(block) for block in re.findall(r"^```yaml\n(.*?)^```", TEXT, re.S | re.M)
]


def joined(part: dict[str, Any]) -> dict[str, Any]:
    """The whole scenario with a part of another in the place of its own, device by device."""
    devices = {n: d for n, d in WHOLE["devices"].items() if n not in part.get("devices", {})}
    return WHOLE | part | {"devices": devices | part.get("devices", {}), "start": START}


@pytest.mark.parametrize("k", range(len(PARTS) + 1))
def test_each_block_can_be_played(k: int) -> None:
    scenario = twin.sound(joined(([{}, *PARTS])[k]) | {"duration_s": 5})
    said = emissions(scenario, Trajectory(scenario.trajectory, 5.0), START, 1.0)
    assert {e.device for e in said} >= set(scenario.devices) - {"usbl0"}


def test_the_table_of_grades_is_that_of_the_code() -> None:
    rows = {
        "angle random walk": lambda s: [s.noise.angle_random_walk_deg_sqrt_h],
        "gyro bias, deg/h": lambda s: [s.noise.gyro_bias_deg_h],
        "velocity random walk": lambda s: [s.noise.velocity_random_walk_ug_sqrt_hz],
        "accelerometer bias": lambda s: [s.noise.accel_bias_ug],
        "scale of gyros": lambda s: [s.gyro_scale_ppm, s.accel_scale_ppm],
        "misalignment, ": lambda s: [s.gyro_misalignment_urad],
        "range, deg/s": lambda s: [s.gyro_range_deg_s, s.accel_range_g],
    }
    for name, values in rows.items():
        line = next(line for line in TEXT.splitlines() if line.startswith(f"| {name}"))
        cells = line.split("|")[2:5]
        for cell, sheet in zip(cells, GRADES.values(), strict=True):
            told = [float(x) for x in re.findall(r"[\d.]+", cell.split(",")[0])]
            assert told == values(sheet), (name, cell)
