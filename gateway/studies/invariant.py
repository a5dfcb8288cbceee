"""Seed 004 (Guo Yu et al.), tables 2 and 3: error definitions and couplings side by side."""

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.emulator.scenario import Scenario
from gateway.studies import bound, errors, figures, statistics, voyage
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import (
    DOWN,
    EAST,
    HEADING,
    NORTH,
    Choices,
    Passage,
    configured,
    sail,
    smoothed,
)
from gateway.studies.statistics import Interval
from gateway.studies.table import Row, Study
from gateway.studies.voyage import EPOCH_S, Voyage

Array = NDArray[np.float64]

SCENARIO = "invariant"
FILTERS: Mapping[str, Choices] = {
    "additive": {"error": "additive"},
    "left_invariant": {"error": "left_invariant"},
    "right_invariant": {"error": "right_invariant"},
    "loose": {"coupling": "loose", "loose_noise": "fixed", "loose_sigma_m": 4.5},
}
"""The seed's TKF, LIETKF, RIETKF and RIELKF, whose noise is the same whatever the range: here the
mean of what 0.2 deg and 2 m are worth over the voyage."""

MAPPED: Mapping[str, Choices] = {"loose_mapped": {"coupling": "loose"}}
"""Loose with the noise that each fix really has."""

AXES = {"north": NORTH, "east": EAST, "down": DOWN}
PUBLISHED_GAIN = (2.61, 15.79, 22.96)
"""By how many percent tight is better than loose north, east and down, from table 3."""

SETTLED = round(400.0 / EPOCH_S)
"""First epoch that counts: the tables are of the time after 400 s."""

SMOOTHED_RUNS = 10

DIVERGED_HEADING, DIVERGED_M = np.radians(5.0), 50.0
"""A run that is once further off after `SETTLED` has diverged."""

Fleet = dict[str, Passage]
"""One run's passage by the name of the filter."""


def run_small(runs: int, workers: Workers) -> Study:
    """Errors of the first attitude up to 0.2 deg of level and 1 deg of heading."""
    small = _voyage(0.2, 1.0)
    fleets = workers.map(one, (small, FILTERS), runs, "invariant-small")
    return _study("invariant-small", small, fleets, _looked_back(small, runs, workers))


def run_large(runs: int, workers: Workers) -> Study:
    """Up to 10 deg and 60 deg; and once more with little to observe."""
    large = _voyage(10.0, 60.0)
    fleets = workers.map(one, (large, FILTERS), runs, "invariant-large")
    little = voyage.make(weak(large.scenario))
    weakly = workers.map(one, (little, FILTERS), runs, "invariant-large, one beacon")
    rows = [
        Row(f"weak_{name}_heading_deg", None, _heading([f[name] for f in weakly]), "deg")
        for name in FILTERS
    ]
    rows += [
        Row(
            f"weak_{name}_diverged",
            None,
            statistics.count(_lost([f[name] for f in weakly])),
            "runs",
        )
        for name in FILTERS
    ]
    rows += _looked_back(large, runs, workers)
    return _study("invariant-large", large, fleets, rows)


def run_semi(runs: int, workers: Workers) -> Study:
    """Up to 5 deg and 30 deg: tight against loose."""
    semi = _voyage(5.0, 30.0)
    fleets = workers.map(one, (semi, {**FILTERS, **MAPPED}), runs, "invariant-semi")
    rows = [
        Row(f"tight_gain_{axis}_percent", published, _gain(fleets, column), "%")
        for (axis, column), published in zip(AXES.items(), PUBLISHED_GAIN, strict=True)
    ]
    rows += _looked_back(semi, runs, workers)
    return _study("invariant-semi", semi, fleets, rows)


def one(of: Voyage, filters: Mapping[str, Choices], seed: int) -> Fleet:
    """Some filters over one run."""
    measured = errors.draw(of, seed, attitude="uniform")
    return {
        name: sail(of, measured, configured(of.config, measured, **choices))
        for name, choices in filters.items()
    }


def weak(scenario: Scenario) -> Scenario:
    """One beacon and one turn, and a first state that is 100 m and 1 m/s off."""
    one_turn = msgspec.structs.replace(scenario.trajectory, leg_m=900.0, turns_deg=(90.0,))
    sigma = msgspec.structs.replace(
        scenario.initial.sigma, position_m=(100.0, 100.0, 100.0), velocity_m_s=1.0
    )
    return msgspec.structs.replace(
        scenario,
        trajectory=one_turn,
        beacons={"1": scenario.moored["1"]},
        initial=msgspec.structs.replace(scenario.initial, sigma=sigma),
    )


def _voyage(level_deg: float, heading_deg: float) -> Voyage:
    return voyage.make(with_attitude_errors(voyage.load(SCENARIO), level_deg, heading_deg))


def with_attitude_errors(scenario: Scenario, level_deg: float, heading_deg: float) -> Scenario:
    """The scenario with a first attitude that is off by up to the given angles."""
    level, heading = level_deg / np.sqrt(3.0), heading_deg / np.sqrt(3.0)
    sigma = msgspec.structs.replace(
        scenario.initial.sigma, attitude_deg=(float(level), float(level), float(heading))
    )
    initial = msgspec.structs.replace(scenario.initial, sigma=sigma)
    return msgspec.structs.replace(scenario, initial=initial)


def _study(name: str, of: Voyage, fleets: Sequence[Fleet], more: Sequence[Row] = ()) -> Study:
    """The table of all filters on one voyage, and the bound."""
    rows: list[Row] = []
    for filter_name in fleets[0]:
        rows += _rows(filter_name, of, [fleet[filter_name] for fleet in fleets])
    least = bound.along_truth(of)
    return Study(
        name,
        len(fleets),
        [*rows, *more, *_bound_rows(least)],
        {
            "heading": lambda: figures.heading(fleets, least),
            "position": lambda: figures.position(fleets, least),
        },
    )


def _looked_back(of: Voyage, runs: int, workers: Workers) -> list[Row]:
    """The rows of the right-invariant smoother on the first runs: it is three times as slow."""
    passages = workers.map(look_back, (of,), min(runs, SMOOTHED_RUNS), "smoother")
    return _rows("smoothed", of, passages)


def look_back(of: Voyage, seed: int) -> Passage:
    """One run smoothed."""
    return smoothed(of, errors.draw(of, seed, attitude="uniform"))


def _rows(name: str, of: Voyage, passages: Sequence[Passage]) -> list[Row]:
    """The rows of one filter; runs that diverged are counted, not averaged.

    Until the first attitude is found innovations are not linear: NIS begins when it is.
    """
    settled_fixes = int(np.searchsorted(of.replies.t_ns, SETTLED * EPOCH_S * 1e9))
    lost = _lost(passages)
    kept = [p for p, d in zip(passages, lost, strict=True) if not d]
    none = Interval(float("nan"), float("nan"), float("nan"))
    return [
        Row(f"{name}_heading_deg", None, _heading(kept) if kept else none, "deg"),
        *(
            Row(f"{name}_{axis}_m", None, _position(kept, column) if kept else none, "m")
            for axis, column in AXES.items()
        ),
        Row(f"{name}_diverged", None, statistics.count(lost), "runs"),
        Row(f"{name}_nees", None, statistics.nees(kept, SETTLED) if kept else none, "1"),
        Row(f"{name}_nis", None, statistics.nis(kept, settled_fixes) if kept else none, "1"),
    ]


def _lost(passages: Sequence[Passage]) -> NDArray[np.bool_]:
    """(N,) which runs diverged."""
    return np.array([has_diverged(p) for p in passages])


def has_diverged(passage: Passage) -> bool:
    """Whether a run was ever lost after it should have settled."""
    error = passage.error_n[SETTLED:]
    lost = (np.abs(error[:, HEADING]) > DIVERGED_HEADING) | (
        np.linalg.norm(error[:, :3], axis=1) > DIVERGED_M
    )
    return bool(lost.any() or not np.isfinite(error).all())


def _bound_rows(least: Passage) -> list[Row]:
    """The bound of the same numbers."""
    root = np.sqrt(np.mean(least.sigma_n[SETTLED:] ** 2, axis=0))
    heading = float(np.degrees(root[HEADING]))
    return [
        Row("bound_heading_deg", None, Interval(heading, heading, heading), "deg"),
        *(
            Row(f"bound_{axis}_m", None, Interval(*[float(root[column])] * 3), "m")
            for axis, column in AXES.items()
        ),
    ]


def _gain(fleets: Sequence[Fleet], column: int) -> Interval:
    """By how many percent the RMS of tight is less than that of loose."""
    pairs = np.column_stack(
        [
            statistics.mean_square([fleet[name] for fleet in fleets], column, SETTLED)
            for name in ("right_invariant", "loose")
        ]
    )

    def percent(sample: Array) -> Array:
        tight, loose = np.moveaxis(sample.mean(axis=-2), -1, 0)
        return np.asarray(100.0 * (1.0 - np.sqrt(tight / loose)))

    return Interval(float(percent(pairs)), *statistics.resampled(pairs, percent))


def _position(passages: Sequence[Passage], column: int) -> Interval:
    """RMS of one axis (m)."""
    return statistics.rms(statistics.mean_square(passages, column, SETTLED))


def _heading(passages: Sequence[Passage]) -> Interval:
    """RMS of the heading (deg); one that is no number any more is off by half a turn."""
    squares = statistics.mean_square(passages, HEADING, SETTLED)
    radians = statistics.rms(np.where(np.isfinite(squares), squares, np.pi**2))
    return Interval(*(float(np.degrees(x)) for x in radians))
