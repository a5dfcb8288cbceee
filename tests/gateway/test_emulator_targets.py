"""Beacons that move: their replies by root finding, their truth, their faults in a scenario."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.optimize import brentq

from gateway.emulator import player, twin
from gateway.emulator.acoustics import measure
from gateway.emulator.instruments import emissions
from gateway.emulator.scenario import Scenario
from gateway.emulator.trajectory import Trajectory
from gateway.emulator.truth import TruthFile
from gateway.errors import ConfigError
from tests.gateway.emulated import START, demo_data, make, quiet_usbl, track

SOUND = 1500.0
LEVER = np.array([0.5, -0.2, 0.8])
NOISY = {"bearing_deg": 1.0, "elevation_deg": 1.0, "range_m": 1.0}
AWAY = {"lat_deg": -32.995, "lon_deg": -71.996, "height_m": -300.0, "speed_m_s": 4.0}


def rov(**changes: Any) -> dict[str, Any]:
    return {"role": "target", "name": "rov", "trajectory": track("line", **AWAY)} | changes


def scenario(around: dict[str, Any], **usbl: Any) -> Scenario:
    data = demo_data() | {"trajectory": track("circle"), "duration_s": 60.0, "beacons": around}
    block = quiet_usbl(lever_arm_m=LEVER.tolist(), **usbl)
    data["devices"] = {"imu0": data["devices"]["imu0"], "usbl0": block}
    return make(data)


@pytest.mark.parametrize("turnaround_ms", [0.0, 40.0])
def test_a_reply_comes_from_where_the_target_is_by_then(turnaround_ms: float) -> None:
    """Each way by root finding on the two motions; without it, it would be metres off."""
    sea = scenario({"2": rov(turnaround_ms=turnaround_ms)})
    ship, way = (Trajectory(path, 60.0) for path in (sea.trajectory, sea.mobile["2"].trajectory))
    found = measure(sea, "usbl0", sea.devices["usbl0"], ship)

    def array(t: float) -> np.ndarray:
        pose = ship.pose(np.array([t]))
        return pose.r_e[0] + pose.C_eb[0] @ LEVER

    def target(t: float) -> np.ndarray:
        return way.pose(np.array([t])).r_e[0]

    def late(t_from: float, t_to: float, away_m: float) -> float:
        return t_from + away_m / SOUND - t_to

    for k in range(0, len(found.t_tx), 5):
        t_tx, turn = found.t_tx[k], turnaround_ms / 1e3
        asked = array(t_tx)
        hit = brentq(
            lambda t, f=t_tx, a=asked: late(f, t, np.linalg.norm(target(t) - a)), t_tx, t_tx + 3.0
        )
        sent = target(hit + turn)
        t_rx = brentq(
            lambda t, f=hit + turn, s=sent: late(f, t, np.linalg.norm(array(t) - s)), hit, hit + 3.0
        )
        assert found.t_rx[k] == pytest.approx(t_rx, abs=1e-10)
        assert found.slant_range[k] == pytest.approx(0.5 * SOUND * (t_rx - t_tx - turn), abs=1e-6)
        x, y, z = ship.pose(np.array([t_rx])).C_eb[0].T @ (sent - array(t_rx))
        assert found.bearing[k] == pytest.approx(np.arctan2(y, x), abs=1e-9)
        assert found.elevation[k] == pytest.approx(np.arctan2(-z, np.hypot(x, y)), abs=1e-9)
        assert np.linalg.norm(sent - target(t_tx)) > 0.1


def test_one_that_is_still_answers_as_a_moored_one() -> None:
    place = {key: AWAY[key] for key in ("lat_deg", "lon_deg", "height_m")}
    still = track("line", **AWAY | {"speed_m_s": 0.0, "sway": {}})
    of = [scenario({"1": place}), scenario({"1": rov(trajectory=still)})]
    moored, moving = (
        measure(sea, "usbl0", sea.devices["usbl0"], Trajectory(sea.trajectory, 60.0)) for sea in of
    )
    np.testing.assert_allclose(moving.t_rx, moored.t_rx, atol=1e-10)
    np.testing.assert_allclose(moving.slant_range, moored.slant_range, atol=1e-6)
    np.testing.assert_allclose(moving.bearing, moored.bearing, atol=1e-8)


def test_a_target_that_nobody_asks_changes_no_byte() -> None:
    moored = {"1": {"lat_deg": -33.0, "lon_deg": -72.0, "height_m": -80.0}}
    said = []
    for around in (moored, moored | {"2": rov()}):
        sea = scenario(around, beacons=["1"], noise=NOISY)
        ship = Trajectory(sea.trajectory, 20.0)
        said.append([(e.t, e.data) for e in emissions(sea, ship, START, 1.0)])
    assert said[0] == said[1]
    assert len(said[0]) > 1000


def test_its_truth_lies_beside_that_of_the_ship(tmp_path: Path) -> None:
    sea = make(demo_data() | {"duration_s": 5.0, "beacons": {"2": rov(), "3": rov(name="sledge")}})
    player.emulate(sea, pcap=tmp_path / "sea.pcap", truth=tmp_path / "truth.csv")
    names = sorted(path.name for path in tmp_path.glob("*.csv"))
    assert names == ["truth-rov.csv", "truth-sledge.csv", "truth.csv"]
    g = Trajectory(sea.mobile["2"].trajectory, 5.0).geodetic(np.array([3.0]))
    row = TruthFile(tmp_path / "truth-rov.csv").at(START + 3.0)
    assert row is not None
    assert row.lat_deg == pytest.approx(np.rad2deg(g.lat[0]), abs=1e-9)
    assert row.height_m == pytest.approx(g.h[0], abs=1e-5)


@pytest.mark.parametrize(
    ("block", "fault"),
    [
        (rov(trajectory={"type": "line"}), "beacons.2.trajectory.lat_deg: missing"),
        (rov(trajectory=AWAY | {"type": "orbit"}), "beacons.2.trajectory.type: unknown type"),
        ({"role": "target", "name": "rov"}, "beacons.2.trajectory: missing"),
        ({"role": "target", "trajectory": track("line")}, "beacons.2.name: missing"),
        (rov(name="a/b"), "beacons.2.name: "),
        (rov(trajectory={"type": "waypoints"}), "beacons.2.trajectory.points: "),
        (
            rov(trajectory={"type": "waypoints", "file": "no.csv"}),
            "beacons.2.trajectory.file: ",
        ),
    ],
)
def test_a_fault_of_a_target_is_named_by_its_place(
    tmp_path: Path, block: dict[str, Any], fault: str
) -> None:
    data = demo_data()
    data["beacons"]["2"] = block
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as caught:
        twin.load(tmp_path / "s.yaml")
    assert any(line.startswith(fault) for line in caught.value.faults), caught.value.faults


def test_a_target_goes_by_a_file_of_waypoints(tmp_path: Path) -> None:
    lines = ["lat_deg, lon_deg, depth_m, speed_m_s", "39.8, 116.2, 60, 1", "39.81, 116.2, 60, 0"]
    (tmp_path / "way.csv").write_text("\n".join(lines))
    data = demo_data()
    data["beacons"]["2"] = rov(trajectory={"type": "waypoints", "file": "way.csv"})
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(data))
    way = Trajectory(twin.load(tmp_path / "s.yaml").mobile["2"].trajectory, 10.0)
    g = way.geodetic(np.array([0.0]))
    assert (np.rad2deg(g.lat[0]), g.h[0]) == pytest.approx((39.8, -60.0), abs=1e-6)


def test_what_moves_is_dragged_by_nobody(tmp_path: Path) -> None:
    data = demo_data()
    data["beacons"]["2"] = rov()
    data["faults"] = [{"fault": "beacon_moved", "beacon": "2", "at_s": 5.0}]
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as caught:
        twin.load(tmp_path / "s.yaml")
    assert 'faults[0].beacon: "2" moves by its own trajectory' in caught.value.faults
