"""Seed 002: what the Doppler of a beacon's sound is worth while there is no valid fix.

For two minutes the array has no valid fix, as behind the seed's test of the direction cosines, but
still hears the beacon at each element; then fixes come again, for who looks back. The true rates
are the slopes of the distances along the emulator's trajectory at the moments of reception; that a
surface beacon sends in step makes the rate at reception the whole truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.config import Config
from gateway.config.blocks import Beacon
from gateway.emulator.acoustics.water import Ear
from gateway.emulator.scenario import Scenario
from gateway.emulator.streams import generator
from gateway.emulator.trajectory import Trajectory
from gateway.messages import RadialRate
from gateway.nav.attitude import C_from_euler
from gateway.nav.earth import lla_to_ecef
from gateway.studies import errors, statistics, voyage
from gateway.studies.errors import Measured
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import Passage, configured, sail, smoothed
from gateway.studies.statistics import Interval, horizontal_square
from gateway.studies.table import Row, Study
from gateway.studies.voyage import EPOCH_S, Replies, Voyage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

NAME = "radial-velocity"
OUTAGE_S = (180.0, 300.0)
"""Begin and end of the time in which no fix is valid."""
_OUTAGE = slice(*(round(t / EPOCH_S) + 1 for t in OUTAGE_S))
"""Its epochs."""
_END = _OUTAGE.stop - 1
ELEMENTS_U = (
    (0.1, 0.0, 0.0),
    (0.0, 0.1, 0.0),
    (-0.1, 0.0, 0.0),
    (0.0, -0.1, 0.0),
)
"""Places of the elements in array axes (m)."""


@dataclass(frozen=True)
class Run:
    """One run's passages without and with radial rates, the same errors in all.

    The smoothed ones look back from half a minute after the outage.
    """

    without: Passage
    with_rates: Passage
    smoothed_without: Passage
    smoothed_with_rates: Passage


def run(runs: int, workers: Workers) -> Study:
    """The error at the end of the outage with one beacon and with two."""
    scenario = voyage.load(NAME)
    one_beacon = workers.map(one, (prepared(alone(scenario)),), runs, f"{NAME}, one beacon")
    two_beacons = workers.map(one, (prepared(scenario),), runs, f"{NAME}, two beacons")
    rows = [
        Row("outage_end_without_m", None, _end([r.without for r in one_beacon]), "m"),
        Row("outage_end_with_m", None, _end([r.with_rates for r in one_beacon]), "m"),
        Row("outage_end_cut", None, _cut(one_beacon), "%"),
        Row("two_beacons_without_m", None, _end([r.without for r in two_beacons]), "m"),
        Row("two_beacons_with_m", None, _end([r.with_rates for r in two_beacons]), "m"),
        Row("two_beacons_cut", None, _cut(two_beacons), "%"),
        *_looking_back("one_beacon", one_beacon),
        *_looking_back("two_beacons", two_beacons),
        *_consistency("one_beacon", [r.with_rates for r in one_beacon]),
        *_consistency("two_beacons", [r.with_rates for r in two_beacons]),
    ]
    return Study(NAME, runs, rows, {"outage": lambda: figure(one_beacon, two_beacons)})


def alone(scenario: Scenario) -> Scenario:
    """The voyage with its first beacon only."""
    return msgspec.structs.replace(scenario, beacons={"1": scenario.moored["1"]})


def prepared(scenario: Scenario) -> Voyage:
    """The voyage, with the elements of its array in the configuration."""
    made = voyage.make(scenario)
    return replace(made, config=_with_elements(made.config))


def one(of: Voyage, seed: int) -> Run:
    """One run."""
    measured = draw(of, seed)
    fixes = [fix for fix in measured.fixes if not isinstance(fix, RadialRate)]
    without = replace(measured, fixes=fixes)
    return Run(
        without=sail(of, without, configured(of.config, without)),
        with_rates=sail(of, measured, configured(of.config, measured)),
        smoothed_without=smoothed(of, without),
        smoothed_with_rates=smoothed(of, measured),
    )


def draw(of: Voyage, seed: int) -> Measured:
    """Draw the errors of a run: fixes but in the outage, rates all the time."""
    measured = errors.draw(of, seed)
    begin, end = OUTAGE_S
    fixes = [fix for fix in measured.fixes if not begin <= 1e-9 * fix.t_ns <= end]
    both = sorted([*fixes, *_rates(of, seed)], key=lambda fix: fix.t_ns)
    return replace(measured, fixes=both)


def true_rates(of: Voyage, replies: Replies) -> Array:
    """(k, elements) slope of each element's distance to the beacon at each reception (m/s).

    The emulator's difference of the distances themselves, exact to 1e-6 m/s: no velocity, lever arm
    or turn rate has a formula there.
    """
    _, model = of.usbl
    trajectory = Trajectory(of.scenario.trajectory, of.scenario.duration_s)
    C_bu = C_from_euler(*np.radians(model.mounting_deg))
    places_b = np.array(model.lever_arm_m) + np.array(ELEMENTS_U) @ C_bu.T
    beacons_e = np.array([_place(of.scenario.moored[name]) for name in replies.beacon])
    ears = [Ear(trajectory, l_b, of.scenario.sound_speed_m_s) for l_b in places_b]
    t = np.asarray(1e-9 * replies.t_ns, np.float64)
    return np.stack([ear.range_rate(t, beacons_e, np.zeros(3)) for ear in ears], axis=-1)


def figure(one_beacon: Sequence[Run], two_beacons: Sequence[Run]) -> "Figure":
    """RMS horizontal error over time; the seed publishes no figure to compare with."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = drawn.add_subplot()
    for runs, beacons, colour in (
        (one_beacon, "one beacon", "C0"),
        (two_beacons, "two beacons", "C1"),
    ):
        for label, line, passages in (
            ("without", "--", [r.without for r in runs]),
            ("with radial velocity", "-", [r.with_rates for r in runs]),
            ("with radial velocity, smoothed", ":", [r.smoothed_with_rates for r in runs]),
        ):
            rms = np.sqrt(np.mean([horizontal_square(p) for p in passages], axis=0))
            t = EPOCH_S * np.arange(len(rms))
            axes.plot(t, rms, line, color=colour, label=f"{beacons}, {label}")
    axes.axvspan(*OUTAGE_S, color="k", alpha=0.07, label="no valid fix")
    axes.set(xlabel="time (s)", ylabel="RMS horizontal position error (m)", yscale="log")
    axes.set_title("seed 002 claims a gain in words only: no published numbers", fontsize="small")
    axes.set_xlim(0.0, t[-1])
    axes.grid(which="both", alpha=0.3)
    axes.legend(fontsize="small")
    return drawn


def _with_elements(config: Config) -> Config:
    devices = {
        name: msgspec.structs.replace(device, elements_m=ELEMENTS_U)
        for name, device in config.usbl.items()
    }
    return msgspec.structs.replace(config, devices=config.devices | devices)


def _rates(of: Voyage, seed: int) -> list[RadialRate]:
    """The noisy rates of all receptions."""
    name, model = of.usbl
    rates = true_rates(of, of.replies)
    white = generator(seed, name, "rates").standard_normal(rates.shape)
    rates = rates + model.noise.range_rate_m_s * white
    return [
        RadialRate(int(t), name, beacon, tuple(row))
        for t, beacon, row in zip(of.replies.t_ns, of.replies.beacon, rates.tolist(), strict=True)
    ]


def _place(beacon: Beacon) -> Array:
    return lla_to_ecef(np.radians(beacon.lat_deg), np.radians(beacon.lon_deg), beacon.height_m)


def _end(passages: Sequence[Passage]) -> Interval:
    """RMS horizontal error at the end of the outage."""
    return statistics.rms(np.array([horizontal_square(p)[_END] for p in passages]))


def _cut(runs: Sequence[Run]) -> Interval:
    """What part of the error at the end of the outage the rates take away (%)."""
    pairs = np.array(
        [[horizontal_square(r.without)[_END], horizontal_square(r.with_rates)[_END]] for r in runs]
    )

    def cut(sample: Array) -> Array:
        mean: Array = sample.mean(axis=-2)
        return 100.0 * (1.0 - np.sqrt(mean[..., 1] / mean[..., 0]))

    return Interval(float(cut(pairs)), *statistics.resampled(pairs, cut))


def _looking_back(case: str, runs: Sequence[Run]) -> list[Row]:
    """RMS horizontal error over the outage, as the filter went and looked back upon."""
    ways = {
        "filtered_without": [r.without for r in runs],
        "smoothed_without": [r.smoothed_without for r in runs],
        "filtered_with": [r.with_rates for r in runs],
        "smoothed_with": [r.smoothed_with_rates for r in runs],
    }
    return [
        *(
            Row(f"{case}_outage_{way}_rms_m", None, _outage(passages), "m")
            for way, passages in ways.items()
        ),
        Row(f"{case}_smoothed_nees", None, statistics.nees(ways["smoothed_with"], 0), "1"),
    ]


def _outage(passages: Sequence[Passage]) -> Interval:
    """RMS horizontal error over the outage."""
    return statistics.rms(np.array([horizontal_square(p)[_OUTAGE].mean() for p in passages]))


def _consistency(case: str, passages: Sequence[Passage]) -> list[Row]:
    """NEES and NIS over the whole voyage."""
    return [
        Row(f"{case}_nees", None, statistics.nees(passages, 0), "1"),
        Row(f"{case}_nis", None, statistics.nis(passages), "1"),
    ]
