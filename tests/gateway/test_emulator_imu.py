"""Emulated inertial units of every format, through the gateway's own intake, against the truth."""

from typing import Any

import numpy as np
import pytest
import yaml

from drivers import registry
from drivers.records import ImuRecord
from gateway.config import Config, wire_format
from gateway.emulator import twin
from gateway.emulator.instruments import stream
from gateway.emulator.scenario import GRADES, Scenario
from gateway.emulator.sensors import ImuSensor, increments, sensing_matrices
from gateway.emulator.trajectory import Trajectory
from gateway.errors import ConfigError
from gateway.ingest import DeviceCounts, intakes
from gateway.schema import build
from tests.gateway.emulated import START, demo_data, make, track

T0_NS = 5_000_000_000
SILENCE = {
    "angle_random_walk_deg_sqrt_h": 1e-12,
    "gyro_bias_deg_h": 0.0,
    "velocity_random_walk_ug_sqrt_hz": 1e-12,
    "accel_bias_ug": 0.0,
}
BY_TIME = {"source": "device", "latency_ms": 0.5}
MOUNTING = [2.0, -3.0, 90.0]


def scenario_of(duration_s: float = 4.0, **imu: Any) -> Scenario:
    """A swaying circle with one perfect inertial unit, its block changed."""
    block = demo_data()["devices"]["imu0"] | {"noise": SILENCE, "options": {}, "clock": BY_TIME}
    data = demo_data() | {"duration_s": duration_s, "trajectory": track("circle"), "beacons": {}}
    return make(data | {"devices": {"imu0": block | imu}})


def heard(scenario: Scenario, start: float = START) -> tuple[np.ndarray, np.ndarray, DeviceCounts]:
    """Times (s after the start), rows of the strapdown and counts, frame by frame."""
    faults: list[str] = []
    config = build(Config, twin.gateway_config(scenario), faults)
    assert config is not None, faults
    intake = intakes(config)["imu0"]
    trajectory = Trajectory(scenario.trajectory, scenario.duration_s)
    model = scenario.devices["imu0"]
    for emission in stream(scenario, "imu0", model, trajectory, start, 1.0):
        intake.feed(emission.data, T0_NS + round(emission.t * 1e9))
    intake.close()
    blocks = intake.flush()
    t_ns = np.concatenate([np.frombuffer(b.t_ns, np.int64) for b in blocks])
    rows = np.concatenate([np.frombuffer(b.rows).reshape(-1, 8) for b in blocks])
    return (t_ns - T0_NS) * 1e-9, rows, intake.counts


def truth_of(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    model = scenario.devices["imu0"]
    n = int(scenario.duration_s * model.rate_hz)
    t_end = (np.arange(n) + 1) / model.rate_hz
    trajectory = Trajectory(scenario.trajectory, scenario.duration_s)
    return t_end, increments(trajectory, t_end, 1.0 / model.rate_hz)


UNITS: dict[str, dict[str, Any]] = {
    "kvh a": {"codec": "kvh1750", "options": {"gyro": "delta_angle_rad", "accel": "g"}},
    "kvh b across its wrap": {
        "codec": "kvh1750",
        "options": {"format": "b", "gyro": "rate_deg_s", "accel": "delta_v_ft_s"},
        "uptime_s": 4293.0,
    },
    "kvh c": {"codec": "kvh1750", "options": {"format": "c"}, "rate_hz": 1000},
    "stim300": {"codec": "stim300", "options": {"with_temperature": True}, "age_ms": 1.5},
    "stim300 increments": {
        "codec": "stim300",
        "options": {"gyro": "increment", "accel": "increment", "crlf": True},
        "rate_hz": 250,
    },
    "novatel": {"codec": "novatel-span"},
    "novatel ascii": {"codec": "novatel-span", "options": {"imu": "kvh1750", "ascii": True}},
    "novatel long": {"codec": "novatel-span", "options": {"imu": "imar_fsas", "log": "rawimu"}},
    "vectornav": {"codec": "vectornav", "uptime_s": 77.0},
    "vectornav rates": {"codec": "vectornav", "options": {"prefer": "rates"}},
    "xsens across its wrap": {"codec": "xsens-mtdata2", "uptime_s": 429495.0},
    "xsens rates": {"codec": "xsens-mtdata2", "options": {"prefer": "rates"}},
    "mip": {"codec": "mip"},
    "mip rates": {"codec": "mip", "options": {"prefer": "rates"}},
    "sbg across its wrap": {"codec": "sbg-ecom", "uptime_s": 4293.0},
    "anpp": {"codec": "anpp", "options": {"with_time": True}},
    "anpp running": {"codec": "anpp", "options": {"with_time": True, "time": "running"}},
    "stdbin v3": {"codec": "stdbin", "options": {"version": 3}},
    "stdbin v5": {"codec": "stdbin", "temperature_c": 31.0},
}
_NAMED = {unit["codec"] for unit in UNITS.values()}
UNITS |= {
    codec.name: {"codec": codec.name}
    for codec in registry.all_codecs()
    if codec.kind == "imu" and codec.name not in _NAMED
}


@pytest.mark.parametrize("unit", UNITS)
def test_every_format_says_the_true_motion(unit: str) -> None:
    """Times to a tick of the device's clock, increments to the resolution of its format."""
    scenario = scenario_of(mounting_deg=MOUNTING, **UNITS[unit])
    t, rows, counts = heard(scenario)
    t_true, exact = truth_of(scenario)
    assert counts.rejected_bytes == counts.gaps == 0
    np.testing.assert_allclose(t, t_true, atol=1.1e-4)
    dt = t_true[0]
    np.testing.assert_allclose(rows[:, 1:4] / dt, exact[:, :3] / dt, atol=4e-6, rtol=3e-5)
    np.testing.assert_allclose(rows[:, 4:7] / dt, exact[:, 3:] / dt, atol=2e-4, rtol=3e-5)


MIDNIGHT, END_OF_WEEK = 20_000 * 86_400.0, 315_964_800.0 + 2300 * 604_800.0 - 18.0
"""UTC, and GPS time, which is 18 s ahead of it."""


@pytest.mark.parametrize(
    ("unit", "turns_over"), [("stdbin v5", MIDNIGHT), ("novatel", END_OF_WEEK), ("anpp", MIDNIGHT)]
)
def test_time_of_day_and_week_begin_anew(unit: str, turns_over: float) -> None:
    scenario = scenario_of(**UNITS[unit])
    t, _, counts = heard(scenario, turns_over - 2.0)
    assert counts.gaps == 0
    np.testing.assert_allclose(t, truth_of(scenario)[0], atol=1.1e-4)
    codec, options = wire_format(build(Config, twin.gateway_config(scenario), []).devices["imu0"])
    model, trajectory = scenario.devices["imu0"], Trajectory(scenario.trajectory, 4.0)
    decoder = codec.decoder(options)
    said = stream(scenario, "imu0", model, trajectory, turns_over - 2.0, 1.0)
    told = [r.t_device_s for e in said for r in decoder.feed(e.data, 0) if isinstance(r, ImuRecord)]
    before = {"stdbin": 86_398.0, "novatel-span": 604_798.0, "anpp": MIDNIGHT - 2.0}
    assert told[0] == pytest.approx(before[model.codec] + 0.005, abs=1e-4)
    assert (told[-1] < told[0]) == (unit != "anpp")


@pytest.mark.parametrize(
    "unit", ["kvh a", "stim300", "novatel", "xsens rates", "sbg across its wrap"]
)
def test_the_counter_places_jittered_samples(unit: str) -> None:
    scenario = scenario_of(12.0, **UNITS[unit] | {"clock": BY_TIME, "jitter_ms": 1.0})
    t, _, counts = heard(scenario)
    late = t[1000:] - truth_of(scenario)[0][1000:]
    assert counts.gaps == 0
    assert np.abs(late).max() < 1e-3
    assert late.std() < 0.2e-3


def test_a_grade_is_what_the_gateway_is_told() -> None:
    for name, sheet in GRADES.items():
        scenario = scenario_of(grade=name, noise=None)
        told = twin.gateway_config(scenario)["devices"]["imu0"]["noise"]
        assert told["gyro_bias_deg_h"] == sheet.noise.gyro_bias_deg_h
        assert told["angle_random_walk_deg_sqrt_h"] == sheet.noise.angle_random_walk_deg_sqrt_h
        matrices = sensing_matrices(scenario.devices["imu0"], 1, "imu0") - np.eye(3)
        sigma = 1e-6 * np.array([sheet.gyro_scale_ppm, sheet.accel_scale_ppm])
        across = 1e-6 * np.array([sheet.gyro_misalignment_urad, sheet.accel_misalignment_urad])
        diagonal = np.abs(np.diagonal(matrices, axis1=1, axis2=2))
        off = np.abs(matrices[:, ~np.eye(3, dtype=bool)])
        assert np.all(diagonal < 4.0 * sigma[:, None]) and diagonal.min() > 0.0
        assert np.all(off < 4.0 * across[:, None]) and off.min() > 0.0


def test_scale_and_misalignment_are_of_the_axes_they_name() -> None:
    errors = {
        "gyro_scale_ppm": [100.0, 200.0, 300.0],
        "accel_scale_ppm": [-100.0, 0.0, 0.0],
        "gyro_misalignment_urad": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        "accel_misalignment_urad": [0.0, 50.0, 0.0, 0.0, 0.0, 0.0],
    }
    sensor = ImuSensor(scenario_of(errors=errors).devices["imu0"], 1, "imu0")
    sensed, within = sensor.sense(np.array([[1.0, 0, 0, 1, 0, 0], [0, 1, 0, 0, 0, 1.0]]))
    assert within.all()
    np.testing.assert_allclose(
        sensed,
        [[1 + 1e-4, 3e-6, 5e-6, 1 - 1e-4, 0, 0], [1e-6, 1 + 2e-4, 6e-6, 5e-5, 0, 1]],
        atol=1e-12,
    )


def test_quanta_lose_nothing_between_samples() -> None:
    errors = {"angle_quantum_urad": 20.0, "velocity_quantum_um_s": 500.0}
    scenario = scenario_of(errors=errors)
    sensor = ImuSensor(scenario.devices["imu0"], 1, "imu0")
    exact = truth_of(scenario)[1]
    sensed = np.vstack([sensor.sense(part)[0] for part in np.array_split(exact, 7)])
    quanta = np.repeat([20e-6, 500e-6], 3)
    np.testing.assert_allclose(sensed / quanta, np.rint(sensed / quanta), atol=1e-6)
    lost = np.cumsum(exact, axis=0) - np.cumsum(sensed, axis=0)
    assert np.all(np.abs(lost) <= 0.5001 * quanta)


def test_beyond_its_range_a_unit_says_that_it_cannot_tell() -> None:
    """A circle of 71.4 m at 3 m/s turns at 2.4 deg/s; sway adds more."""
    scenario = scenario_of(codec="kvh1750", errors={"gyro_range_deg_s": 4.0})
    _, _, counts = heard(scenario)
    _, exact = truth_of(scenario)
    beyond = np.any(np.abs(np.rad2deg(exact[:, :3])) > 4.0 / 200.0, axis=1)
    assert 0 < beyond.sum() < len(beyond)
    assert +counts.ignored == {"invalid": beyond.sum()}


def test_a_unit_warms_up() -> None:
    warming = {"by_c": 10.0, "time_s": 2.0}
    scenario = scenario_of(codec="sbg-ecom", temperature_c=5.0, warming=warming)
    model, trajectory = scenario.devices["imu0"], Trajectory(scenario.trajectory, 4.0)
    frames = [e.data for e in stream(scenario, "imu0", model, trajectory, START, 1.0)]
    told = [int.from_bytes(f[36:38], "little", signed=True) / 256 for f in frames]
    assert told[0] == pytest.approx(5.0, abs=0.05)
    assert told[399] == pytest.approx(5.0 + 10.0 * (1.0 - np.exp(-1.0)), abs=0.02)


def test_the_block_length_does_not_change_a_byte() -> None:
    scenario = scenario_of(codec="mip", grade="mems", noise=None, jitter_ms=1.0)
    model, trajectory = scenario.devices["imu0"], Trajectory(scenario.trajectory, 4.0)
    one, other = (
        list(stream(scenario, "imu0", model, trajectory, START, block_s)) for block_s in (0.1, 5.0)
    )
    assert one == other


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"noise": None}, "devices.imu0.noise: missing; or name a grade"),
        (
            {"grade": "naval"},
            "devices.imu0.grade: expected one of mems, navigation_fog, tactical_fog",
        ),
        ({"age_ms": 2.0}, "devices.imu0.age_ms: kvh1750 does not say how old a sample is"),
        (
            {"codec": "stim300", "options": {"gyro": "integrated"}},
            "devices.imu0.options: stim300 writes no integrated units",
        ),
        (
            {"codec": "stdbin", "options": {"version": 2}},
            "devices.imu0.options: version 2 has no extended blocks",
        ),
        ({"errors": {"gyro_range_deg_s": 0}}, "devices.imu0.errors.gyro_range_deg_s: expected"),
    ],
)
def test_faults_name_the_key(tmp_path, changes: dict[str, Any], fault: str) -> None:
    data = demo_data()
    data["devices"]["imu0"] |= changes
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as caught:
        twin.load(path)
    assert any(line.startswith(fault) for line in caught.value.faults), caught.value.faults
