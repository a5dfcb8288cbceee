"""What robust weights and learnt noise cost where all is as declared, and what they save elsewhere.

Seeded runs of seed 000's circle: ``pytest -m slow -s tests/consistency/test_robust.py`` prints the
figures of docs/studies.md.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import msgspec
import numpy as np
import pytest

from gateway.config import Config
from gateway.emulator.streams import generator
from gateway.fusion.robust import noise_key
from gateway.messages import UsblFix
from gateway.studies import errors, statistics, voyage
from gateway.studies.errors import Measured
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import Passage, configured, sail
from gateway.studies.relative_measurement import NAME, SETTLED
from gateway.studies.statistics import Interval
from gateway.studies.voyage import Voyage
from tests.gateway.test_studies import short

RUNS = 25
OUTLIER = 5.0
"""Noise of an outlier over the declared one: what the gate often lets through."""
WIDE = 1.0 - 1e-9
"""A gate that lets nearly everything through."""


class Case(NamedTuple):
    """A filter on data."""

    robust: str = "none"
    adaptive: bool = False
    outliers: float = 0.0
    """Share of the fixes."""
    declared: float = 1.0
    """Noise of the angles that the filter is told, over the true one."""
    gate: float = 0.999
    learnt_before: bool = False
    """Whether the filter begins with the noise that it would learn."""


@dataclass(frozen=True)
class Score:
    """Horizontal RMS (m), NEES and NIS a degree of freedom, each with its bounds."""

    rms: Interval
    nees: Interval
    nis: Interval


@cache
def circle(duration_s: float) -> Voyage:
    return voyage.make(short(NAME, duration_s))


def score(case: Case, runs: int, duration_s: float, jobs: int = 1) -> Score:
    passages = Workers(jobs).map(one, (circle(duration_s), case), runs, str(case))
    return Score(
        statistics.rms(statistics.horizontal(passages, SETTLED)),
        statistics.nees(passages, SETTLED),
        statistics.nis(passages),
    )


def one(of: Voyage, case: Case, seed: int) -> Passage:
    measured = with_outliers(of, errors.draw(of, seed), case.outliers, seed)
    config = declared(of, case.declared)
    choices = {"adaptive_noise": case.adaptive, "innovation_gate": case.gate}
    engine = configured(config, measured, robust=case.robust, **choices)
    engine.model = replace(engine.model, echoes=0.0)  # the weights alone
    if case.learnt_before:
        device, _ = of.usbl
        for name in ("elevation_deg", "bearing_deg"):
            engine.memory.noise[noise_key(device, name)] = case.declared**-2
    return sail(of, measured, engine)


def with_outliers(of: Voyage, measured: Measured, share: float, seed: int) -> Measured:
    """The run with a share of its fixes `OUTLIER` times as noisy."""
    _, model = of.usbl
    rng = generator(seed, "outliers")
    more = np.sqrt(OUTLIER**2 - 1.0)
    sigma = more * np.array(
        [
            np.radians(model.noise.elevation_deg),
            np.radians(model.noise.bearing_deg),
            model.noise.range_m,
        ]
    )
    fixes = []
    for fix in measured.fixes:
        assert isinstance(fix, UsblFix)
        e, b, r = sigma * rng.standard_normal(3) * (rng.random() < share)
        rows = {"elevation": fix.elevation + e, "bearing": fix.bearing + b}
        fixes.append(msgspec.structs.replace(fix, slant_range=fix.slant_range + r, **rows))
    return replace(measured, fixes=fixes)


def declared(of: Voyage, factor: float) -> Config:
    """The configuration with another noise of the angles."""
    name, _ = of.usbl
    device = of.config.usbl[name]
    noise = msgspec.structs.replace(
        device.noise,
        bearing_deg=factor * device.noise.bearing_deg,
        elevation_deg=factor * device.noise.elevation_deg,
    )
    devices = of.config.devices | {name: msgspec.structs.replace(device, noise=noise)}
    return msgspec.structs.replace(of.config, devices=devices)


def inside(interval: Interval) -> bool:
    return interval.low < interval.value < interval.high


def test_learnt_noise_mends_a_wrong_declaration() -> None:
    told, learnt = (score(Case(adaptive=a, declared=0.4), 3, 300.0) for a in (False, True))
    assert told.nees.value > told.nees.high
    assert learnt.nees.value < 0.7 * told.nees.value
    assert learnt.nis.value < 0.5 * told.nis.value


@cache
def whole(case: Case) -> Score:
    found = score(case, RUNS, 1000.0, jobs=-1)
    shown = (f"{i.value:.3f} ({i.low:.3f} .. {i.high:.3f})" for i in (found.rms, found.nees))
    print(*case, *shown, f"{found.nis.value:.3f}", sep=" | ")
    return found


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("robust", "cost"), [("huber", 1.02), ("student_t", 1.08)])
def test_a_weight_costs_little_where_all_is_as_declared(robust: str, cost: float) -> None:
    plain, weighed = whole(Case()), whole(Case(robust))
    assert inside(plain.nees) and inside(plain.nis)
    assert inside(weighed.nees) and inside(weighed.nis)
    assert weighed.rms.value < cost * plain.rms.value


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("robust", ["none", "huber", "student_t"])
@pytest.mark.parametrize("share", [0.05, 0.1])
def test_behind_the_gate_outliers_are_borne(robust: str, share: float) -> None:
    assert inside(whole(Case(robust, outliers=share)).nees)
    assert whole(Case(robust, outliers=share)).rms.value < 1.15 * whole(Case()).rms.value


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("robust", ["huber", "student_t"])
def test_a_weight_does_what_a_wide_gate_does_not(robust: str) -> None:
    plain = whole(Case(outliers=0.1, gate=WIDE))
    weighed = whole(Case(robust, outliers=0.1, gate=WIDE))
    assert inside(weighed.nees)
    assert weighed.rms.value < 0.97 * plain.rms.value
    assert whole(Case(robust, outliers=0.05, gate=WIDE)).nees.value < plain.nees.high


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_learnt_noise_costs_nothing_where_all_is_as_declared() -> None:
    assert inside(whole(Case(adaptive=True)).nees)
    assert whole(Case(adaptive=True)).rms.value < 1.02 * whole(Case()).rms.value


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_noise_declared_too_large_is_mended() -> None:
    told, learnt = (whole(Case(adaptive=a, declared=2.0)) for a in (False, True))
    assert inside(learnt.nees)
    assert learnt.rms.value < told.rms.value
    assert abs(learnt.nis.value - 1.0) < 0.4 * abs(told.nis.value - 1.0)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_noise_declared_too_small_is_mended_but_for_what_the_first_fixes_claimed() -> None:
    """They leave the constants surer than they may be, and no later fix takes that back."""
    told, learnt = (whole(Case(adaptive=a, declared=0.5)) for a in (False, True))
    assert learnt.rms.value < 0.9 * told.rms.value
    assert learnt.nees.high < learnt.nees.value < 0.7 * told.nees.value
    assert abs(learnt.nis.value - 1.0) < 0.4 * abs(told.nis.value - 1.0)
    assert inside(whole(Case(adaptive=True, declared=0.5, learnt_before=True)).nees)
