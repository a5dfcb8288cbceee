"""Figures of the studies: RMS errors over time, run by run and against the bound."""

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gateway.studies.passage import DOWN, EAST, HEADING, NORTH, Passage
from gateway.studies.voyage import EPOCH_S

Array = NDArray[np.float64]
AXES = {"north": NORTH, "east": EAST, "down": DOWN}
Fleets = Sequence[Mapping[str, Passage]]


def heading(fleets: Fleets, least: Passage) -> Figure:
    """RMS heading error of each filter over time, logarithmic."""
    figure = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = figure.add_subplot()
    _compare(axes, fleets, least, _heading_deg)
    axes.set_ylabel("RMS heading error (deg)")
    axes.set_xlabel("time (s)")
    axes.legend()
    return figure


def position(fleets: Fleets, least: Passage) -> Figure:
    """RMS position errors of each filter over time, north, east and down."""
    figure = Figure(figsize=(8.0, 8.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for axis, (name, column) in zip(axes, AXES.items(), strict=True):
        _compare(axis, fleets, least, itemgetter((slice(None), column)))
        axis.set_ylabel(f"RMS {name} error (m)")
    axes[0].legend()
    axes[-1].set_xlabel("time (s)")
    return figure


def horizontal(filters: Mapping[str, Sequence[Passage]], least: Passage) -> Figure:
    """RMS horizontal error of each way to navigate over time, logarithmic."""
    figure = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = figure.subplots()
    for name, passages in filters.items():
        _draw(axes, over_runs(passages, _level), name)
    axes.plot(*_over_time(_level(least.sigma_n)), "k--", label="bound", lw=1.0)
    axes.set_yscale("log")
    axes.grid(which="both", alpha=0.3)
    axes.set_ylabel("RMS horizontal error (m)")
    axes.set_xlabel("time (s)")
    axes.legend()
    return figure


def over_runs(passages: Sequence[Passage], pick: Callable[[Array], Array]) -> Array:
    """(m,) RMS over the runs of what is picked from the errors."""
    mean: Array = np.mean([pick(p.error_n) ** 2 for p in passages], axis=0)
    return np.sqrt(mean)


def _compare(axes: Axes, fleets: Fleets, least: Passage, pick: Callable[[Array], Array]) -> None:
    for name in fleets[0]:
        _draw(axes, over_runs([fleet[name] for fleet in fleets], pick), name)
    axes.plot(*_over_time(pick(least.sigma_n)), "k--", label="bound", lw=1.0)
    axes.set_yscale("log")
    axes.grid(which="both", alpha=0.3)


def _draw(axes: Axes, rms: Array, name: str) -> None:
    axes.plot(*_over_time(rms), label=name.replace("_", " "), lw=1.2)


def _over_time(values: Array) -> tuple[Array, Array]:
    return np.asarray(EPOCH_S * np.arange(len(values)), np.float64), values


def _heading_deg(errors: Array) -> Array:
    return np.degrees(errors[:, HEADING])


def _level(errors: Array) -> Array:
    """(m,) horizontal length of the errors' position."""
    length: Array = np.hypot(errors[:, NORTH], errors[:, EAST])
    return length
