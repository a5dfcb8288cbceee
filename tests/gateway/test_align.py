"""Levelling and gyrocompassing against the emulator's truth, at rest, in sway and under way."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.stats import chi2

from gateway.emulator.sensors import ImuErrorSource
from gateway.fusion import align
from gateway.nav.attitude import C_from_euler
from gateway.nav.lie import log_so3
from tests.gateway.emulated import demo_data, make
from tests.gateway.test_estimator_start import SWAY
from tests.gateway.voyages import perfect_rows, trajectory

DEG_H, UG = math.radians(1.0) / 3600.0, 9.80665e-6
PERFECT = align.Grade(0.0, 0.0, 0.0, 0.0)
RUNS = 25
FOG = align.Grade(math.radians(0.002) / 60.0, 20 * UG, 0.02 * DEG_H, 50 * UG)


class Berth:
    """A vehicle, moored unless it has a speed, and the samples of its IMU."""

    def __init__(self, span_s: float, sway: dict[str, Any] | None = None, **track: Any) -> None:
        given = {"speed_m_s": 0.0, "course_deg": 37.0, "ramp_s": 0.0} | track
        if given.get("kind") == "circle":
            given = {k: v for k, v in given.items() if k not in ("course_deg", "ramp_s")}
        kind = given.pop("kind", "line")
        truth = trajectory(kind, span_s + 1.0, sway=SWAY if sway is None else sway, **given)
        self.rows = perfect_rows(truth, span_s, 100.0)
        at = truth.geodetic(np.zeros(1))
        self.heading = float(at.heading[0])
        self.C_nb = C_from_euler(at.roll[0], at.pitch[0], at.heading[0])
        v = at.v_eb_n[0] if given["speed_m_s"] else np.zeros(3)
        self.site = align.Site(float(at.lat[0]), float(at.h[0]), v, 0.0)

    def error(self, found: align.Found) -> np.ndarray:
        """(3,) rotation vector of the error, NED, rad."""
        return log_so3(found.C_nb @ self.C_nb.T)

    def level(self, grade: align.Grade = PERFECT, rows: np.ndarray | None = None) -> align.Found:
        rows = self.rows if rows is None else rows
        return align.level(rows, self.site, grade, self.heading, 0.0)

    def compass(self, grade: align.Grade = PERFECT, rows: np.ndarray | None = None) -> align.Found:
        return align.gyrocompass(self.rows if rows is None else rows, self.site, grade)

    def biased(self, bias: np.ndarray) -> np.ndarray:
        rows = self.rows.copy()
        rows[:, 1:7] += bias * rows[:, :1]
        return rows


@pytest.mark.parametrize("lat_deg", [0.0, 39.8, -70.0])
def test_at_rest_a_perfect_unit_gives_the_attitude_exactly(lat_deg):
    berth = Berth(120.0, sway={}, lat_deg=lat_deg)
    assert np.abs(berth.error(berth.level())).max() < 1e-7
    assert np.abs(berth.error(berth.compass())).max() < 1e-7


def test_steady_way_is_no_error_if_it_is_known():
    berth = Berth(300.0, sway={}, lat_deg=39.8, speed_m_s=3.0)
    assert abs(berth.error(berth.compass())[2]) < 1e-5
    unknown = align.Site(berth.site.lat, berth.site.h, np.zeros(3), 3.0)
    found = align.gyrocompass(berth.rows, unknown, PERFECT)
    error_deg = abs(math.degrees(berth.error(found)[2]))
    assert 0.2 < error_deg < 2.0 * math.degrees(found.heading_sd)


@pytest.mark.parametrize("axis", range(6))
def test_a_bias_tilts_and_turns_as_the_maps_say(axis):
    """1 deg/h, 1000 ug: the correlations that the filter begins with."""
    bias = np.zeros(6)
    bias[axis] = (DEG_H, DEG_H, DEG_H, 1000 * UG, 1000 * UG, 1000 * UG)[axis]
    berth = Berth(300.0, sway={}, lat_deg=39.8)
    for found in (berth.level(rows=berth.biased(bias)), berth.compass(rows=berth.biased(bias))):
        expected = found.by_gyro @ -bias[:3] + found.by_accel @ -bias[3:]
        error = berth.error(found)
        assert error == pytest.approx(expected, abs=0.03 * np.linalg.norm(error) + 5e-6)


def swaying(rng: np.random.Generator) -> dict[str, Any]:
    """Any seaway: periods of 4 to 12 s, displacements of decimetres."""

    def waves(amplitude: float) -> list[dict[str, float]]:
        return [
            {
                "amplitude": float(amplitude * rng.uniform(0.3, 1.0)),
                "period_s": float(rng.uniform(4.0, 12.0)),
                "phase_deg": float(rng.uniform(0.0, 360.0)),
            }
            for _ in range(3)
        ]

    return {
        axis: waves(amplitude)
        for axis, amplitude in {
            "roll": 3.0,
            "pitch": 2.0,
            "yaw": 1.0,
            "heave": 0.5,
            "north": 0.3,
            "east": 0.3,
        }.items()
    }


def noisy(berth: Berth, seed: int) -> np.ndarray:
    """The samples of a fibre-optic unit with its biases and noise."""
    model = make(demo_data()).devices["imu0"]
    errors = ImuErrorSource(msgspec.structs.replace(model, rate_hz=100.0), seed, "imu0")
    rows = berth.rows.copy()
    rows[:, 1:7] += errors.next(len(rows))
    return rows


def within(squares: list[float], degrees_of_freedom: int) -> bool:
    """Whether the mean of normalised squares lies in its 99.8 % bounds."""
    n = len(squares) * degrees_of_freedom
    low, high = chi2.ppf([0.001, 0.999], n)
    return bool(low <= np.sum(squares) <= high)


def test_the_level_in_any_seaway_is_as_good_as_it_says():
    squares = []
    for seed in range(RUNS):
        berth = Berth(30.0, sway=swaying(np.random.default_rng(seed)), lat_deg=39.8)
        found = berth.level(FOG, noisy(berth, seed))
        squares.append(float(np.sum((berth.error(found)[:2] / found.level_sd) ** 2)))
        assert found.level_sd < math.radians(0.1)
    assert within(squares, 2)


def test_the_compass_in_any_seaway_is_as_good_as_it_says():
    squares = []
    for seed in range(RUNS):
        berth = Berth(180.0, sway=swaying(np.random.default_rng(seed)), lat_deg=39.8)
        found = berth.compass(FOG, noisy(berth, seed))
        squares.append(float((berth.error(found)[2] / found.heading_sd) ** 2))
        assert found.heading_sd < math.radians(1.0)
    assert within(squares, 1)


def test_a_turn_is_seen_and_its_tilt_is_in_the_sigma():
    """3 m/s on a circle of 71 m: 0.13 m/s^2 sideways, 0.7 deg."""
    berth = Berth(30.0, sway={}, kind="circle", speed_m_s=3.0)
    found = berth.level()
    tilt = float(np.linalg.norm(berth.error(found)[:2]))
    assert 0.5 * found.level_sd < tilt < 2.0 * found.level_sd
    assert max(found.level_parts, key=found.level_parts.get) == "turning"


def test_a_tight_turn_is_refused():
    berth = Berth(30.0, sway={}, kind="circle", speed_m_s=6.0, radius_m=40.0)
    assert berth.level().refusal in ("level_turning", "level_unsteady")


def test_samples_that_are_missing_are_in_the_sigma():
    berth = Berth(30.0, lat_deg=39.8)
    rows = np.delete(berth.rows, np.s_[1000:1300], axis=0)
    rows[1000, 0], rows[1000, 7] = 3.01, 3.0
    rows[1000, 1:7] *= 301.0
    found = berth.level(rows=rows)
    assert found.refusal == "level_gaps"


def test_near_a_pole_there_is_no_compass():
    assert Berth(120.0, lat_deg=89.9).compass(FOG).refusal.startswith("heading_")


def test_poor_gyros_are_no_compass():
    grade = align.Grade(math.radians(0.3) / 60.0, 100 * UG, 10 * DEG_H, 1000 * UG)
    assert Berth(120.0, sway={}, lat_deg=39.8).compass(grade).refusal == "heading_bias"


def test_course_of_a_vehicle_that_moves_bow_first():
    heading, sigma = align.course(np.array([0.0, -2.0, 0.1]), 0.02, math.radians(1.0), 0.5)
    assert heading == pytest.approx(-math.pi / 2)
    assert sigma == pytest.approx(math.hypot(0.01, math.radians(1.0)))
    assert align.course(np.array([0.3, 0.2, 5.0]), 0.02, 0.01, 0.5)[1] == math.inf
