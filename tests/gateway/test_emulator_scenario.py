"""Scenario files, the configuration that matches them, and the truth file."""

import io

import numpy as np
import pytest

from gateway.config.blocks import Config
from gateway.emulator import twin
from gateway.emulator.trajectory import Trajectory
from gateway.emulator.truth import TruthFile, TruthWriter
from gateway.errors import ConfigError
from gateway.nav import earth
from gateway.schema import build
from tests.gateway.emulated import START, demo_data, make


def test_what_is_read_while_it_grows_is_the_trajectory(tmp_path):
    scenario = make(demo_data())
    trajectory = Trajectory(scenario.trajectory, 100.0)
    path = tmp_path / "truth.csv"
    reader = TruthFile(path)
    assert reader.at(START) is None
    with path.open("w") as file:
        writer = TruthWriter(file, trajectory, START)
        for t in (0.0, 3.33, 47.77):
            writer.write_until(t)
            row = reader.at(START + t)
            g = trajectory.geodetic(np.array([t]))
            assert row.lat_deg == pytest.approx(np.rad2deg(g.lat[0]), abs=1e-7)
            assert row.height_m == pytest.approx(g.h[0], abs=1e-3)
            assert row.vn_m_s == pytest.approx(g.v_eb_n[0, 0], abs=1e-3)
            difference = row.heading_deg - np.rad2deg(g.heading[0])
            assert abs((difference + 180) % 360 - 180) < 1e-2
        assert reader.at(START + 60.0) is None


def test_heading_is_interpolated_across_north(tmp_path):
    data = demo_data()
    data["trajectory"] |= {"sway": {}, "start_bearing_deg": 90.05}
    trajectory = Trajectory(make(data).trajectory, 10.0)
    out = io.StringIO()
    TruthWriter(out, trajectory, 0.0).write_until(2.0)
    (tmp_path / "t.csv").write_text(out.getvalue())
    reader = TruthFile(tmp_path / "t.csv")
    for t in np.linspace(0.0, 1.0, 41):
        exact = np.rad2deg(trajectory.geodetic(np.array([t])).heading[0])
        assert abs((reader.at(t).heading_deg - exact + 180) % 360 - 180) < 1e-3


def write(tmp_path, text):
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    return path


def test_the_packaged_scenario_is_sound_and_its_twin_too():
    scenario = twin.load(twin.DEMO)
    faults: list[str] = []
    config = build(Config, twin.gateway_config(scenario), faults)
    assert not faults
    assert config is not None
    assert config.devices["usbl0"].link.port == "/tmp/usblnav-usbl0"


def test_first_state_is_the_truth_with_errors_of_its_sigma():
    offsets = []
    for seed in range(200):
        scenario = make(demo_data() | {"seed": seed})
        initial = twin.gateway_config(scenario)["initial"]
        g = Trajectory(scenario.trajectory, 1.0).geodetic(np.zeros(1))
        lat, lon = np.deg2rad([initial["lat_deg"], initial["lon_deg"]])
        r_true = earth.lla_to_ecef(g.lat[0], g.lon[0], g.h[0])
        d = earth.lla_to_ecef(lat, lon, initial["height_m"]) - r_true
        offsets.append(earth.C_en(g.lat[0], g.lon[0]).T @ d)
    assert np.std(offsets, axis=0) == pytest.approx([5.0, 5.0, 1.0], rel=0.15)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("seed: 8", "sead: 8", "sead: unknown key; did you mean seed?"),
        ("type: circle", "type: figure8", "trajectory.type: unknown type"),
        ("codec: kvh1750", "codec: kvh1751", "devices.imu0.codec: no codec is called"),
        (
            "codec: tracklink-lxt",
            "codec: kvh1750",
            "devices.usbl0.codec: kvh1750 is of kind imu",
        ),
        ("codec: tracklink-lxt", "codec: tracklink-gll", "devices.usbl0.codec: beacon 1:"),
        ("accel: g}", "accel: furlong}", "devices.imu0.options.accel: expected one of"),
        ('"1": {', '"north-east": {', "devices.usbl0.codec: beacon north-east:"),
        ("period_s: 2.0", "period_s: 0", "devices.usbl0.period_s: expected a number > 0"),
    ],
)
def test_faults_are_named_by_their_place(tmp_path, old, new, fault):
    text = twin.DEMO.read_text()
    assert old in text
    with pytest.raises(ConfigError) as caught:
        twin.load(write(tmp_path, text.replace(old, new)))
    assert any(line.startswith(fault) for line in caught.value.faults), caught.value.faults
