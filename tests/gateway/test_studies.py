"""The parts that all studies are made of, against what is known from elsewhere."""

import dataclasses

import msgspec
import numpy as np
import pytest
import scipy.stats

from gateway.emulator import acoustics
from gateway.emulator.scenario import Scenario
from gateway.emulator.trajectory import Trajectory
from gateway.nav import earth
from gateway.studies import bound, errors, invariant, relative_measurement, statistics, voyage
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import HEADING, Passage, configured, sail
from gateway.studies.voyage import Voyage

TINY = 1e-12


def short(name: str, duration_s: float = 60.0, rate_hz: float = 50.0) -> Scenario:
    scenario = voyage.load(name)
    devices = {
        key: msgspec.structs.replace(model, rate_hz=rate_hz) if key == "imu0" else model
        for key, model in scenario.devices.items()
    }
    return msgspec.structs.replace(scenario, duration_s=duration_s, devices=devices)


@pytest.fixture(scope="module")
def circle() -> Voyage:
    return voyage.make(short("relative-measurement"))


@pytest.fixture(scope="module")
def legs() -> Voyage:
    return voyage.make(short("invariant"))


def test_a_voyage_is_the_emulators(circle: Voyage) -> None:
    truth = Trajectory(circle.scenario.trajectory, circle.scenario.duration_s)
    pose = truth.pose(circle.truth.t_s)
    assert np.array_equal(circle.truth.r_e, pose.r_e)
    ahead = truth.pose(circle.truth.t_s + 1e-3).r_e - truth.pose(circle.truth.t_s - 1e-3).r_e
    assert np.abs(circle.truth.v_eb_e - ahead / 2e-3).max() < 1e-5
    assert len(circle.rows) == 3000
    assert circle.rows[:, 1:4].sum(axis=0) == pytest.approx(
        [0, 0, -60.0 * 3.0 / 71.4], abs=60.0 * earth.OMEGA_IE
    )


def test_every_beacon_answers_every_ping(legs: Voyage) -> None:
    assert sorted(legs.replies.beacon) == ["1"] * 20 + ["2"] * 20  # the last is heard at 59.7 s
    assert (np.diff(legs.replies.t_ns) > 0).all()


@pytest.mark.parametrize("seed", [1, 2])
def test_constant_errors_are_the_emulators(circle: Voyage, seed: int) -> None:
    """The emulator turns the array itself; here perfect directions are turned afterwards."""
    name, model = circle.usbl
    quiet = msgspec.structs.replace(
        model,
        mounting_deg=(3.0, -2.0, 40.0),
        noise=msgspec.structs.replace(
            model.noise, bearing_deg=TINY, elevation_deg=TINY, range_m=TINY
        ),
    )
    scenario = msgspec.structs.replace(
        circle.scenario, seed=seed, devices=circle.scenario.devices | {name: quiet}
    )
    of = voyage.refit(circle, scenario)
    truth = Trajectory(scenario.trajectory, scenario.duration_s)
    told = acoustics.measure(scenario, name, quiet, truth)
    fixes = errors.draw(of, seed).fixes
    assert len(fixes) == len(told.t_rx) == 30
    for fix, *expected in zip(
        fixes, told.t_rx, told.elevation, told.bearing, told.slant_range, strict=True
    ):
        assert [fix.elevation, fix.bearing, fix.slant_range] == pytest.approx(expected[1:], 1e-9)
        assert fix.t_ns == pytest.approx(1e9 * expected[0], abs=1.0)


def test_errors_have_the_stated_sizes(legs: Voyage) -> None:
    drawn = [errors.draw(legs, seed, "uniform") for seed in range(60)]
    perfect = errors.without(legs)
    noise = np.array([m.rows[:, 1:7] - legs.rows[:, 1:7] for m in drawn])
    white = noise - noise.mean(axis=1, keepdims=True)
    root_dt = np.sqrt(0.02)
    assert white[:, :, :3].std() == pytest.approx(np.radians(0.005) / 60 * root_dt, rel=0.01)
    assert white[:, :, 3:].std() == pytest.approx(20e-6 * 9.80665 * root_dt, rel=0.01)
    bias = np.array([m.constants[:6] for m in drawn])
    assert bias[:, :3].std() == pytest.approx(np.radians(0.02) / 3600, rel=0.2)
    assert bias[:, 3:].std() == pytest.approx(100e-6 * 9.80665, rel=0.2)
    z = np.array(
        [
            [f.elevation - g.elevation, f.bearing - g.bearing, f.slant_range - g.slant_range]
            for m in drawn
            for f, g in zip(m.fixes, perfect.fixes, strict=True)
        ]
    )
    assert z.std(axis=0) == pytest.approx([np.radians(0.2), np.radians(0.2), 2.0], rel=0.05)
    attitude = np.array([m.initial.attitude_deg for m in drawn]) - perfect.initial.attitude_deg
    assert attitude.std(axis=0) == pytest.approx(legs.scenario.initial.sigma.attitude_deg, rel=0.3)
    assert np.abs(attitude).max(axis=0) == pytest.approx([0.2, 0.2, 1.0], rel=0.1)


def test_the_same_seed_gives_the_same_errors(legs: Voyage) -> None:
    one, two, other = (errors.draw(legs, seed) for seed in (5, 5, 6))
    assert np.array_equal(one.rows, two.rows)
    assert one.fixes == two.fixes
    assert one.initial == two.initial
    assert not np.array_equal(one.rows, other.rows)


@pytest.mark.parametrize("name", ["circle", "legs"])
def test_without_errors_the_filter_stays_at_the_truth(
    name: str, request: pytest.FixtureRequest
) -> None:
    of: Voyage = request.getfixturevalue(name)
    along = bound.along_truth(of)
    assert np.abs(along.error_n[:, :3]).max() < 2e-3
    assert np.degrees(np.abs(along.error_n[:, HEADING]).max()) < 1e-3
    assert along.nis.max() < 1e-3
    assert along.sigma_n[-1, 0] < along.sigma_n[0, 0] or name == "circle"


def test_first_errors_are_seen_at_once(legs: Voyage) -> None:
    """What is told as the first state is what the first epoch finds wrong."""
    measured = errors.draw(legs, 3)
    passage = sail(legs, measured, configured(legs.config, measured), aided=False)
    told, true = measured.initial, errors.without(legs).initial
    R_M, _ = earth.radii(np.radians(true.lat_deg))
    north = np.radians(told.lat_deg - true.lat_deg) * R_M
    assert passage.error_n[0, 0] == pytest.approx(float(north), rel=1e-4)
    assert passage.error_n[0, 5] == pytest.approx(
        told.velocity_ned_m_s[2] - true.velocity_ned_m_s[2], abs=1e-6
    )
    turned = np.degrees(passage.error_n[0, HEADING])
    level_deg = 2.0  # cross terms of level and heading
    assert turned == pytest.approx(
        told.attitude_deg[2] - true.attitude_deg[2], abs=np.sin(np.radians(level_deg)) * 0.5
    )


def test_normalised_error_of_a_first_state_is_chi_squared(legs: Voyage) -> None:
    first = []
    for seed in range(100):
        measured = errors.draw(legs, seed)
        passage = sail(
            dataclasses.replace(legs, truth=_only_first(legs)),
            measured,
            configured(legs.config, measured),
        )
        first.append(passage.nees[0])
    low, high = scipy.stats.chi2.ppf([0.001, 0.999], 100 * 15) / (100 * 15)
    assert low < np.mean(first) / 15 < high


def _only_first(of: Voyage) -> voyage.Truth:
    return voyage.Truth(*(values[:1] for values in dataclasses.astuple(of.truth)))


def test_bounds_of_statistics_cover_what_they_claim() -> None:
    rng = np.random.default_rng(7)
    covered = 0
    for _ in range(200):
        mean_squares = rng.chisquare(30, size=50) / 30 * 4.0
        value, low, high = statistics.rms(mean_squares)
        assert low <= value <= high
        covered += low <= 2.0 <= high
    assert 0.88 < covered / 200 <= 1.0
    assert statistics.count(np.zeros(50, dtype=bool)) == pytest.approx((0, 0, 3.556), abs=1e-3)


def passage(nees: float, nis: float) -> Passage:
    return Passage(
        np.zeros((11, 9)),
        np.ones((11, 9)),
        np.full(2, nees),
        15,
        np.full(100, nis),
        np.full(100, 3.0),
    )


def test_consistency_is_within_its_bounds_or_not() -> None:
    good = [passage(15.0, 3.0)] * 50
    for interval in (statistics.nees(good, 0), statistics.nis(good)):
        assert interval.value == pytest.approx(1.0)
        assert interval.low < 1.0 < interval.high
    bad = [passage(15.0 * 1.2, 3.0 * 1.1)] * 50
    for interval in (statistics.nees(bad, 0), statistics.nis(bad)):
        assert interval.value > interval.high


def test_a_lost_run_is_diverged() -> None:
    error = np.zeros((1001, 9))
    sound = Passage(error, error, np.zeros(101), 15, np.zeros(1), np.ones(1))
    assert not invariant.has_diverged(sound)
    for column, size in ((0, 60.0), (HEADING, 0.1), (3, np.nan)):
        lost = error.copy()
        lost[700, column] = size
        assert invariant.has_diverged(dataclasses.replace(sound, error_n=lost))
        early = error.copy()
        early[100, column] = size
        assert not invariant.has_diverged(dataclasses.replace(sound, error_n=early))


def test_single_fixes_are_wrong_by_their_noise(circle: Voyage) -> None:
    perfect = errors.without(circle)
    still = sail(circle, perfect, configured(circle.config, perfect), aided=False)
    assert np.abs(relative_measurement.usbl_alone(circle, perfect, still)).max() < 2e-3
    fix = perfect.fixes[4]
    wrong = msgspec.structs.replace(fix, slant_range=fix.slant_range + 1.0)
    one = dataclasses.replace(perfect, fixes=[*perfect.fixes[:4], wrong, *perfect.fixes[5:]])
    found = relative_measurement.usbl_alone(circle, one, still)[4]
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=2e-3)
    assert found[2] == pytest.approx(-50.0 / 87.2, abs=5e-3)  # a longer range puts it higher


def halve(whole: int, seed: int) -> float:
    return whole / 2 + seed


@pytest.mark.parametrize("jobs", [1, 2])
def test_runs_come_in_the_order_of_their_seeds(jobs: int) -> None:
    assert Workers(jobs).map(halve, (8,), 5, "halves") == [4.0, 5.0, 6.0, 7.0, 8.0]
