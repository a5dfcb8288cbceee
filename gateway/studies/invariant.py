"""Seed 004 (Guo Yu et al.), tables 2 and 3: error definitions and couplings side by side."""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.studies import bound, errors, figures, statistics, voyage
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import DOWN, EAST, HEADING, NORTH, Passage, configured, sail
from gateway.studies.statistics import Interval
from gateway.studies.table import Row, Study
from gateway.studies.voyage import EPOCH_S, Voyage

Array = NDArray[np.float64]

SCENARIO = "invariant"
FILTERS = {
    "additive": {"error": "additive"},
    "left_invariant": {"error": "left_invariant"},
    "right_invariant": {"error": "right_invariant"},
    "loose": {"error": "right_invariant", "coupling": "loose"},
}
"""The seed's TKF, LIETKF, RIETKF and RIELKF."""

SETTLED = round(400.0 / EPOCH_S)
"""First epoch that counts: the tables are of the time after 400 s."""

DIVERGED_HEADING, DIVERGED_M = np.radians(5.0), 50.0
"""A run that is once further off after `SETTLED` has diverged."""

Fleet = dict[str, Passage]
"""One run's passage by the name of the filter."""


def run_small(runs: int, workers: Workers) -> Study:
    """Errors of the first attitude up to 0.2 deg of level and 1 deg of heading."""
    return _study("invariant-small", _voyage(0.2, 1.0), runs, workers)


def run_large(runs: int, workers: Workers) -> Study:
    """Up to 10 deg and 60 deg; and once more with little to observe."""
    large = _voyage(10.0, 60.0)
    study = _study("invariant-large", large, runs, workers)
    fleets = workers.map(one, (weak(large),), runs, "invariant-large, one beacon")
    study.rows.extend(
        Row(f"weak_{name}_heading_deg", None, _heading([f[name] for f in fleets]), "deg")
        for name in FILTERS
    )
    return study


def run_semi(runs: int, workers: Workers) -> Study:
    """Up to 5 deg and 30 deg: tight against loose."""
    return _study("invariant-semi", _voyage(5.0, 30.0), runs, workers)


def one(of: Voyage, seed: int) -> Fleet:
    """All filters over one run."""
    measured = errors.draw(of, seed, attitude="uniform")
    return {
        name: sail(of, measured, configured(of.config, measured, **choices))
        for name, choices in FILTERS.items()
    }


def weak(of: Voyage) -> Voyage:
    """One beacon, and a first state that is 100 m and 1 m/s off."""
    scenario = of.scenario
    sigma = msgspec.structs.replace(
        scenario.initial.sigma, position_m=(100.0, 100.0, 100.0), velocity_m_s=1.0
    )
    return voyage.make(
        msgspec.structs.replace(
            scenario,
            beacons={"1": scenario.beacons["1"]},
            initial=msgspec.structs.replace(scenario.initial, sigma=sigma),
        )
    )


def _voyage(level_deg: float, heading_deg: float) -> Voyage:
    """The seed's voyage with a first attitude that is off by up to the given angles."""
    scenario = voyage.load(SCENARIO)
    level, heading = level_deg / np.sqrt(3.0), heading_deg / np.sqrt(3.0)
    sigma = msgspec.structs.replace(
        scenario.initial.sigma, attitude_deg=(float(level), float(level), float(heading))
    )
    initial = msgspec.structs.replace(scenario.initial, sigma=sigma)
    return voyage.make(msgspec.structs.replace(scenario, initial=initial))


def _study(name: str, of: Voyage, runs: int, workers: Workers) -> Study:
    """The table of all filters on one voyage."""
    fleets = workers.map(one, (of,), runs, name)
    rows: list[Row] = []
    for filter_name in FILTERS:
        rows += _rows(filter_name, [fleet[filter_name] for fleet in fleets])
    least = bound.along_truth(of)
    return Study(
        name,
        runs,
        rows,
        {
            "heading": lambda: figures.heading(fleets, least),
            "position": lambda: figures.position(fleets, least),
        },
    )


def _rows(name: str, passages: Sequence[Passage]) -> list[Row]:
    """The rows of one filter; runs that diverged are counted, not averaged."""
    lost = np.array([has_diverged(p) for p in passages])
    kept = [p for p, d in zip(passages, lost, strict=True) if not d]
    none = Interval(float("nan"), float("nan"), float("nan"))
    position = [
        statistics.rms(statistics.mean_square(kept, axis, SETTLED)) if kept else none
        for axis in (NORTH, EAST, DOWN)
    ]
    return [
        Row(f"{name}_heading_deg", None, _heading(kept) if kept else none, "deg"),
        *(
            Row(f"{name}_{axis}_m", None, interval, "m")
            for axis, interval in zip(("north", "east", "down"), position, strict=True)
        ),
        Row(f"{name}_diverged", None, statistics.count(lost), "runs"),
        Row(f"{name}_nees", None, statistics.nees(kept, SETTLED) if kept else none, "1"),
    ]


def has_diverged(passage: Passage) -> bool:
    """Whether a run was ever lost after it should have settled."""
    error = passage.error_n[SETTLED:]
    lost = (np.abs(error[:, HEADING]) > DIVERGED_HEADING) | (
        np.linalg.norm(error[:, :3], axis=1) > DIVERGED_M
    )
    return bool(lost.any() or not np.isfinite(error).all())


def _heading(passages: Sequence[Passage]) -> Interval:
    """RMS of the heading (deg)."""
    radians = statistics.rms(statistics.mean_square(passages, HEADING, SETTLED))
    return Interval(*(float(np.degrees(x)) for x in radians))
