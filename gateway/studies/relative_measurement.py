"""Seed 000, table 2: raw angles and range beside the USBL alone and the inertial alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.config.blocks import Config
from gateway.config.devices import UsblDevice, UsblPrior
from gateway.emulator.trajectory import Trajectory
from gateway.messages import UsblFix
from gateway.nav.attitude import C_from_euler
from gateway.nav.lie import exp_so3
from gateway.studies import bound, errors, figures, statistics, voyage
from gateway.studies.errors import Measured
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import EAST, NORTH, Choices, Passage, configured, sail, smoothed
from gateway.studies.statistics import Interval
from gateway.studies.table import Row, Study
from gateway.studies.voyage import EPOCH_S, Voyage

Array = NDArray[np.float64]

NAME = "relative-measurement"
SETTLED = round(200.0 / EPOCH_S)
"""First epoch that counts for the aided filters."""
_LEVEL = [NORTH, EAST]


LOOSE: Choices = {"coupling": "loose"}
TRADITIONAL: Choices = {"coupling": "loose", "loose_noise": "fixed", "loose_sigma_m": 1.3}
"""What 1 deg and 0.5 % are worth at 87 m, the same in all directions."""


@dataclass(frozen=True)
class Run:
    """What one run gave.

    Attributes
    ----------
    inertial, tight, loose
        Passages without fixes, with the raw ones, and with positions made of them.
    traditional
        Positions of a fixed noise, and no states for the array's errors.
    usbl
        (k, 3) errors in NED (m) of single fixes.
    mistuned
        The tight filter that is told half the noise of the angles.
    smoothed
        The tight one, looked back upon.
    """

    inertial: Passage
    tight: Passage
    loose: Passage
    traditional: Passage
    usbl: Array
    mistuned: Passage
    smoothed: Passage


def run(runs: int, workers: Workers) -> Study:
    """Reproduce the table with white errors, and with constant and white ones."""
    both = voyage.make(voyage.load(NAME))
    of_white = workers.map(tight, (only_white(both),), runs, f"{NAME}, white errors")
    of_both = workers.map(one, (both,), runs, f"{NAME}, constant and white errors")
    of_tight = [r.tight for r in of_both]
    mistuned = [r.mistuned for r in of_both]
    inertial = statistics.horizontal([r.inertial for r in of_both], 0)
    usbl = np.array([np.mean(np.sum(r.usbl[:, _LEVEL] ** 2, axis=1)) for r in of_both])
    attained = _horizontal(of_tight)
    least = bound.along_truth(both)
    least_m = float(np.sqrt(np.mean(np.sum(least.sigma_n[SETTLED:, _LEVEL] ** 2, axis=1))))
    rows = [
        Row("inertial_horizontal_rms_m", 916.5, statistics.rms(inertial), "m"),
        Row("usbl_horizontal_rms_m", 3.44, statistics.rms(usbl), "m"),
        Row("tight_horizontal_rms_white_m", 1.53, _horizontal(of_white), "m"),
        Row("tight_horizontal_rms_both_m", 1.53, attained, "m"),
        Row("loose_horizontal_rms_both_m", None, _horizontal([r.loose for r in of_both]), "m"),
        Row(
            "traditional_horizontal_rms_both_m",
            None,
            _horizontal([r.traditional for r in of_both]),
            "m",
        ),
        Row("bound_ratio", None, Interval(*(x / least_m for x in attained)), "1"),
        Row("nees", None, statistics.nees(of_tight, SETTLED), "1"),
        Row("nis", None, statistics.nis(of_tight), "1"),
        Row(
            "smoothed_horizontal_rms_both_m", None, _horizontal([r.smoothed for r in of_both]), "m"
        ),
        Row("smoothed_nees", None, statistics.nees([r.smoothed for r in of_both], SETTLED), "1"),
        Row("mistuned_nees", None, statistics.nees(mistuned, SETTLED), "1"),
        Row("mistuned_nis", None, statistics.nis(mistuned), "1"),
    ]
    drawn = {"inertial": [r.inertial for r in of_both], "tight": of_tight}
    drawn["loose"] = [r.loose for r in of_both]
    drawn["traditional"] = [r.traditional for r in of_both]
    return Study(NAME, runs, rows, {"horizontal": lambda: figures.horizontal(drawn, least)})


def only_white(both: Voyage) -> Voyage:
    """The same voyage without constant errors of angles and range; the mounting's stays."""
    name, model = both.usbl
    white = msgspec.structs.replace(
        model.prior, bearing_deg=0.0, elevation_deg=0.0, range_scale=0.0
    )
    devices = both.scenario.devices | {name: msgspec.structs.replace(model, prior=white)}
    return voyage.refit(both, msgspec.structs.replace(both.scenario, devices=devices))


def tight(of: Voyage, seed: int) -> Passage:
    """One run of the tight filter alone."""
    measured = errors.draw(of, seed)
    return sail(of, measured, configured(of.config, measured))


def one(of: Voyage, seed: int) -> Run:
    """One run of all."""
    measured = errors.draw(of, seed)
    inertial = sail(of, measured, configured(of.config, measured), aided=False)
    return Run(
        inertial=inertial,
        tight=sail(of, measured, configured(of.config, measured)),
        loose=sail(of, measured, configured(of.config, measured, **LOOSE)),
        traditional=sail(
            of, measured, configured(without_array_states(of.config), measured, **TRADITIONAL)
        ),
        usbl=usbl_alone(of, measured, inertial),
        mistuned=sail(of, measured, configured(with_half_the_noise(of.config), measured)),
        smoothed=smoothed(of, measured),
    )


def without_array_states(config: Config) -> Config:
    """The configuration that takes the array's constant errors as zero."""
    return _with_array(config, lambda device: {"prior": UsblPrior()})


def with_half_the_noise(config: Config) -> Config:
    """The configuration that takes the angles for twice as good as they are."""

    def halved(device: UsblDevice) -> dict[str, Any]:
        noise = device.noise
        return {
            "noise": msgspec.structs.replace(
                noise, bearing_deg=noise.bearing_deg / 2.0, elevation_deg=noise.elevation_deg / 2.0
            )
        }

    return _with_array(config, halved)


def _with_array(config: Config, change: Callable[[UsblDevice], dict[str, Any]]) -> Config:
    """The configuration with something of its array changed."""
    arrays = {
        name: msgspec.structs.replace(device, **change(device))
        for name, device in config.usbl.items()
    }
    return msgspec.structs.replace(config, devices=config.devices | arrays)


def usbl_alone(of: Voyage, measured: Measured, inertial: Passage) -> Array:
    """(k, 3) NED errors (m) of positions by single fixes turned with the inertial attitude.

    The beacon's position less the measured vector, seed 000 eq. (2); the nearest epoch's attitude
    error stands for the one at the fix.
    """
    _, model = of.usbl
    C_bu = C_from_euler(*np.radians(model.mounting_deg))
    t = np.asarray(1e-9 * of.replies.t_ns, np.float64)
    pose = Trajectory(of.scenario.trajectory, of.scenario.duration_s).pose(t)
    epochs = np.rint(t / EPOCH_S).astype(int)
    out = np.empty((len(t), 3))
    for k, fix in enumerate(measured.fixes):
        assert isinstance(fix, UsblFix)
        C_nu = of.truth.C_en[epochs[k]].T @ pose.C_eb[k] @ C_bu
        seen = exp_so3(inertial.error_n[epochs[k], 6:9]) @ C_nu @ vector(fix)
        out[k] = of.replies.slant_range[k] * (C_nu @ of.replies.direction_u[k]) - seen
    return out


def vector(fix: UsblFix) -> Array:
    """(3,) vector to the beacon in array axes (m), seed 000 eq. (1)."""
    assert fix.elevation is not None and fix.bearing is not None and fix.slant_range is not None
    level = fix.slant_range * np.cos(fix.elevation)
    return np.array(
        [
            level * np.cos(fix.bearing),
            level * np.sin(fix.bearing),
            -fix.slant_range * np.sin(fix.elevation),
        ]
    )


def _horizontal(passages: Sequence[Passage]) -> Interval:
    """Horizontal RMS (m) of the settled filters."""
    return statistics.rms(statistics.horizontal(passages, SETTLED))
