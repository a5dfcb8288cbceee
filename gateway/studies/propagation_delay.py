"""Seed 001, figure 3: ranges of a long baseline with and without the vehicle's motion meanwhile.

A ping is answered by four beacons, and their ranges are known when the last reply is in. The
compensated filter is the gateway's own: each range is told late and takes its place in the history,
with the positions at its ping and at its reply. The uncompensated one is the paper's baseline: each
range is taken as the distance at the moment of the last reply.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.emulator.scenario import Scenario, Waypoints
from gateway.emulator.sensors import ImuErrorSource
from gateway.emulator.streams import generator
from gateway.fusion.filter import Filter
from gateway.fusion.state import N_FULL
from gateway.messages import BeaconRange, Depth, Fix
from gateway.nav.earth import ecef_to_lla
from gateway.studies import errors, statistics, voyage
from gateway.studies.errors import Measured
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import Passage, configured, sail, smoothed
from gateway.studies.statistics import Interval, horizontal_square
from gateway.studies.table import Row, Study
from gateway.studies.voyage import EPOCH_S, Times, Voyage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

NAME = "propagation-delay"
SETTLED = round(100.0 / EPOCH_S)
"""First epoch that counts."""
STATED = (-200.0, 200.0, 0.0, 2.0 / 60.0, 2.0 / 60.0, 1.0 / 60.0)
"""The seed's first errors: north, east, down (m), roll, pitch, heading (deg)."""
FAST_M_S, FAST_SCALE = 5.0, 2.0
"""The second case: faster, with all distances doubled; a reply then comes after the next ping."""
DEPTH_SIGMA_M = 0.1
_HISTORY_S = 20.0
"""Longer than from the first to the last reply of a ping."""


@dataclass(frozen=True)
class Run:
    """One run's passages; ``consistent`` has drawn first errors, the others the stated ones."""

    compensated: Passage
    uncompensated: Passage
    consistent: Passage
    smoothed: Passage
    smoothed_consistent: Passage


def run(runs: int, workers: Workers) -> Study:
    """Reproduce the figure, and once more faster and further away."""
    scenario = voyage.load(NAME)
    slow = workers.map(one, (prepared(scenario),), runs, NAME)
    fast = workers.map(one, (prepared(faster(scenario)),), runs, f"{NAME}, fast")
    compensated = [r.compensated for r in slow]
    consistent = [r.consistent for r in slow]
    rows = [
        Row("compensated_rms_m", 10.0, _rms(compensated), "m"),
        Row("compensated_max_m", 10.0, _largest(compensated), "m"),
        Row("uncompensated_rms_m", 30.0, _rms([r.uncompensated for r in slow]), "m"),
        Row("uncompensated_max_m", 30.0, _largest([r.uncompensated for r in slow]), "m"),
        Row("fast_compensated_rms_m", None, _rms([r.compensated for r in fast]), "m"),
        Row("fast_compensated_max_m", None, _largest([r.compensated for r in fast]), "m"),
        Row("fast_uncompensated_rms_m", None, _rms([r.uncompensated for r in fast]), "m"),
        Row("fast_uncompensated_max_m", None, _largest([r.uncompensated for r in fast]), "m"),
        Row("smoothed_rms_m", None, _rms([r.smoothed for r in slow]), "m"),
        Row(
            "smoothed_nees",
            None,
            statistics.nees([r.smoothed_consistent for r in slow], SETTLED),
            "1",
        ),
        Row("nees", None, statistics.nees(consistent, SETTLED), "1"),
        Row("nis", None, statistics.nis(consistent, settled_fixes(consistent[0])), "1"),
    ]
    return Study(NAME, runs, rows, {"figure-3": lambda: figure(slow)})


def prepared(scenario: Scenario) -> Voyage:
    """The voyage, with a history that reaches from the last reply back to the first.

    The error is the additive one, as the paper's is: the first position is 200 m off in a direction
    that the attitude knows nothing of, and the depth is known a thousand times better. The
    right-invariant error ties the three together.
    """
    made = voyage.make(scenario)
    choice = msgspec.structs.replace(made.config.filter, history_s=_HISTORY_S, error="additive")
    return replace(made, config=msgspec.structs.replace(made.config, filter=choice))


def faster(scenario: Scenario) -> Scenario:
    """5 m/s with everything twice as far from beacon 1."""
    first = scenario.moored["1"]

    def away(lat_deg: float, lon_deg: float) -> dict[str, float]:
        return {
            "lat_deg": first.lat_deg + FAST_SCALE * (lat_deg - first.lat_deg),
            "lon_deg": first.lon_deg + FAST_SCALE * (lon_deg - first.lon_deg),
        }

    track = scenario.trajectory
    assert not isinstance(track, Waypoints)
    return msgspec.structs.replace(
        scenario,
        trajectory=msgspec.structs.replace(
            track, speed_m_s=FAST_M_S, **away(track.lat_deg, track.lon_deg)
        ),
        beacons={
            n: msgspec.structs.replace(b, **away(b.lat_deg, b.lon_deg))
            for n, b in scenario.moored.items()
        },
    )


def one(of: Voyage, seed: int) -> Run:
    """One run."""
    drawn = draw(of, seed)
    measured = stated(of, drawn, seed)
    return Run(
        compensated=sail(of, measured, configured(of.config, measured)),
        uncompensated=sail(of, *baseline(of, measured)),
        consistent=sail(of, drawn, configured(of.config, drawn)),
        smoothed=smoothed(of, measured),
        smoothed_consistent=smoothed(of, drawn),
    )


def draw(of: Voyage, seed: int) -> Measured:
    """Draw the errors of a run: ranges told when the last of a ping is in, and depths."""
    name, imu = of.imu
    source = ImuErrorSource(imu, seed, name)
    constants = np.zeros(N_FULL - 9)
    constants[:6] = source.bias
    rows = of.rows.copy()
    rows[:, 1:7] += source.next(len(rows))
    ranges, told = _ranges(of, seed)
    depths = _depths(of, seed)
    return Measured(
        rows,
        [*depths, *ranges],
        errors.first_state(of, seed),
        constants,
        np.concatenate([np.zeros(len(depths), np.int64), told]),
    )


def stated(of: Voyage, measured: Measured, seed: int) -> Measured:
    """The same run with the seed's first errors, and a velocity's that is drawn."""
    sigma = of.scenario.initial.sigma.velocity_m_s
    velocity = sigma * generator(seed, "initial").standard_normal(6)[3:]
    error = np.array([*STATED[:3], *velocity, *STATED[3:]])
    return replace(measured, initial=errors.displaced(of, error))


def baseline(of: Voyage, measured: Measured) -> tuple[Measured, Filter]:
    """The run and the filter that know nothing of the motion: no ping, no gate, one moment."""
    assert measured.told_ns is not None
    fixes = [
        msgspec.structs.replace(fix, t_ns=told) if isinstance(fix, BeaconRange) else fix
        for fix, told in zip(measured.fixes, measured.told_ns.tolist(), strict=True)
    ]
    one_way = {n: msgspec.structs.replace(b, travel="one_way") for n, b in of.config.moored.items()}
    config = msgspec.structs.replace(of.config, beacons=one_way)
    engine = configured(config, measured)
    engine.model = replace(engine.model, gate=1.0)
    return replace(measured, fixes=fixes), engine


def settled_fixes(passage: Passage) -> int:
    """How many of the fixes of a passage come before `SETTLED`, by their even spacing."""
    return len(passage.nis) * SETTLED // (len(passage.error_n) - 1)


def figure(runs: Sequence[Run]) -> "Figure":
    """Horizontal error over time with the two claims of the paper."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = drawn.add_subplot()
    for label, colour, claim, passages in (
        ("uncompensated", "C3", "published: over 30 m", [r.uncompensated for r in runs]),
        ("compensated", "C0", "published: within 10 m", [r.compensated for r in runs]),
    ):
        squares = np.array([horizontal_square(p) for p in passages])
        t = EPOCH_S * np.arange(squares.shape[1])
        rms, largest = np.sqrt(squares.mean(axis=0)), np.sqrt(squares.max(axis=0))
        axes.plot(t, rms, colour, label=f"{label}, RMS of {len(runs)} runs")
        axes.fill_between(t, 0.0, largest, color=colour, alpha=0.15, label=f"{label}, largest")
        level = 30.0 if label == "uncompensated" else 10.0
        axes.axhline(level, color=colour, ls="--", lw=1.0, label=claim)
    axes.set(ylim=(0.0, 40.0), xlabel="time (s)", ylabel="horizontal position error (m)")
    axes.set_xlim(0.0, t[-1])
    axes.grid(alpha=0.3)
    axes.legend(ncols=2, fontsize="small")
    return drawn


def _ranges(of: Voyage, seed: int) -> tuple[list[BeaconRange], Times]:
    """The noisy ranges of all pings, and when the last reply of each one's ping is in."""
    name, model = of.usbl
    replies = of.replies
    noise = generator(seed, name, "noise").standard_normal(len(replies.beacon))
    ranges = replies.slant_range + model.noise.range_m * noise
    last = {ping: int(replies.t_ns[replies.t_ping_ns == ping].max()) for ping in replies.t_ping_ns}
    told = np.array([last[ping] for ping in replies.t_ping_ns], np.int64)
    columns = (replies.t_ns, replies.beacon, ranges, replies.t_ping_ns)
    fixes = [
        BeaconRange(int(t), name, beacon, float(r), int(ping))
        for t, beacon, r, ping in zip(*columns, strict=True)
    ]
    return fixes, told


def _depths(of: Voyage, seed: int) -> list[Fix]:
    """A noisy height at every epoch but the first."""
    noise = generator(seed, "depth0", "noise").standard_normal(len(of.truth.t_s))
    heights = ecef_to_lla(of.truth.r_e)[2] + DEPTH_SIGMA_M * noise
    return [
        Depth(round(1e9 * t), "depth0", float(h), DEPTH_SIGMA_M)
        for t, h in zip(of.truth.t_s[1:], heights[1:], strict=True)
    ]


def _rms(passages: Sequence[Passage]) -> Interval:
    return statistics.rms(statistics.horizontal(passages, SETTLED))


def _largest(passages: Sequence[Passage]) -> Interval:
    """The largest horizontal error of all runs, bounds by resampling the runs."""
    per_run = np.sqrt([horizontal_square(p)[SETTLED:].max() for p in passages])
    return Interval(float(per_run.max()), *statistics.resampled(per_run, lambda s: s.max(axis=-1)))
