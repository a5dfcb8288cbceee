"""Figures of the studies: RMS errors over time, run by run and against the bound."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gateway.studies.passage import DOWN, EAST, HEADING, NORTH, Passage
from gateway.studies.voyage import EPOCH_S

Array = NDArray[np.float64]
Fleets = Sequence[Mapping[str, Passage]]


def heading(fleets: Fleets, least: Passage) -> Figure:
    """RMS heading error of each filter over time, logarithmic."""
    figure = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = figure.add_subplot()
    _compare(axes, fleets, least, lambda p: np.degrees(p[:, HEADING]))
    axes.set_ylabel("RMS heading error (deg)")
    axes.set_xlabel("time (s)")
    axes.legend()
    return figure


def position(fleets: Fleets, least: Passage) -> Figure:
    """RMS position errors of each filter over time, north, east and down."""
    figure = Figure(figsize=(8.0, 8.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for axis, column, name in zip(
        axes, (NORTH, EAST, DOWN), ("north", "east", "down"), strict=True
    ):
        _compare(axis, fleets, least, lambda p, c=column: p[:, c])
        axis.set_ylabel(f"RMS {name} error (m)")
    axes[0].legend()
    axes[-1].set_xlabel("time (s)")
    return figure


def over_runs(passages: Sequence[Passage], pick: Callable[[Array], Array]) -> Array:
    """(m,) RMS over the runs of what is picked from the errors."""
    mean: Array = np.mean([pick(p.error_n) ** 2 for p in passages], axis=0)
    return np.sqrt(mean)


def _compare(axes: Axes, fleets: Fleets, least: Passage, pick: Callable[[Array], Array]) -> None:
    for name in fleets[0]:
        rms = over_runs([fleet[name] for fleet in fleets], pick)
        axes.plot(EPOCH_S * np.arange(len(rms)), rms, label=name.replace("_", " "), lw=1.2)
    bound = pick(least.sigma_n)
    axes.plot(EPOCH_S * np.arange(len(bound)), bound, "k--", label="bound", lw=1.0)
    axes.set_yscale("log")
    axes.grid(which="both", alpha=0.3)
