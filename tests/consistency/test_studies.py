"""The studies of seeds 000 and 004: quickly on few runs, and whole against their bars (slow)."""

from functools import cache

import numpy as np
import pytest

from gateway import studies
from gateway.fusion import filter as fusion_filter
from gateway.studies import errors, invariant, relative_measurement, statistics, voyage
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import HEADING, configured, sail
from gateway.studies.statistics import Interval
from gateway.studies.voyage import Voyage
from tests.gateway.test_studies import short

FEW = 4
POSE_AXES = ("north", "east", "down")
TIGHT = ("additive", "left_invariant", "right_invariant")


@cache
def circle() -> Voyage:
    return voyage.make(short("relative-measurement", 300.0))


@cache
def circle_runs() -> list[relative_measurement.Run]:
    return [relative_measurement.one(circle(), seed) for seed in range(FEW)]


@cache
def large_legs() -> Voyage:
    return voyage.make(invariant.with_attitude_errors(short("invariant", 120.0), 10.0, 60.0))


def inside(interval: Interval) -> bool:
    return interval.low < interval.value < interval.high


def test_the_tight_filter_is_consistent_and_the_mistuned_one_is_not() -> None:
    runs = circle_runs()
    assert inside(statistics.nees([r.tight for r in runs], 0))
    assert inside(statistics.nis([r.tight for r in runs]))
    mistuned = statistics.nis([r.mistuned for r in runs])
    assert mistuned.value > 2.0 * mistuned.high


def test_tight_is_better_than_its_parts() -> None:
    runs, begin = circle_runs(), 200
    tight = statistics.rms(statistics.horizontal([r.tight for r in runs], begin)).value
    alone = statistics.rms(statistics.horizontal([r.inertial for r in runs], begin)).value
    old = statistics.rms(statistics.horizontal([r.traditional for r in runs], begin)).value
    usbl = np.sqrt(np.mean([np.sum(r.usbl[:, :2] ** 2, axis=1) for r in runs]))
    assert tight < 0.8
    assert 1.4 * tight < old
    assert 2.0 * tight < usbl
    assert 20.0 * tight < alone


@pytest.mark.parametrize("name", TIGHT)
def test_large_first_errors_are_found(name: str) -> None:
    of = large_legs()
    for seed in range(FEW):
        measured = errors.draw(of, seed, "uniform")
        passage = sail(of, measured, configured(of.config, measured, **invariant.FILTERS[name]))
        assert np.degrees(abs(passage.error_n[-1, HEADING])) < 0.5


def test_a_heading_off_by_30_deg_locks_no_loose_filter_out() -> None:
    of = voyage.make(invariant.with_attitude_errors(short("invariant", 120.0), 5.0, 30.0))
    for seed in range(FEW):
        measured = errors.draw(of, seed, "uniform")
        mapped = configured(of.config, measured, **invariant.MAPPED["loose_mapped"])
        assert np.degrees(abs(sail(of, measured, mapped).error_n[-1, HEADING])) < 0.5


def test_careful_updates_keep_a_large_error_consistent(monkeypatch: pytest.MonkeyPatch) -> None:
    """In one part, the first fixes leave the filter surer than it may be."""
    of = voyage.make(invariant.weak(large_legs().scenario))

    def nees() -> float:
        found = []
        for seed in range(FEW):
            measured = errors.draw(of, seed, "uniform")
            found.append(sail(of, measured, configured(of.config, measured)).nees[1:].mean())
        return float(np.mean(found)) / 15

    careful = nees()
    monkeypatch.setattr(fusion_filter, "CAREFUL_PARTS", 1)
    assert careful < 2.0
    assert nees() > 1.5 * careful


@cache
def study(name: str) -> dict[str, Interval]:
    return {row.id: row.attained for row in studies.load(name)(studies.RUNS, Workers()).rows}


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_relative_measurement() -> None:
    rows = study("relative-measurement")
    assert rows["tight_horizontal_rms_white_m"].value <= 0.45
    assert rows["tight_horizontal_rms_both_m"].value <= 0.52
    assert 0.9 < rows["bound_ratio"].value < 1.15
    assert inside(rows["nees"])
    assert inside(rows["nis"])
    assert inside(rows["smoothed_nees"])
    attained = rows["tight_horizontal_rms_both_m"].value
    assert rows["smoothed_horizontal_rms_both_m"].value < 0.8 * attained
    assert rows["mistuned_nees"].value > rows["mistuned_nees"].high
    assert rows["mistuned_nis"].value > rows["mistuned_nis"].high
    assert rows["inertial_horizontal_rms_m"].value > 500.0
    assert rows["usbl_horizontal_rms_m"].value > 1.5


def looked_back(rows: dict[str, Interval]) -> None:
    assert inside(rows["smoothed_nees"])
    assert rows["smoothed_heading_deg"].value < 0.8 * rows["right_invariant_heading_deg"].value
    for axis in POSE_AXES:
        assert rows[f"smoothed_{axis}_m"].value < 0.6 * rows[f"right_invariant_{axis}_m"].value


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_invariant_small() -> None:
    rows = study("invariant-small")
    looked_back(rows)
    for name in TIGHT:
        assert rows[f"{name}_heading_deg"].value <= 0.0135
        assert max(rows[f"{name}_{axis}_m"].value for axis in POSE_AXES) <= 0.70
        assert rows[f"{name}_diverged"].value == 0
        assert inside(rows[f"{name}_nees"])
        assert inside(rows[f"{name}_nis"])


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_invariant_large() -> None:
    rows, small = study("invariant-large"), study("invariant-small")
    looked_back(rows)
    assert rows["right_invariant_diverged"].value == 0
    assert inside(rows["right_invariant_nees"])
    assert inside(rows["right_invariant_nis"])
    for what in ("heading_deg", *(f"{axis}_m" for axis in POSE_AXES)):
        name = f"right_invariant_{what}"
        assert rows[name].value <= 1.15 * small[name].value
    for other in ("additive", "left_invariant"):  # careful and repeated updates help them too
        assert (
            rows["weak_right_invariant_heading_deg"].value < rows[f"weak_{other}_heading_deg"].low
        )
    assert (
        rows["weak_loose_heading_deg"].value >= 2.0 * rows["weak_right_invariant_heading_deg"].value
    )


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_invariant_semi() -> None:
    rows = study("invariant-semi")
    looked_back(rows)
    for axis in POSE_AXES:
        assert rows[f"tight_gain_{axis}_percent"].value > 0.0
    for name in ("right_invariant", "loose", "loose_mapped"):
        assert rows[f"{name}_diverged"].value == 0
    assert inside(rows["right_invariant_nees"])
    assert inside(rows["right_invariant_nis"])
