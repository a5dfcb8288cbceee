"""Targets in a configuration: what is refused and in which words."""

from typing import Any

import pytest

from gateway.config import Config
from gateway.config.checks import cross_faults
from gateway.schema import build
from tests.gateway.configurations import GOOD

ROV = {"role": "target", "name": "rov"}
OUT = {"type": "nmea", "link": {"type": "tcp", "port": 10110}}
LBL = {
    "kind": "lbl",
    "codec": "micromodem",
    "link": {"type": "serial", "port": "/dev/ttyUSB2"},
    "noise": {"range_m": 1.0},
    "beacons": ["1", "2"],
}


def faults(beacons: dict[str, Any], **blocks: Any) -> list[str]:
    """All faults of the good file with further beacons, outputs or devices."""
    found: list[str] = []
    devices = GOOD["devices"] | blocks.pop("devices", {})
    data = GOOD | blocks | {"devices": devices, "beacons": GOOD["beacons"] | beacons}
    config = build(Config, data, found)
    return found + (list(cross_faults(config)) if config is not None else [])


def test_a_target_and_who_speaks_of_it_are_sound() -> None:
    outputs = [OUT | {"target": "rov", "sentences": ["GLL", "RMC"]}]
    assert faults({"2": ROV}, outputs=outputs) == []


@pytest.mark.parametrize(
    ("beacons", "blocks", "fault"),
    [
        ({"2": {"role": "target"}}, {}, "beacons.2.name: missing"),
        ({"2": ROV | {"lat_deg": 39.8}}, {}, "beacons.2.lat_deg: unknown key"),
        ({"2": ROV | {"max_age_s": 0}}, {}, "beacons.2.max_age_s: expected a number > 0, got 0"),
        ({"2": ROV, "3": ROV}, {}, "beacons.3.name: beacons.2 has this name"),
        (
            {"2": ROV},
            {"outputs": [OUT | {"target": "rovv"}]},
            "outputs[0].target: no target is called rovv; did you mean rov?",
        ),
        (
            {"2": ROV},
            {"outputs": [OUT | {"target": "rov", "sentences": ["RMC", "HDT"]}]},
            "outputs[0].sentences: HDT cannot be said of a target",
        ),
        (
            {"2": ROV},
            {"devices": {"lbl0": LBL}},
            'devices.lbl0.beacons[1]: "2" is a target; ranges need a place',
        ),
    ],
)
def test_a_fault_is_named_by_its_place(
    beacons: dict[str, Any], blocks: dict[str, Any], fault: str
) -> None:
    found = faults(beacons, **blocks)
    assert [line for line in found if line.startswith(fault)], found
