"""Numbers of many runs with their 95 % bounds."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from gateway.studies.passage import EAST, NEES_EVERY, NORTH, Passage

Array = NDArray[np.float64]

Statistic = Callable[[Array], Array]
"""A function of resampled runs: (resamples, N) -> (resamples,)."""

_RESAMPLES = 2000


class Interval(NamedTuple):
    """A number with its 95 % bounds."""

    value: float
    low: float
    high: float


def rms(per_run: Array) -> Interval:
    """RMS over runs of each run's mean square, bounds by resampling the runs.

    Parameters
    ----------
    per_run
        (N,) mean square of each run.
    """
    value = float(np.sqrt(np.mean(per_run)))
    return Interval(value, *resampled(per_run, lambda sample: np.sqrt(sample.mean(axis=-1))))


def resampled(per_run: Array, statistic: Statistic) -> tuple[float, float]:
    """95 % bounds of a statistic by resampling the runs (the bootstrap's percentiles)."""
    rng = np.random.default_rng(0)
    picks = rng.integers(0, len(per_run), size=(_RESAMPLES, len(per_run)))
    low, high = np.percentile(statistic(per_run[picks]), [2.5, 97.5])
    return float(low), float(high)


def mean_square(passages: Sequence[Passage], column: int, begin: int) -> Array:
    """(N,) mean square of one error of each run from epoch `begin` on."""
    return np.array([np.mean(p.error_n[begin:, column] ** 2) for p in passages])


def horizontal(passages: Sequence[Passage], begin: int) -> Array:
    """(N,) mean square of the horizontal error of each run from epoch `begin` on."""
    return mean_square(passages, NORTH, begin) + mean_square(passages, EAST, begin)


def horizontal_square(passage: Passage) -> Array:
    """(m,) squared horizontal error of one run at each epoch."""
    return np.asarray(np.sum(passage.error_n[:, [NORTH, EAST]] ** 2, axis=1))


def nees(passages: Sequence[Passage], begin: int) -> Interval:
    """Mean NEES of a degree of freedom, between the chi-squared bounds of a consistent filter.

    The errors of one run at different times hang together, so the bounds are those of one time:
    N runs of n states are N n degrees of freedom.

    Parameters
    ----------
    begin
        First epoch of each run that counts.
    """
    n = passages[0].n_states
    value = float(np.mean([p.nees[begin // NEES_EVERY :].mean() for p in passages]) / n)
    return Interval(value, *chi_squared_bounds(len(passages) * n))


def nis(passages: Sequence[Passage], skip: int = 0) -> Interval:
    """Mean NIS of a degree of freedom over all fixes, between a consistent filter's bounds.

    Innovations are white, so that all fixes of all runs count.
    """
    total = sum(float(p.nis[skip:].sum()) for p in passages)
    dof = sum(float(p.dof[skip:].sum()) for p in passages)
    return Interval(total / dof, *chi_squared_bounds(dof))


def chi_squared_bounds(dof: float) -> tuple[float, float]:
    """95 % bounds of a chi-squared number, divided by its degrees of freedom."""
    low, high = (float(scipy.stats.chi2.ppf(p, dof)) / dof for p in (0.025, 0.975))
    return low, high


def count(happened: NDArray[np.bool_]) -> Interval:
    """How often something happened in N runs, with the exact binomial bounds."""
    k, n = int(happened.sum()), len(happened)
    bounds = scipy.stats.binomtest(k, n).proportion_ci(0.95)
    return Interval(float(k), n * float(bounds.low), n * float(bounds.high))
