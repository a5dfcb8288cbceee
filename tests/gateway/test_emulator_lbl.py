"""A long baseline said by the emulator and read by the gateway, against root finding."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from drivers import registry
from drivers.records import LblRecord
from gateway.config.blocks import Config
from gateway.emulator import acoustics, twin
from gateway.emulator.instruments import stream
from gateway.emulator.scenario import Scenario, codec_options
from gateway.emulator.trajectory import Trajectory
from gateway.ingest import Intake, intakes
from gateway.messages import BeaconRange, RadialRate
from gateway.nav import earth
from gateway.schema import build
from tests.gateway.emulated import START, demo_data, make, track

T0_NS = 5_000_000_000_000
DURATION_S = 120.0
LEVER = np.array([1.0, 0.2, -0.3])
BEACONS = {
    "A": {"lat_deg": -33.004, "lon_deg": -72.004, "height_m": -150.0, "turnaround_ms": 50.0},
    "B": {"lat_deg": -32.996, "lon_deg": -72.004, "height_m": -160.0, "turnaround_ms": 60.0},
    "C": {"lat_deg": -32.996, "lon_deg": -71.996, "height_m": -140.0},
    "D": {"lat_deg": -33.004, "lon_deg": -71.995, "height_m": -155.0},
}
NUMBERED = {str(k): beacon for k, beacon in enumerate(BEACONS.values(), 1)}


def interrogator(**changes: Any) -> dict[str, Any]:
    common = {
        "kind": "lbl",
        "codec": "micromodem",
        "port": {"type": "udp", "port": 7002},
        "clock": {"source": "arrival", "latency_ms": 20.0},
        "lever_arm_m": LEVER.tolist(),
        "noise": {"range_m": 1e-9, "range_rate_m_s": 1e-9},
        "period_s": 5.0,
    }
    return common | changes


def scenario_of(device: dict[str, Any], beacons: dict[str, Any] = BEACONS) -> Scenario:
    data = demo_data() | {"trajectory": track("circle"), "duration_s": DURATION_S}
    data |= {"beacons": beacons, "seed": 3}
    data["devices"] = {"imu0": data["devices"]["imu0"], "a0": device}
    return make(data)


def read(scenario: Scenario) -> tuple[list[LblRecord], Intake]:
    """Records with the time at which they came, and the intake that was fed."""
    model = scenario.devices["a0"]
    assert not list(acoustics.faults(scenario, "a0", model))
    config = build(Config, twin.gateway_config(scenario), [])
    intake = intakes(config)["a0"]
    decoder = registry.lookup(model.codec).decoder(codec_options(model))
    truth = Trajectory(scenario.trajectory, scenario.duration_s)
    records = []
    for emission in stream(scenario, "a0", model, truth, START, 1.0):
        t_ns = T0_NS + round(1e9 * emission.t)
        intake.feed(emission.data, t_ns)
        records += decoder.feed(emission.data, t_ns)
    return records, intake


class Distance:
    """To one beacon from the transducer, at any time."""

    def __init__(self, scenario: Scenario, beacon: str) -> None:
        b = scenario.beacons[beacon]
        self._b_e = earth.lla_to_ecef(np.deg2rad(b.lat_deg), np.deg2rad(b.lon_deg), b.height_m)
        self._truth = Trajectory(scenario.trajectory, scenario.duration_s)
        self._turnaround_s = 1e-3 * b.turnaround_ms

    def __call__(self, t: float) -> float:
        pose = self._truth.pose(np.array([t]))
        return float(np.linalg.norm(pose.r_e[0] + pose.C_eb[0] @ LEVER - self._b_e))

    def reply(self, t_ping: float) -> float:
        """When a ping's reply is heard."""
        t_sent = t_ping + self(t_ping) / 1500.0 + self._turnaround_s
        return brentq(lambda t: t_sent + self(t) / 1500.0 - t, t_sent, t_sent + 5.0, xtol=1e-12)


def test_four_ranges_of_one_ping_each_when_it_was_heard() -> None:
    scenario = scenario_of(interrogator())
    records, intake = read(scenario)
    assert len(records) == len({r.t_ping_s for r in records}) == 24
    ranges = intake.flush()
    assert len(ranges) == 4 * 24
    distances = {beacon: Distance(scenario, beacon) for beacon in BEACONS}
    for k, record in enumerate(records):
        t_ping = 5.0 * k
        heard = {beacon: d.reply(t_ping) for beacon, d in distances.items()}
        assert record.t_ping_s == pytest.approx((START + t_ping) % 86400.0, abs=0.01)
        assert (record.t_rx_ns - T0_NS) * 1e-9 == pytest.approx(max(heard.values()) + 0.02)
        for fix in ranges[4 * k : 4 * k + 4]:
            distance, t_rx = distances[fix.beacon], heard[fix.beacon]
            assert isinstance(fix, BeaconRange)
            # 1 us of the sentence is 1.5 mm; the earlier replies' times follow from such ranges.
            two_way = 0.5 * (distance(t_ping) + distance(t_rx))
            assert fix.slant_range == pytest.approx(two_way, abs=2e-3)
            assert (fix.t_ns - T0_NS) * 1e-9 == pytest.approx(t_rx, abs=5e-6)
            assert (fix.t_transmit_ns - T0_NS) * 1e-9 == pytest.approx(t_ping, abs=5e-6)


def test_who_does_not_answer_is_not_in_it_and_the_sentence_comes_after_the_time_is_over() -> None:
    device = interrogator(missed_probability=0.3, timeout_s=3.0)
    device["clock"] = {"source": "device", "latency_ms": 20.0}
    scenario = scenario_of(device)
    records, intake = read(scenario)
    for k, record in enumerate(records):
        left = (record.t_rx_ns - T0_NS) * 1e-9 - 5.0 * k
        assert (len(record.replies) == 4) == (left < 3.0)
        if len(record.replies) < 4:
            assert left == pytest.approx(3.02, abs=1e-6)
    answered = sum(len(record.replies) for record in records)
    assert 0.5 < answered / (4 * len(records)) < 0.9
    assert len(intake.flush()) == answered


def test_a_reply_after_the_time_is_over_is_not_heard() -> None:
    patient, _ = read(scenario_of(interrogator(timeout_s=10.0)))
    hurried, _ = read(scenario_of(interrogator(timeout_s=0.85)))
    answers = 0
    for all_four, told in zip(patient, hurried, strict=True):
        heard = {reply.beacon for reply in told.replies}
        for reply in all_four.replies:
            turnaround_s = 1e-3 * BEACONS[reply.beacon].get("turnaround_ms", 0.0)
            assert (reply.beacon in heard) == (2.0 * reply.one_way_s + turnaround_s <= 0.85)
        answers += len(heard)
    assert 0 < answers < 4 * len(patient)


def test_one_beacon_a_ping_and_the_rate_of_one() -> None:
    options = {"doppler_beacon": "3", "doppler_positive": "opening"}
    device = interrogator(asks="in_turn", rate_of="3", options=options, beacons=["1", "3"])
    scenario = scenario_of(device, NUMBERED)
    _, intake = read(scenario)
    fixes = intake.flush()
    ranges = [fix for fix in fixes if isinstance(fix, BeaconRange)]
    rates = [fix for fix in fixes if isinstance(fix, RadialRate)]
    assert [fix.beacon for fix in ranges] == ["1", "3"] * 12
    assert [fix.beacon for fix in rates] == ["3"] * 12
    for k, fix in enumerate(ranges):
        distance = Distance(scenario, fix.beacon)
        t_rx = distance.reply(5.0 * k)
        assert (fix.t_ns - T0_NS) * 1e-9 == pytest.approx(t_rx, abs=1e-6)
        two_way = 0.5 * (distance(5.0 * k) + distance(t_rx))
        assert fix.slant_range == pytest.approx(two_way, abs=2e-3)
    distance = Distance(scenario, "3")
    for fix in rates:
        t = (fix.t_ns - T0_NS) * 1e-9
        slope = (distance(t + 0.01) - distance(t - 0.01)) / 0.02
        assert fix.rates[0] == pytest.approx(slope, abs=2e-3)


def test_errors_have_their_sizes() -> None:
    noise = {"range_m": 2.0, "range_rate_m_s": 0.05}
    errors = {"range_scale": 0.002, "latency_ms": 30.0}
    quiet = read(scenario_of(interrogator(period_s=2.0)))[1].flush()
    noisy = read(scenario_of(interrogator(period_s=2.0, noise=noise, errors=errors)))[1].flush()
    exact = np.array([fix.slant_range for fix in quiet])
    wrong = np.array([fix.slant_range for fix in noisy]) - 1.002 * exact
    assert wrong.std() == pytest.approx(2.0, rel=0.15)
    assert abs(wrong.mean()) < 0.5
    late_ms = np.array([a.t_ns - b.t_ns for a, b in zip(noisy, quiet, strict=True)]) / 1e6
    assert late_ms.mean() == pytest.approx(30.0, abs=2.0)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"beacons": ["A", "X"]}, 'devices.a0.beacons[1]: no beacon is called "X"'),
        ({"beacons": ["A"], "rate_of": "B"}, "devices.a0.rate_of: it asks no beacon"),
        (
            {"rate_of": "B"},
            "devices.a0.options: what micromodem says of beacon B is read as NmeaSentence",
        ),
        (
            {"asks": "in_turn"},
            "devices.a0.options: what micromodem says of beacon A is read as Rejected",
        ),
        (
            {"options": {"transponders": ["A", "B", "C", "E"]}},
            "devices.a0.codec: beacon D: a reply of SNTTA must be one of the transponders",
        ),
    ],
)
def test_what_it_cannot_say_is_named(changes: dict[str, Any], fault: str) -> None:
    scenario = scenario_of(interrogator(**changes))
    assert fault in "\n".join(acoustics.faults(scenario, "a0", scenario.devices["a0"]))
