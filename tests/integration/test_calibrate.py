"""Calibration of emulated arrays: the truth within the sigmas, and what a run cannot tell."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from gateway import replay
from gateway.calibrate import find, read
from gateway.config import load
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.nav.attitude import C_from_euler
from tests.gateway.emulated import START, demo_data, make
from tests.integration.rig import USBLNAV
from tests.shared_data import ROOT

TRUE = {"mounting_deg": [0.5, -0.4, 0.9], "elevation_deg": 0.2, "bearing_deg": -0.3}
SCALE = 0.004
PRIOR = {"mounting_deg": 0.6, "elevation_deg": 0.3, "bearing_deg": 0.3, "range_scale": 0.005}
SURVEY = {"type": "lawnmower", "course_deg": 20.0, "leg_m": 150.0, "spacing_m": 40.0}
CIRCLE = {"type": "circle", "radius_m": 60.0, "start_bearing_deg": 90.0}
LINE = {"type": "line", "course_deg": 90.0}
WAVES = {
    "roll": [{"amplitude": 3.0, "period_s": 6.1}],
    "pitch": [{"amplitude": 2.0, "period_s": 7.3, "phase_deg": 90}],
}


def voyage(folder: Path, track: dict[str, Any], duration_s: float, lat_deg: float) -> Path:
    """Emulate, capture and replay a run past the demo's beacon; give the replay's folder."""
    data = demo_data() | {"duration_s": duration_s, "start": START, "seed": 5}
    place = {"lat_deg": lat_deg, "lon_deg": 116.2, "height_m": 0.0, "speed_m_s": 3.0}
    data["trajectory"] = track | place | {"sway": WAVES}
    data["devices"]["imu0"]["rate_hz"] = 50
    data["devices"]["usbl0"] |= {
        "mounting_deg": [2.0, -3.0, 40.0],
        "errors": TRUE | {"range_scale": SCALE},
        "prior": PRIOR,
        "outliers": {},
    }
    scenario = twin.for_capture(make(data))
    capture, config = folder / "sea.pcap", folder / "config.yaml"
    emulate(scenario, pcap=capture, truth=None, say=lambda _line: None)
    config.write_text(yaml.safe_dump(twin.gateway_config(scenario)))
    replay.run([capture], load(config), out=folder / "out", rate_hz=1.0, smooth=True)
    return folder / "out"


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return voyage(tmp_path_factory.mktemp("survey"), SURVEY, 500.0, 39.7995)


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return voyage(tmp_path_factory.mktemp("line"), LINE, 60.0, 39.7975)


@dataclass(frozen=True)
class Done:
    code: int
    out: str
    err: str


def calibrate(*arguments: object) -> Done:
    done = subprocess.run(
        [*USBLNAV, "calibrate", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=60,
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return Done(done.returncode, done.stdout, done.stderr)


def truth() -> dict[str, float]:
    x, y, z = TRUE["mounting_deg"]
    return {
        "mounting_x_deg": x,
        "mounting_y_deg": y,
        "mounting_z_deg": z,
        "elevation_offset_deg": TRUE["elevation_deg"],
        "bearing_offset_deg": TRUE["bearing_deg"],
        "range_scale": SCALE,
    }


def test_the_true_constants_lie_within_three_sigma(survey: Path) -> None:
    findings = find(read(survey))
    for name, true in truth().items():
        found = findings.constants[name]
        assert abs(found.value - true) < 3.0 * found.sigma, name
        assert found.sigma <= found.prior * (1 + 1e-6), name
    for name in ("mounting_x_deg", "mounting_y_deg", "range_scale"):
        assert findings.constants[name].sigma < 0.3 * findings.constants[name].prior, name


def test_the_sound_speed_is_that_of_the_water(survey: Path) -> None:
    """An array told 1500 m/s that measures 0.4 % too long is in slower water."""
    speed = find(read(survey)).sound_speed_m_s
    assert abs(speed.value - 1500.0 / 1.004) < 3.0 * speed.sigma
    assert speed.sigma < 2.0


def test_a_survey_is_enough_and_says_what_turns_all_bearings(survey: Path) -> None:
    findings = find(read(survey))
    assert findings.enough, (findings.pairs, findings.unseen)
    C_bu = C_from_euler(*np.radians([2.0, -3.0, 40.0]))
    turn = findings.bearing_turn_deg
    true = C_bu[:, 2] @ np.array(TRUE["mounting_deg"]) - TRUE["bearing_deg"]
    assert abs(turn.value - true) < 3.0 * turn.sigma
    assert turn.sigma < 0.5 * findings.constants["mounting_z_deg"].sigma


def test_a_straight_line_says_it_cannot_tell(line: Path) -> None:
    findings = find(read(line))
    assert not findings.enough
    named = {one.name for one in findings.unseen} | {
        name for pair in findings.pairs for name in (pair.one, pair.other)
    }
    assert named & {"mounting_x_deg", "mounting_y_deg", "elevation_offset_deg"}
    done = calibrate(line, "--figures", "none")
    assert "NOT enough" in done.out
    for one in findings.unseen:
        assert f"  {one.name}: sigma still" in done.out
        assert one.advice in done.out
    for pair in findings.pairs:
        assert f"  {pair.one} and {pair.other} go together" in done.out


def angles(C_bu: np.ndarray, beacon_b: np.ndarray) -> np.ndarray:
    """Bearing and elevation in the axes of an array."""
    x, y, z = C_bu.T @ beacon_b
    return np.array([np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))])


def test_a_circle_cannot_part_mounting_from_elevation_offset(tmp_path: Path) -> None:
    """The beacon is always abeam: rolled by the mounting, or offset."""
    findings = find(read(voyage(tmp_path, CIRCLE, 300.0, 39.8)))
    (one,) = (u for u in findings.unseen if u.name == "elevation_offset_deg")
    assert one.partner is not None
    assert one.partner.startswith(("mounting", "range"))
    for name, true in truth().items():
        found = findings.constants[name]
        assert abs(found.value - true) < 3.0 * found.sigma, name


def test_the_mounting_of_the_snippet_is_the_true_one(survey: Path) -> None:
    """With its offset put into the mounting an array measures the same bearings."""
    findings = find(read(survey))
    theta = Rotation.from_rotvec(np.radians(TRUE["mounting_deg"])).as_matrix()
    true = theta @ C_from_euler(*np.radians([2.0, -3.0, 40.0]))
    turned = C_from_euler(*np.radians(findings.mounting_deg))
    offset = np.radians([TRUE["bearing_deg"], 0.0])
    limit = 4.0 * np.radians(findings.mounting_sigma_deg)
    for beacon in ([40.0, 30.0, 50.0], [-60.0, 20.0, 30.0], [10.0, -70.0, 40.0]):
        beacon_b = np.array(beacon)
        missing = angles(turned, beacon_b) - (angles(true, beacon_b) + offset)
        assert np.abs(missing).max() < limit


def test_the_snippet_makes_the_next_replay_start_where_this_one_ended(
    survey: Path, tmp_path: Path
) -> None:
    """Pasted into the configuration, what remains to be estimated is within the new priors."""
    calibrate(survey, "--figures", "none")
    snippet = yaml.safe_load((survey / "calibrate" / "config.yaml").read_text())
    whole = yaml.safe_load((survey.parent / "config.yaml").read_text())
    whole["devices"]["usbl0"] |= snippet["devices"]["usbl0"]
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(whole))
    captures = [survey.parent / "sea.pcap"]
    replay.run(captures, load(tmp_path / "config.yaml"), out=tmp_path / "out", rate_hz=1.0)
    again = find(read(tmp_path / "out"))
    for name, constant in again.constants.items():
        if name.startswith("mounting"):
            assert abs(constant.value) < 2.0 * constant.prior, name
            assert constant.prior < 0.2 * PRIOR["mounting_deg"]


def test_lever_arm_and_latency_are_found_where_they_have_a_prior(
    survey: Path, tmp_path: Path
) -> None:
    """Configured 0.3 m and 120 ms off."""
    whole = yaml.safe_load((survey.parent / "config.yaml").read_text())
    block = whole["devices"]["usbl0"]
    block["lever_arm_m"][0] -= 0.3
    block["clock"]["latency_ms"] -= 120.0
    block["prior"] |= {"lever_arm_m": 0.3, "latency_ms": 150.0}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(whole))
    captures = [survey.parent / "sea.pcap"]
    replay.run(captures, load(tmp_path / "config.yaml"), out=tmp_path / "out", rate_hz=1.0)
    findings = find(read(tmp_path / "out"))
    latency, lever = findings.constants["latency_ms"], findings.constants["lever_arm_x_m"]
    assert abs(latency.value - 120.0) < 3.0 * latency.sigma
    assert abs(lever.value - 0.3) < 3.0 * lever.sigma
    assert latency.sigma < 40.0
    calibrate(tmp_path / "out", "--figures", "none")
    snippet = yaml.safe_load((tmp_path / "out" / "calibrate" / "config.yaml").read_text())
    array = snippet["devices"]["usbl0"]
    assert array["clock"] == {"source": "arrival", "latency_ms": round(findings.latency_ms, 1)}
    assert array["lever_arm_m"] == [round(x, 3) for x in findings.lever_arm_m]
    assert array["prior"]["latency_ms"] >= latency.sigma


def test_residuals_shrink_to_the_noise(survey: Path) -> None:
    fits = find(read(survey)).fits
    assert set(fits) == {"elevation_deg", "bearing_deg", "range_m"}
    for name, fit in fits.items():
        assert fit.count > 200
        assert fit.after_rms < fit.before_rms, name
        assert abs(fit.after_mean) < 0.1 * fit.sigma, name
        assert 0.8 < fit.after_rms / fit.sigma < 1.15, name


def test_everything_is_written_and_json_says_it(survey: Path) -> None:
    done = calibrate(survey, "--json")
    report = json.loads(done.out)
    folder = survey / "calibrate"
    names = {path.name for path in folder.iterdir()}
    assert names >= {"config.yaml", "calibration.json", "residuals.png", "correlation.png"}
    assert report == json.loads((folder / "calibration.json").read_text())
    matrix = np.array(report["correlation"])
    assert matrix.shape == (len(report["names"]),) * 2
    np.testing.assert_allclose(matrix.diagonal(), 1.0)
    assert report["config"] == (folder / "config.yaml").read_text()
    assert (folder / "residuals.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_a_filtered_replay_can_be_calibrated_too(survey: Path, tmp_path: Path) -> None:
    config = load(survey.parent / "config.yaml")
    replay.run([survey.parent / "sea.pcap"], config, out=tmp_path, rate_hz=1.0)
    filtered, smoothed = find(read(tmp_path)), find(read(survey))
    for name, constant in smoothed.constants.items():
        other = filtered.constants[name]
        assert abs(other.value - constant.value) < 0.5 * constant.sigma, name
    assert calibrate(tmp_path, "--figures", "svg").code == 0
    assert (tmp_path / "calibrate" / "constants.svg").is_file()


def test_what_is_no_replay_is_one_line(survey: Path, tmp_path: Path) -> None:
    done = calibrate(tmp_path)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "give the folder that a replay wrote" in done.err
    inner = tmp_path / "additive"
    inner.mkdir()
    (inner / "summary.json").write_bytes((survey / "summary.json").read_bytes())
    assert f"give one of {inner}" in calibrate(tmp_path).err


def test_a_damaged_file_is_one_line(survey: Path, tmp_path: Path) -> None:
    for path in survey.iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "calibration.csv").write_text("t_s,name,value,sigma\n1,range_scale,x,1\n")
    done = calibrate(tmp_path)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "not what a replay writes" in done.err


def test_without_priors_there_is_nothing_to_calibrate(survey: Path, tmp_path: Path) -> None:
    whole = yaml.safe_load((survey.parent / "config.yaml").read_text())
    whole["devices"]["usbl0"]["prior"] = {}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(whole))
    captures = [survey.parent / "sea.pcap"]
    replay.run(captures, load(tmp_path / "config.yaml"), out=tmp_path / "out", rate_hz=1.0)
    done = calibrate(tmp_path / "out")
    assert done.code == 2
    assert "give devices.<usbl>.prior" in done.err
