"""What delay and lever arms are worth to a ship that follows a target, and whether it claims right.

The long form, 20 seeds, printed: ``pytest -m slow -s tests/consistency/test_following.py``.
"""

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from gateway import targets
from gateway.messages import TargetSighting
from tests.consistency.following import STRAIGHT, TURNS, Sea, Tracked, rov, run, sea

AT_ARM = (0.0, 0.0, 0.0)
TOLD: dict[str, dict[str, Any]] = {
    "as it is": {},
    "latency told as 0": {"declared_s": 0.0},
    "lever arm told as 0": {"lever_m": AT_ARM},
    "both told as 0": {"declared_s": 0.0, "lever_m": AT_ARM},
}
COARSE = {
    "noise": {"bearing_deg": 1.0, "elevation_deg": 1.0, "range_m": 0.4},
    "prior": {"mounting_deg": 0.5, "range_scale": 0.005},
}
"""An array of which much is not known: what all sightings share is large."""
STEADY = 0.005
"""Acceleration (m/s^2 over one second) of a target that keeps its course."""
FEW = 3


def horizontal(runs: Iterable[Tracked]) -> float:
    """RMS over runs."""
    return float(np.sqrt(np.mean([r.horizontal_m**2 for r in runs])))


@cache
def short(seed: int) -> Sea:
    return sea(seed, 110.0)


@cache
def told(what: str) -> list[Tracked]:
    return [run(short(seed), settled_s=40.0, **TOLD[what])["2"] for seed in range(FEW)]


@pytest.mark.parametrize("wrong", list(TOLD)[1:])
def test_delay_and_lever_arm_are_each_worth_something(wrong: str) -> None:
    assert horizontal(told("as it is")) < horizontal(told(wrong))


def test_a_target_is_within_three_of_its_sigmas() -> None:
    for found in told("as it is"):
        sd = np.sqrt(np.diagonal(found.P, axis1=1, axis2=2))
        assert np.mean(np.abs(found.error) < 3.0 * sd) > 0.98


def test_fixes_two_and_a_half_seconds_late_are_used_at_their_time() -> None:
    """What comes late is known later, not worse: the last one is older by two seconds."""
    late = [run(short(seed), settled_s=40.0, late_s=2.5)["2"] for seed in range(FEW)]
    sd = [np.sqrt(np.mean(r.P[:, 0, 0])) for r in late]
    assert np.mean([r.nees.mean() for r in late]) < 3.0
    assert np.mean(sd) / np.mean([np.sqrt(np.mean(r.P[:, 0, 0])) for r in told("as it is")]) > 1.0
    assert horizontal(late) < horizontal(told("both told as 0"))


def test_replies_that_miss_and_echoes_are_survived() -> None:
    """A third misses, a tenth comes by a longer way from aside: none pulls the track off."""
    echoes = {"probability": 0.1, "extra_range_m": 60.0, "angle_deg": 20.0}
    found = run(sea(3, 140.0, missed_probability=0.3, outliers=echoes), settled_s=40.0)["2"]
    sd = np.sqrt(np.diagonal(found.P, axis1=1, axis2=2))
    assert np.mean(np.abs(found.error) < 4.0 * sd) > 0.97
    assert np.linalg.norm(found.error, axis=1).max() < 15.0


def test_several_are_followed_in_turn_and_one_that_turns_as_well() -> None:
    both = {"2": rov(**STRAIGHT), "7": rov(**TURNS) | {"name": "sledge"}}
    found = run(sea(4, 140.0, targets=both), settled_s=40.0, acceleration_m_s2=0.15)
    assert list(found) == ["2", "7"]
    for track in found.values():
        assert track.nees.mean() < 4.5
        assert track.horizontal_m < 3.0


@cache
def coarse(runs: int, duration_s: float) -> list[Tracked]:
    seas = [sea(seed, duration_s, **COARSE) for seed in range(runs)]
    return [run(of, acceleration_m_s2=STEADY)["2"] for of in seas]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_over_twenty_seeds() -> None:
    """The bar: RMS error with all told as it is, and with latency, lever arm, both told as 0."""
    seas = [sea(seed) for seed in range(20)]
    rms = {}
    for what, wrong in TOLD.items():
        runs = [run(of, **wrong)["2"] for of in seas]
        rms[what] = horizontal(runs)
        down = np.sqrt(np.mean([np.mean(r.error[:, 2] ** 2) for r in runs]))
        nees = np.mean([r.nees.mean() for r in runs]) / 3.0
        print(f"{what:20s} horizontal {rms[what]:.2f} m, down {down:.2f} m, NEES/3 {nees:.2f}")
    right = rms.pop("as it is")
    assert min(rms.values()) > 1.1 * right


AT_S = (40, 100, 170)
"""When it is looked at, seconds after it settled."""


def squares(runs: list[Tracked]) -> list[float]:
    """NEES over its degrees of freedom at each of `AT_S`."""
    return [float(np.mean([r.nees[k] for r in runs])) / 3.0 for k in AT_S]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_steady_target_is_known_as_well_as_is_claimed() -> None:
    """Of an array of which much is not known; within the bounds of all three moments together."""
    runs = coarse(40, 240.0)
    low, high = chi2.ppf([0.025 / 3, 1.0 - 0.025 / 3], 3 * len(runs)) / (3 * len(runs))
    found = squares(runs)
    print(f"NEES/3 {np.round(found, 2)}, bounds {low:.2f} .. {high:.2f}")
    assert max(found) < high
    assert min(found) > 0.5  # what is shared is taken for wholly shared: it claims a little less


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_track_that_averages_our_own_uncertainty_away_is_found_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    take = targets.Track.take

    def mixed(self: targets.Track, found: TargetSighting) -> bool:
        whole = tuple(a + b for a, b in zip(found.cov, found.own_cov, strict=True))
        nothing = (0.0,) * 6
        return take(self, TargetSighting(*_head(found), whole, nothing))

    monkeypatch.setattr(targets.Track, "take", mixed)
    runs = [run(sea(seed, **COARSE), acceleration_m_s2=STEADY)["2"] for seed in range(20)]
    high = chi2.ppf(0.975, 3 * len(runs)) / (3 * len(runs))
    found = squares(runs)
    print(f"NEES/3 {np.round(found, 2)}, bound {high:.2f}")
    assert max(found) > high


def _head(found: TargetSighting) -> tuple[Any, ...]:
    return found.t_ns, found.device, found.beacon, found.lat, found.lon, found.h
