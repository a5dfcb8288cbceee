"""The replay command with the filter's options: loose coupling, weights, learnt noise."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from gateway.emulator import twin
from gateway.emulator.player import emulate
from tests.gateway.emulated import START, make
from tests.integration.rig import USBLNAV, brisk
from tests.integration.scores import errors
from tests.shared_data import ROOT


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A short capture with its truth beside it, and its configuration as plain data."""
    folder = tmp_path_factory.mktemp("coupling")
    scenario = twin.for_capture(make(brisk(folder) | {"duration_s": 60.0, "start": START}))
    emulate(
        scenario,
        pcap=folder / "short.pcap",
        truth=folder / "truth.csv",
        say=lambda _line: None,
    )
    return folder / "short.pcap", twin.gateway_config(scenario)


@pytest.mark.parametrize(
    ("options", "rows"),
    [
        ({"coupling": "tight"}, ["elevation_deg", "bearing_deg", "range_m"]),
        ({"coupling": "loose"}, ["north_m", "east_m", "down_m"]),
        (
            {"coupling": "loose", "loose_noise": "fixed", "loose_sigma_m": 2.0},
            ["north_m", "east_m", "down_m"],
        ),
        ({"robust": "huber"}, ["elevation_deg", "bearing_deg", "range_m"]),
        (
            {"robust": "student_t", "adaptive_noise": True},
            ["elevation_deg", "bearing_deg", "range_m"],
        ),
    ],
    ids=["tight", "loose", "fixed", "huber", "student_t"],
)
def test_every_choice_navigates(
    capture: tuple[Path, dict[str, Any]], tmp_path: Path, options: dict[str, Any], rows: list[str]
) -> None:
    pcap, data = capture
    config = tmp_path / "config.yaml"
    config.write_text(yaml.safe_dump(data | {"filter": options}))
    command = [*USBLNAV, "replay", pcap, "-c", config, "-o", tmp_path / "out"]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, timeout=120)
    table = (tmp_path / "out" / "innovations.csv").read_text().splitlines()
    assert [line.split(",")[3] for line in table[1:4]] == rows
    rms = errors(tmp_path / "out" / "nav.csv", pcap.parent / "truth.csv").rms(START + 25.0)
    assert rms["horizontal"] < 1.0
    assert rms["vertical"] < 0.6
    (beacon,) = json.loads((tmp_path / "out" / "summary.json").read_text())["beacons"].values()
    assert beacon["used"] > 10
    assert 0.01 < beacon["quality"] < 10.0
