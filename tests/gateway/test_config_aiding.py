"""Blocks of devices that aid: what must stand in them, and what they may not have together."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gateway.config import DepthDevice, DvlDevice, HeadingDevice, LblDevice, load
from gateway.fusion import initial
from gateway.fusion.state import DKD, LEVER
from gateway.nav.attitude import C_from_euler
from tests.gateway.configurations import GONE, edited, faults_of, written
from tests.shared_data import ROOT

UDP = {"type": "udp", "port": 7010}
DEPTH = {
    "kind": "depth",
    "codec": "paroscientific",
    "link": UDP,
    "options": {"unit": "psi", "latitude_deg": 39.8},
    "noise": {"depth_m": 0.05},
    "surface_height_m": -9.5,
    "lever_arm_m": [1.0, 0.5, 0.25],
}
DVL = {
    "kind": "dvl",
    "codec": "pd6",
    "link": UDP | {"port": 7011},
    "noise": {"velocity_m_s": [0.01, 0.01, 0.005]},
    "mounting_deg": [0, 0, 45],
    "lever_arm_m": [0, 0, 1],
    "scale": 0.99,
}
HEADING = {
    "kind": "heading",
    "codec": "nmea-heading",
    "link": UDP | {"port": 7012},
    "noise": {"heading_deg": 0.3},
    "mounting_deg": [0, 0, -2],
}
LBL = {
    "kind": "lbl",
    "codec": "micromodem",
    "link": UDP | {"port": 7013},
    "noise": {"range_m": 1.5},
    "lever_arm_m": [0, 1, 2],
    "beacons": ["1"],
    "prior": {"range_scale": 0.01},
}


def given(**devices: Any) -> list[tuple[str, Any]]:
    return [(f"devices.{name}", block) for name, block in devices.items()]


def test_every_kind_has_its_place_in_the_filter(tmp_path: Path) -> None:
    edits = given(depth0=DEPTH, dvl0=DVL, gyro0=HEADING, lbl0=LBL)
    config = load(written(tmp_path, edited(*edits)))
    kinds = {type(device) for device in config.devices.values()}
    assert {DepthDevice, DvlDevice, HeadingDevice, LblDevice} < kinds
    model = initial.model(config)
    assert set(model.mounts) == {"depth0", "dvl0", "gyro0"}
    np.testing.assert_array_equal(model.mounts["depth0"].lever_b, [1.0, 0.5, 0.25])
    np.testing.assert_allclose(model.mounts["dvl0"].C_bs, C_from_euler(0, 0, np.pi / 4))
    np.testing.assert_allclose(model.mounts["gyro0"].C_bs, C_from_euler(0, 0, np.radians(-2)))
    assert model.arrays["lbl0"].sigma[2] == 1.5
    np.testing.assert_array_equal(model.arrays["lbl0"].geometry.lever_b, [0, 1, 2])


def test_the_blocks_of_the_docs_are_sound(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "devices.md").read_text()
    seen: set[str] = set()
    for printed in re.findall(r"```yaml\n(.*?)```", text, re.DOTALL):
        blocks = yaml.safe_load(printed)
        edits = given(**blocks.get("devices", {}))
        if "beacons" in blocks:
            edits.append(("beacons", dict.fromkeys("ABC", blocks["beacons"]["A"])))
        seen |= set(load(written(tmp_path, edited(*edits))).devices)
    assert {"depth0", "dvl0", "gyro0", "lbl0", "usbl0"} <= seen


def test_one_scale_of_two_acoustic_devices_is_as_wide_as_the_wider(tmp_path: Path) -> None:
    narrow = ("devices.usbl0.prior", {"range_scale": 0.002})
    config = load(written(tmp_path, edited(narrow, *given(lbl0=LBL))))
    state = initial.initial_state(config)
    scale = np.flatnonzero(state.columns == DKD)[0]
    assert state.P[scale, scale] == pytest.approx(0.01**2)
    assert not np.isin(np.arange(25)[LEVER], state.columns).any()


@pytest.mark.parametrize(
    ("name", "device", "faults"),
    [
        (
            "depth0",
            {key: value for key, value in DEPTH.items() if key != "surface_height_m"},
            ["devices.depth0.surface_height_m: missing"],
        ),
        (
            "depth0",
            DEPTH | {"options": {"unit": "dbar"}},
            [
                "devices.depth0.options.unit: expected one of bar, hpa, in_hg, kpa, m_h2o, mm_hg,"
                ' mpa, psi, got "dbar"'
            ],
        ),
        (
            "depth0",
            DEPTH | {"codec": "nmea-heading", "options": {}},
            [
                "devices.depth0.codec: nmea-heading is of kind heading, the device of kind depth;"
                " one of: nmea-depth, paroscientific"
            ],
        ),
        (
            "dvl0",
            DVL | {"noise": {"velocity_m_s": 0.01}},
            ["devices.dvl0.noise.velocity_m_s: expected a list of 3 numbers, got 0.01"],
        ),
        (
            "dvl0",
            DVL | {"scale": 1.5},
            ["devices.dvl0.scale: expected a number from 0.9 to 1.1, got 1.5"],
        ),
        (
            "lbl0",
            LBL | {"beacons": ["1", "7"]},
            ['devices.lbl0.beacons[1]: no beacon is called "7"'],
        ),
        (
            "lbl0",
            LBL | {"prior": {"lever_arm_m": 0.1}},
            [
                "devices.lbl0.prior.lever_arm_m: estimated for one acoustic device only;"
                " there are usbl0 and lbl0"
            ],
        ),
    ],
)
def test_faults(tmp_path: Path, name: str, device: dict[str, Any], faults: list[str]) -> None:
    assert faults_of(written(tmp_path, edited((f"devices.{name}", device)))) == faults


def test_an_interrogator_needs_transponders(tmp_path: Path) -> None:
    alone = LBL | {"beacons": []}
    path = written(tmp_path, edited(("devices.usbl0", alone), ("beacons", GONE)))
    assert faults_of(path) == ["beacons: missing; devices.usbl0 needs at least one"]
