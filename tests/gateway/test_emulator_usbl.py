"""What an emulated array says, when, by which clock and attitude, and what it cannot say."""

from typing import Any

import numpy as np
import pytest
from msgspec import UNSET

from drivers.records import UsblRecord
from gateway.emulator import acoustics, twin
from gateway.emulator.acoustics import measure, sentences
from gateway.emulator.acoustics.sentences import records
from gateway.emulator.scenario import Scenario
from gateway.emulator.trajectory import Trajectory
from gateway.errors import ConfigError
from gateway.nav import earth
from tests.gateway.emulated import demo_data, make, quiet_usbl, track

MIDNIGHT = 1_780_012_800.0
BEACONS = {
    "1": {"lat_deg": -33.0006, "lon_deg": -71.9994, "height_m": -140.0},
    "2": {"lat_deg": -33.0004, "lon_deg": -72.0009, "height_m": -110.0, "turnaround_ms": 50.0},
}
ELEMENTS = [[0.1, 0, 0], [0, 0.1, 0], [-0.1, 0, 0], [0, -0.1, 0]]
CIRCLE = {"trajectory": track("circle"), "duration_s": 60.0, "beacons": BEACONS, "seed": 5}


def scenario_of(world: dict[str, Any] = CIRCLE, **device: Any) -> Scenario:
    data = demo_data() | world
    common = {"codec": "psimssb", "options": {"levelled": False}, "period_s": 1.0}
    data["devices"] = {"imu0": data["devices"]["imu0"], "a0": quiet_usbl(**(common | device))}
    return make(data)


def said(scenario: Scenario, start: float = MIDNIGHT) -> list[tuple[float, UsblRecord]]:
    model = scenario.devices["a0"]
    assert not list(acoustics.faults(scenario, "a0", model))
    truth = Trajectory(scenario.trajectory, scenario.duration_s)
    return list(records(scenario, "a0", model, truth, start))


def fixes(scenario: Scenario) -> acoustics.Fixes:
    truth = Trajectory(scenario.trajectory, scenario.duration_s)
    return measure(scenario, "a0", scenario.devices["a0"], truth)


@pytest.mark.parametrize(
    ("codec", "code"), [("psimssb", "NRy"), ("pazm3", "timeout"), ("seatrac", "no_reply")]
)
def test_a_missing_reply_is_named_when_the_time_is_over(codec: str, code: str) -> None:
    common = {"codec": codec, "options": {}, "missed_probability": 0.4, "timeout_s": 2.5}
    if codec == "psimssb":
        common |= {"options": {"levelled": False}}
    silent, telling = said(scenario_of(**common)), said(scenario_of(**common, no_reply=code))
    named = [(t, record) for t, record in telling if not record.valid]
    assert [each for each in telling if each[1].valid] == silent
    assert len(telling) == pytest.approx(60, abs=3)
    assert 15 < len(named) < 35
    for t, record in named:
        assert record.error_code == code
        assert (t - 0.5 - 2.5) % 1.0 == pytest.approx(0.0, abs=1e-9)  # pings are at whole seconds


def test_who_is_not_waited_for_is_not_heard() -> None:
    common = {"codec": "seatrac", "options": {}, "no_reply": "no_reply"}
    told = said(scenario_of(**common, timeout_s=0.01))
    assert len(told) == pytest.approx(60, abs=3)
    assert not any(record.valid for _, record in told)


def test_where_there_is_no_fix_rates_go_on() -> None:
    options = {"velocity_positive": "opening"}
    device = {"codec": "evologics", "options": options, "age_ms": 300.0}
    told = said(scenario_of(**device, says=["rate", "fix"], no_fix_s=[[20, 30], [40, 41]]))
    rates = [t - 0.5 for t, record in told if record.range_rate_m_s is not None]
    seen = [t - 0.8 for t, record in told if record.bearing_deg is not None]
    assert len(rates) == 60
    left_out = [t for t in rates[:-1] if np.abs(np.array(seen) - t).min() > 0.1]
    assert all(20 <= t < 30 or 40 <= t < 41 for t in left_out)
    assert len(left_out) == pytest.approx(11, abs=2)


def test_an_age_is_told_and_comes_on_top_of_the_latency() -> None:
    device = {"codec": "evologics", "options": {}, "says": ["fix", "angles"]}
    now, later = said(scenario_of(**device)), said(scenario_of(**device, age_ms=300.0))
    assert all(record.age_s is UNSET for _, record in now)
    for (t, a), (t_later, b) in zip(now[: len(later)], later, strict=True):
        assert t_later - t == pytest.approx(0.3)
        assert (b.age_s, b.t_device_s) == (0.3, a.t_device_s)


def test_its_clock_gains_is_off_and_turns_over() -> None:
    clock = {"since": "start", "offset_s": 95.0, "drift_ppm": 1000.0, "wraps_s": 100.0}
    scenario = scenario_of(codec="evologics", options={}, time=clock)
    t_rx = fixes(scenario).t_rx
    shown = [record.t_device_s for _, record in said(scenario)]
    assert shown == pytest.approx((95.0 + 1.001 * t_rx[: len(shown)]) % 100.0)
    assert min(shown) < 1.0
    drift = {"fault": "clock_drift", "device": "a0", "at_s": 20.0, "for_s": 30.0, "ppm": 500.0}
    step = {"fault": "clock_step", "device": "a0", "at_s": 40.0, "step_s": 7.0}
    faulty = scenario_of(CIRCLE | {"faults": [drift, step]}, codec="evologics", options={})
    told = np.array([record.t_device_s for _, record in said(faulty)]) - MIDNIGHT
    t_rx = t_rx[: len(told)]
    gained = 5e-4 * np.clip(t_rx - 20.0, 0.0, 30.0) + np.where(t_rx >= 40.0, 7.0, 0.0)
    assert told - t_rx == pytest.approx(gained, abs=1e-6)


def test_lever_arm_and_latency_may_not_be_as_stated() -> None:
    errors = {"lever_arm_m": [0.0, 0.0, 1.5], "latency_ms": 40.0}
    exact, wrong = scenario_of(), scenario_of(errors=errors)
    moved = scenario_of(lever_arm_m=[0.5, 0.0, 0.8 + 1.5])
    assert fixes(wrong).slant_range == pytest.approx(fixes(moved).slant_range, abs=1e-9)
    late = np.array([a for a, _ in said(wrong)]) - fixes(wrong).t_rx[: len(said(wrong))]
    assert late == pytest.approx(0.54)
    assert twin.gateway_config(wrong)["devices"] == twin.gateway_config(exact)["devices"]


def test_its_own_attitude_turns_what_it_levels_or_turns_north() -> None:
    def bearings(axes: str, **errors: Any) -> np.ndarray:
        scenario = scenario_of(codec="gaps", options={}, axes=axes, errors=errors)
        return np.array([record.bearing_deg for _, record in said(scenario)])

    off = bearings("north", attitude_deg=[0, 0, 2.0]) - bearings("north")
    assert (off + 180.0) % 360.0 - 180.0 == pytest.approx(2.0)
    off = bearings("level", attitude_deg=[0, 0, 2.0]) - bearings("level")
    assert (off + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)

    noise = {"bearing_deg": 1e-12, "elevation_deg": 1e-12, "range_m": 1e-12, "tilt_deg": 0.5}
    tilted = scenario_of(codec="gaps", options={}, axes="north", noise=noise)
    level = scenario_of(codec="gaps", options={}, axes="north")
    pairs = zip(said(tilted), said(level), strict=True)
    turned = [np.cross(b.xyz_m, a.xyz_m) / np.dot(a.xyz_m, a.xyz_m) for (_, a), (_, b) in pairs]
    about = np.rad2deg(np.std(turned, axis=0))
    assert about[:2] == pytest.approx([0.5, 0.5], rel=0.35)


def test_its_own_place_moves_what_it_places() -> None:
    """But for the decimetre by which the array moves while the sound is under way."""
    scenario = scenario_of(
        codec="psonlld", options={}, axes="earth", place={"offset_m": [10.0, 0.0, 2.0]}
    )
    for _, record in said(scenario):
        beacon = scenario.beacons[record.beacon]
        assert (record.lat_deg - beacon.lat_deg) * 110_900.0 == pytest.approx(10.0, abs=0.2)
        assert record.depth_m == pytest.approx(-beacon.height_m + 2.0, abs=0.2)


@pytest.mark.parametrize(
    ("device", "fault"),
    [
        ({"options": {}}, "axes: psimssb with these options says level"),
        ({"axes": "north", "codec": "pazm3", "options": {}}, "axes: pazm3 with these"),
        ({"age_ms": 100.0}, "age_ms: psimssb tells no age"),
        ({"no_reply": "lost"}, "no_reply: psimssb says V"),
        ({"says": ["rate"]}, "codec: beacon 1: psimssb needs a place"),
        ({"codec": "usrth", "options": {}}, 'codec: usrth calls beacon 2 "1"'),
        (
            {"codec": "evologics", "options": {}, "says": ["rate"]},
            "codec: beacon 1: evologics needs",
        ),
        (
            {"codec": "evologics", "options": {}, "says": ["differences"]},
            "elements_m: missing; differences need two elements or more",
        ),
        (
            {"says": ["differences"], "elements_m": ELEMENTS, "pairs": [[1, 5]]},
            "pairs: there are 4 elements in elements_m",
        ),
        (
            {
                "codec": "evologics",
                "options": {},
                "says": ["differences"],
                "elements_m": ELEMENTS,
                "pairs": [[1, 3]],
            },
            "codec: beacon 1: evologics compares the elements",
        ),
    ],
)
def test_what_it_cannot_say_is_named(device: dict[str, Any], fault: str) -> None:
    scenario = scenario_of(**device)
    found = list(acoustics.faults(scenario, "a0", scenario.devices["a0"]))
    assert any(line.startswith(f"devices.a0.{fault}") for line in found), found
    assert len(found) == len(set(found))


def test_a_scenario_that_cannot_be_said_is_not_loaded(tmp_path: Any) -> None:
    text = twin.DEMO.read_text().replace("    period_s: 2.0", "    period_s: 2.0\n    axes: north")
    (tmp_path / "scenario.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        twin.load(tmp_path / "scenario.yaml")
    assert caught.value.faults == [
        "devices.usbl0.axes: tracklink-lxt with these options says array"
    ]


def with_faults(*faults: dict[str, Any], **device: Any) -> acoustics.Fixes:
    return fixes(scenario_of(CIRCLE | {"faults": list(faults)}, **device))


def test_a_dead_beacon_does_not_answer() -> None:
    found = with_faults({"fault": "beacon_dead", "beacon": "2", "at_s": 20.5, "for_s": 10.0})
    silent = [(t, name) for t, name in found.unanswered]
    assert silent == [(float(t), "2") for t in range(21, 30, 2)]
    once = with_faults({"fault": "beacon_dead", "beacon": "1", "at_s": 20.5})
    assert once.unanswered == [(22.0, "1")]


def test_a_beacon_that_is_dragged_away_answers_from_there() -> None:
    found = with_faults(
        {"fault": "beacon_moved", "beacon": "1", "at_s": 30.5, "north_m": 40.0, "down_m": -5.0}
    )
    before = fixes(scenario_of())
    lat, lon = np.deg2rad([BEACONS["1"]["lat_deg"], BEACONS["1"]["lon_deg"]])
    h = BEACONS["1"]["height_m"]
    there = earth.lla_to_ecef(lat, lon, h) + earth.C_en(lat, lon) @ [40.0, 0.0, -5.0]
    lat, lon, h = earth.ecef_to_lla(there)
    place = {"lat_deg": np.rad2deg(lat), "lon_deg": np.rad2deg(lon), "height_m": float(h)}
    after = fixes(scenario_of(CIRCLE | {"beacons": BEACONS | {"1": place}}))
    moved = (found.t_tx > 30.5) & (np.array(found.beacon) == "1")
    expected = np.where(moved, after.slant_range, before.slant_range)
    assert np.abs(after.slant_range - before.slant_range)[moved].max() > 10.0
    assert found.slant_range == pytest.approx(expected, abs=1e-6)


def test_echoes_come_for_a_time() -> None:
    fault = {"fault": "multipath", "device": "a0", "at_s": 20.5, "for_s": 20.0, "probability": 0.6}
    found = with_faults(fault, outliers={"extra_range_m": 50.0})
    echoed = found.t_tx[found.outlier]
    assert echoed.min() > 20.5
    assert echoed.max() < 40.5
    assert 7 <= echoed.size <= 17
    clean = fixes(scenario_of())
    assert np.all(found.slant_range[found.outlier] > clean.slant_range[found.outlier])
    assert np.all(found.slant_range[~found.outlier] == clean.slant_range[~found.outlier])


def test_a_fault_of_a_beacon_that_is_not_there_is_named() -> None:
    fault = {"fault": "beacon_dead", "beacon": "9", "at_s": 1.0}
    with pytest.raises(ConfigError) as caught:
        twin.sound(demo_data() | {"faults": [fault]})
    assert caught.value.faults == ['faults[0].beacon: no beacon is called "9"']


@pytest.mark.parametrize("pings", [1, 7, 1000])
def test_it_does_not_matter_how_many_pings_are_computed_at_once(
    pings: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    once = {"fault": "beacon_dead", "beacon": "1", "at_s": 20.5}
    echoes = {"fault": "multipath", "device": "a0", "at_s": 5.0, "for_s": 30.0, "probability": 0.5}
    device = {"outliers": {"probability": 0.1}, "jitter_ms": 300.0, "missed_probability": 0.2}
    noise = {"bearing_deg": 0.1, "elevation_deg": 0.1, "range_m": 0.1, "tilt_deg": 0.2}
    axes = {"axes": "north", "noise": noise, "no_reply": "NRy", "timeout_s": 3.5}
    scenario = scenario_of(CIRCLE | {"faults": [once, echoes]}, **device, **axes)
    usual = said(scenario)
    monkeypatch.setattr(sentences, "_BLOCK_PINGS", pings)
    assert said(scenario) == usual
    assert [t for t, _ in usual] == sorted(t for t, _ in usual)
