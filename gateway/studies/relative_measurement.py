"""Seed 000, table 2: raw angles and range beside the USBL alone and the inertial alone."""

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.emulator.trajectory import Trajectory
from gateway.messages import UsblFix
from gateway.nav.attitude import C_from_euler
from gateway.nav.lie import exp_so3
from gateway.studies import bound, errors, statistics, voyage
from gateway.studies.errors import Measured
from gateway.studies.montecarlo import Workers
from gateway.studies.passage import EAST, NORTH, Passage, configured, sail
from gateway.studies.statistics import Interval
from gateway.studies.table import Row, Study
from gateway.studies.voyage import EPOCH_S, Voyage

Array = NDArray[np.float64]

NAME = "relative-measurement"
SETTLED = round(200.0 / EPOCH_S)
"""First epoch that counts for the aided filters."""
_LEVEL = [NORTH, EAST]


@dataclass(frozen=True)
class Run:
    """What one run gave: three ways to navigate, ``usbl`` as (k, 3) errors in NED (m)."""

    inertial: Passage
    usbl: Array
    tight: Passage


def run(runs: int, workers: Workers) -> Study:
    """Reproduce the table with white errors, and with constant and white ones."""
    both = voyage.make(voyage.load(NAME))
    of_white = workers.map(one, (only_white(both),), runs, f"{NAME}, white errors")
    of_both = workers.map(one, (both,), runs, f"{NAME}, constant and white errors")
    tight = [r.tight for r in of_both]
    inertial = statistics.horizontal([r.inertial for r in of_both], 0)
    usbl = np.array([np.mean(np.sum(r.usbl[:, _LEVEL] ** 2, axis=1)) for r in of_both])
    white = statistics.horizontal([r.tight for r in of_white], SETTLED)
    attained = statistics.rms(statistics.horizontal(tight, SETTLED))
    least = least_horizontal(both)
    rows = [
        Row("inertial_horizontal_rms_m", 916.5, statistics.rms(inertial), "m"),
        Row("usbl_horizontal_rms_m", 3.44, statistics.rms(usbl), "m"),
        Row("tight_horizontal_rms_white_m", 1.53, statistics.rms(white), "m"),
        Row("tight_horizontal_rms_both_m", 1.53, attained, "m"),
        Row("bound_ratio", None, Interval(*(x / least for x in attained)), "1"),
        Row("nees", None, statistics.nees(tight, SETTLED), "1"),
        Row("nis", None, statistics.nis(tight), "1"),
    ]
    return Study(NAME, runs, rows)


def only_white(both: Voyage) -> Voyage:
    """The same voyage without constant errors of angles and range; the mounting's stays."""
    name, model = both.usbl
    white = msgspec.structs.replace(
        model.prior, bearing_deg=0.0, elevation_deg=0.0, range_scale=0.0
    )
    devices = both.scenario.devices | {name: msgspec.structs.replace(model, prior=white)}
    return voyage.make(msgspec.structs.replace(both.scenario, devices=devices))


def one(of: Voyage, seed: int) -> Run:
    """One run."""
    measured = errors.draw(of, seed)
    inertial = sail(of, measured, configured(of.config, measured), aided=False)
    tight = sail(of, measured, configured(of.config, measured))
    return Run(inertial, usbl_alone(of, measured, inertial), tight)


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


def least_horizontal(of: Voyage) -> float:
    """Horizontal RMS of the bound (m)."""
    sigma = bound.along_truth(of).sigma_n[SETTLED:, _LEVEL]
    return float(np.sqrt(np.mean(np.sum(sigma**2, axis=1))))
