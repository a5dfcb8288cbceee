"""Waypoints from a file, and ways that cannot be gone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gateway.emulator import twin
from gateway.emulator.scenario import Scenario
from gateway.emulator.trajectory import Trajectory
from gateway.errors import ConfigError
from tests.gateway.emulated import demo_data

DIVE = """\
lat_deg, lon_deg, depth_m, speed_m_s
39.8000, 116.2000, 0, 1.5
39.8010, 116.2000, 20, 2
39.8010, 116.2020, 20, 0
"""


def load(folder: Path, text: str | None, **track: Any) -> Scenario:
    if text is not None:
        (folder / "dive.csv").write_text(text, encoding="utf-8")
    block = {"type": "waypoints", "file": "dive.csv"} | track
    data = demo_data() | {"trajectory": block, "surface_height_m": 5.0, "duration_s": 400}
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(data))
    return twin.load(path)


def test_a_file_beside_the_scenario_is_followed(tmp_path: Path) -> None:
    scenario = load(tmp_path, DIVE)
    g = Trajectory(scenario.trajectory, 400.0).geodetic(np.array([0.0, 350.0]))
    np.testing.assert_allclose(np.rad2deg(g.lat), [39.8, 39.801], atol=1e-9)
    np.testing.assert_allclose(g.h, [5.0, -15.0], atol=2e-3)
    assert g.v_eb_n[0, 0] == pytest.approx(1.5)
    assert np.rad2deg(g.lon[1]) == pytest.approx(116.202, abs=2e-4)
    assert np.linalg.norm(g.v_eb_n[1]) == 0.0


def test_heights_need_no_surface(tmp_path: Path) -> None:
    scenario = load(tmp_path, DIVE.replace("depth_m", "height_m"))
    g = Trajectory(scenario.trajectory, 400.0).geodetic(np.array([350.0]))
    assert g.h[0] == pytest.approx(20.0, abs=2e-3)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (None, "dive.csv: no such file or directory"),
        ("", "dive.csv: line 1: expected the columns lat_deg"),
        (DIVE.replace("speed_m_s", "speed"), "dive.csv: line 1: expected the columns"),
        (DIVE.replace("39.8010", "98.8"), "dive.csv: line 3.lat_deg: expected a number from -90"),
        (
            DIVE.replace("20, 2", "deep, 2"),
            'dive.csv: line 3.depth_m: expected a number, got "deep"',
        ),
        (DIVE + "39.8,116.2\n", "dive.csv: line 5.depth_m: expected a number, got nothing"),
        (DIVE.replace("20, 2\n", "20, 0\n"), "points: the vehicle would stop before the last"),
        (DIVE.replace("39.8010, 116.2000", "39.8, 116.2"), "points: number 2 is where the one"),
        (DIVE[:60], "points: expected two or more"),
    ],
)
def test_faults_name_file_and_line(tmp_path: Path, text: str | None, fault: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    where = f"file: {tmp_path}/" if fault.startswith("dive") else ""
    wanted = f"trajectory.{where}{fault}"
    assert any(line.startswith(wanted) for line in caught.value.faults), caught.value.faults


def test_a_file_and_points_are_one_too_many(tmp_path: Path) -> None:
    point = {"lat_deg": 39.8, "lon_deg": 116.2, "speed_m_s": 1.0}
    with pytest.raises(ConfigError, match="points: there is a file as well"):
        load(tmp_path, DIVE, points=[point])


def test_back_on_its_own_track_is_too_sharp(tmp_path: Path) -> None:
    back = DIVE.replace("39.8010, 116.2020", "39.8001, 116.2000")
    with pytest.raises(
        ConfigError, match="points: the turn at number 2 is of 180 deg; at most 150"
    ):
        load(tmp_path, back)


@pytest.mark.parametrize(
    ("track", "fault"),
    [
        ({"distance_m": 50.0}, "distance_m: less than it takes to reach 3 m/s and to stop"),
        (
            {"distance_m": 150.0, "cruise_height_m": -9.0},
            "dive_m: expected less than half of distance_m",
        ),
        ({"distance_m": 150.0, "speed_m_s": 0}, "speed_m_s: expected a number > 0"),
    ],
)
def test_a_transit_must_fit(tmp_path: Path, track: dict[str, Any], fault: str) -> None:
    place = {"lat_deg": 39.8, "lon_deg": 116.2, "speed_m_s": 3.0}
    with pytest.raises(ConfigError) as caught:
        data = demo_data() | {"trajectory": {"type": "transit"} | place | track}
        path = tmp_path / "scenario.yaml"
        path.write_text(yaml.safe_dump(data))
        twin.load(path)
    assert caught.value.faults == [f"trajectory.{fault}"]
