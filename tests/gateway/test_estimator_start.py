"""The start: attitude found before the first fix, without losing data, and the filter after it."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from scipy.stats import chi2

from gateway.config import Config
from gateway.emulator.scenario import Scenario
from gateway.estimator import Estimator
from gateway.messages import (
    Checkpoint,
    FilterOutput,
    ImuBlock,
    Innovation,
    Measurement,
    NavSolution,
    SavedState,
)
from gateway.modes import Mode
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import T0_NS, Voyage, configuration

SWAY = {
    "roll": [{"amplitude": 3.0, "period_s": 6.1}],
    "pitch": [{"amplitude": 2.0, "period_s": 7.3, "phase_deg": 90}],
    "yaw": [{"amplitude": 1.0, "period_s": 23.0}],
    "heave": [{"amplitude": 0.4, "period_s": 8.0}],
    "north": [{"amplitude": 0.3, "period_s": 9.0, "phase_deg": 40}],
    "east": [{"amplitude": 0.2, "period_s": 11.0}],
}
MOORED = {
    "type": "line",
    "lat_deg": 39.8,
    "lon_deg": 116.2,
    "speed_m_s": 0.0,
    "course_deg": 75.0,
    "sway": SWAY,
}
MOWING = {
    "type": "lawnmower",
    "lat_deg": 39.8,
    "lon_deg": 116.2,
    "speed_m_s": 3.0,
    "course_deg": 30.0,
    "leg_m": 150.0,
    "spacing_m": 60.0,
    "sway": demo_data()["trajectory"]["sway"],
}
RUNS = 24
TURNING = MOWING | {"leg_m": 30.0, "spacing_m": 8.0, "speed_m_s": 6.0}
OFF_TRACK = {"1": {"lat_deg": 39.8005, "lon_deg": 116.2012, "height_m": -50.0}}


def scenario(track, seed: int, duration_s: float, rate_hz: float = 50.0) -> Scenario:
    data = demo_data() | {"seed": seed, "duration_s": duration_s, "trajectory": track}
    data["devices"]["imu0"]["rate_hz"] = rate_hz
    data["devices"]["usbl0"]["outliers"] = {}
    return make(data | {"beacons": OFF_TRACK})


def aligning(
    voyage: Voyage, heading_error_deg: float = 0.0, heading_sd_deg: float = 1.0, **align
) -> Config:
    """The matching configuration, finding its attitude; velocity unknown to 0.3 m/s."""
    first = configuration(voyage.scenario).initial
    at_rest = voyage.truth.geodetic(np.zeros(1))
    velocity = at_rest.v_eb_n[0] if voyage.scenario.trajectory.speed_m_s else np.zeros(3)
    block = {
        "lat_deg": first.lat_deg,
        "lon_deg": first.lon_deg,
        "height_m": first.height_m,
        "velocity_ned_m_s": velocity.tolist(),
        "align": {"heading": "config"} | align,
        "sigma": {"position_m": [5, 5, 1], "velocity_m_s": 0.3},
    }
    if block["align"]["heading"] == "config":
        heading = math.degrees(at_rest.heading[0]) + heading_error_deg
        block["attitude_deg"] = [0, 0, heading]
        block["sigma"]["attitude_deg"] = [0, 0, heading_sd_deg]
    return configuration(voyage.scenario, initial=block)


def run(config: Config, measurements: list[Measurement], rate_hz: float = 1.0):
    estimator = Estimator(config, rate_hz)
    return [o for m in measurements for o in estimator.feed(m)], estimator


def solutions(outputs: list[FilterOutput]) -> list[NavSolution]:
    return [o for o in outputs if isinstance(o, NavSolution)]


def seconds(solution: NavSolution | Innovation) -> float:
    return (solution.t_ns - T0_NS) * 1e-9


def heading_error_deg(voyage: Voyage, solution: NavSolution) -> float:
    truth = voyage.truth.geodetic(np.array([seconds(solution)]))
    return math.degrees((solution.heading - truth.heading[0] + math.pi) % (2 * math.pi) - math.pi)


def test_nothing_is_claimed_before_the_attitude_is_found_and_no_fix_is_lost():
    voyage = Voyage(scenario(MOORED, 3, 60.0))
    outputs, estimator = run(aligning(voyage, level_s=30), list(voyage.arrivals(0.5)))
    waiting = [s for s in solutions(outputs) if seconds(s) < 29.9]
    assert {s.mode for s in waiting} == {Mode.ALIGNING}
    assert all(s.sd_attitude[2] > 0.017 and min(s.sd_position[:2]) >= 5.0 for s in waiting)
    assert solutions(outputs)[-1].mode is Mode.AIDED
    verdicts = [o for o in outputs if isinstance(o, Innovation)]
    assert (verdicts[0].device, verdicts[0].accepted, verdicts[0].reason) == ("imu0", True, "")
    assert [c.name for c in verdicts[0].components] == ["roll_deg", "pitch_deg", "heading_deg"]
    heard = [fix for fix in voyage.fixes if fix.t_ns + 0.5e9 <= voyage.t_ns[-1]]
    assert [v.t_ns for v in verdicts[1:]] == [fix.t_ns for fix in heard]
    assert estimator.counts().fixes_used == len(heard)


@pytest.mark.parametrize(
    ("track", "align"),
    [(MOORED, {"level_s": 7.3}), (TURNING, {"level_s": 7.3, "heading": "unknown"})],
)
def test_what_comes_out_does_not_depend_on_batches(track, align):
    voyage = Voyage(scenario(track, 4, 40.0))
    config = aligning(voyage, **align)
    fine = list(voyage.arrivals(0.5, 0.02))
    whole = said(run(config, fine, 3.0)[0])
    for block_s in (0.1, 1.7):
        assert said(run(config, list(joined(fine, block_s)), 3.0)[0]) == whole


def said(outputs: list[FilterOutput]) -> list[str]:
    """All but checkpoints, which count messages."""
    return [repr(o) for o in outputs if not isinstance(o, SavedState | Checkpoint)]


def joined(arrivals: list[Measurement], block_s: float) -> Iterator[Measurement]:
    """The same arrivals with neighbouring blocks of samples in one."""
    size = round(block_s / 0.02)
    for are_samples, group in itertools.groupby(arrivals, lambda m: isinstance(m, ImuBlock)):
        together = list(group)
        if not are_samples:
            yield from together
            continue
        for k in range(0, len(together), size):
            part = together[k : k + size]
            yield ImuBlock(b"".join(m.t_ns for m in part), b"".join(m.rows for m in part))


def test_a_window_of_manoeuvres_is_refused_with_its_reason_and_the_next_one_tried():
    """6 m/s, and hard over again and again."""
    voyage = Voyage(scenario(TURNING, 5, 60.0))
    outputs, _ = run(aligning(voyage, level_s=10), list(voyage.arrivals(0.5)))
    verdicts = [o for o in outputs if isinstance(o, Innovation) and o.device == "imu0"]
    assert len(verdicts) > 1
    assert not verdicts[0].accepted
    assert verdicts[0].reason in ("level_turning", "level_unsteady")
    stale = [o for o in outputs if isinstance(o, Innovation) and o.reason == "aligning"]
    assert stale and all(seconds(o) <= 10.0 * len(verdicts) for o in stale)


def test_gyrocompassing_in_sway_finds_the_heading_it_says():
    voyage = Voyage(scenario(MOORED, 6, 200.0))
    config = aligning(voyage, heading="gyrocompass", gyrocompass_s=180)
    outputs, _ = run(config, list(voyage.arrivals(0.5, 0.5)))
    found = next(s for s in solutions(outputs) if seconds(s) > 180.0)
    sd = math.degrees(found.sd_attitude[2])
    assert sd < 1.0
    assert abs(heading_error_deg(voyage, found)) < 3.0 * sd


@pytest.mark.parametrize(("seed", "error_deg"), [(0, 60.0), (1, -60.0), (2, 25.0)])
def test_a_heading_far_off_converges(seed, error_deg):
    assert arrival_nees(seed, aligning, heading_error_deg=error_deg, heading_sd_deg=60.0) < 12.0


@pytest.mark.slow
def test_headings_up_to_60_deg_off_converge_with_the_sigma_they_say():
    errors = np.random.default_rng(1).uniform(-60.0, 60.0, RUNS)
    assert_consistent(
        [
            arrival_nees(seed, aligning, heading_error_deg=float(error), heading_sd_deg=60.0)
            for seed, error in enumerate(errors)
        ]
    )


@pytest.mark.parametrize("seed", [3, 4])
def test_an_unknown_heading_converges(seed):
    assert arrival_nees(seed, aligning, heading="unknown") < 12.0


@pytest.mark.slow
def test_unknown_headings_converge_with_the_sigma_they_say():
    assert_consistent([arrival_nees(seed, aligning, heading="unknown") for seed in range(RUNS)])


def assert_consistent(nees: list[float]) -> None:
    low, high = chi2.ppf([0.005, 0.995], len(nees)) / len(nees)
    assert low < np.mean(nees) < high


def arrival_nees(seed: int, configure, **start) -> float:
    """Normalised square of the heading error at the end, which must be below 2 deg.

    Every heading of the vehicle occurs; where it is not known, so is not the velocity's direction.
    """
    course = float(np.random.default_rng(seed).uniform(0.0, 360.0))
    voyage = Voyage(scenario(MOWING | {"course_deg": course}, 100 + seed, 240.0))
    outputs, _ = run(configure(voyage, **start), list(voyage.arrivals(0.5, 0.5)))
    last = solutions(outputs)[-1]
    error = heading_error_deg(voyage, last)
    assert abs(error) < 2.0
    assert last.mode is Mode.AIDED
    return (error / math.degrees(last.sd_attitude[2])) ** 2
