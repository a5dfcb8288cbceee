"""Figures of a calibration: residuals before and after, constants, correlations."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gateway.calibrate.findings import INSEPARABLE, Findings
from gateway.calibrate.source import Residuals, Source
from gateway.outputs.schema import titled

_BEFORE, _AFTER, _BAND = "#d55e00", "#0072b2", "0.9"
"""Colours that stay apart for colour-blind readers and in print."""


def draw(source: Source, findings: Findings, folder: Path, kind: str) -> list[Path]:
    """Write each figure that there is data for as ``folder/name.kind``."""
    figures: dict[str, Callable[[], Figure]] = {"correlation": lambda: correlation(findings)}
    if source.residuals:
        figures["residuals"] = lambda: residuals(source, findings)
    if source.history:
        draw_constants = shares if source.smoothed else history
        figures["constants"] = lambda: draw_constants(source, findings)
    written = []
    for name, make in figures.items():
        path = folder / f"{name}.{kind}"
        make().savefig(path, dpi=130, metadata=_undated(kind))
        written.append(path)
    return written


def residuals(source: Source, findings: Findings) -> Figure:
    """Measured minus predicted over time, and how they are spread."""
    rows = source.residuals
    figure = Figure(figsize=(10, 2.6 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), 2, sharey="row", squeeze=False, width_ratios=[4, 1])
    for (left, right), (name, row) in zip(axes, rows.items(), strict=True):
        sigma = float(np.median(row.sigma))
        for side in (left, right):
            side.axhspan(-sigma, sigma, color=_BAND, zorder=0)
            side.axhline(0.0, color="0.6", linewidth=0.8, zorder=1)
        fit = findings.fits[name]
        before = f"configured (RMS {fit.before_rms:.3g})"
        after = f"calibrated (RMS {fit.after_rms:.3g})"
        left.plot(row.t_s, row.before, ".", color=_BEFORE, markersize=4, label=before)
        left.plot(row.t_s, row.after, ".", color=_AFTER, markersize=4, label=after)
        left.set_ylabel(titled(name))
        left.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize="small", ncols=2, frameon=False
        )
        _spread(right, row)
    axes[-1][0].set_xlabel("time (s)")
    axes[-1][1].set_xlabel("fixes")
    track = "smoothed" if source.smoothed else "filtered"
    figure.suptitle(
        f"{findings.device}: measured minus predicted, {track} track (band: 1 sigma of white noise)"
    )
    return figure


def shares(_source: Source, findings: Findings) -> Figure:
    """What is known of each constant of the array after the run, in sigmas of what was before."""
    rows = {name: c for name, c in findings.constants.items() if c.prior > 0.0}
    figure = Figure(figsize=(8, 0.45 * len(rows) + 1.6), layout="constrained")
    axis = figure.subplots()
    axis.axvspan(-1.0, 1.0, color=_BAND, zorder=0)
    axis.axvline(0.0, color="0.6", linewidth=0.8)
    places = range(len(rows))
    values = [c.value / c.prior for c in rows.values()]
    sigmas = [c.sigma / c.prior for c in rows.values()]
    axis.errorbar(values, places, xerr=sigmas, fmt="o", color=_AFTER, capsize=4)
    axis.set_yticks(places, [titled(name) for name in rows])
    axis.invert_yaxis()
    axis.set_xlabel("sigmas before the run")
    axis.set_title(f"{findings.device}: estimates with 1 sigma (grey: 1 sigma before the run)")
    return figure


def history(source: Source, findings: Findings) -> Figure:
    """Each constant of the array with its 1-sigma band over the replay."""
    shown = {n: h for n, h in source.history.items() if n in findings.constants}
    columns = 2 if len(shown) > 1 else 1
    lines = -(-len(shown) // columns)
    figure = Figure(figsize=(10, 2.2 * lines + 0.6), layout="constrained")
    axes = figure.subplots(lines, columns, sharex=True, squeeze=False).ravel()
    for axis, (name, row) in zip(axes, shown.items(), strict=False):
        prior = findings.constants[name].prior
        axis.axhspan(-prior, prior, color=_BAND, zorder=0)
        axis.fill_between(
            row.t_s, row.value - row.sigma, row.value + row.sigma, color=_AFTER, alpha=0.3
        )
        axis.plot(row.t_s, row.value, color=_AFTER)
        axis.set_ylabel(titled(name))
    for axis in axes[len(shown) :]:
        axis.set_visible(False)
    for axis in axes[max(len(shown) - columns, 0) : len(shown)]:
        axis.set_xlabel("time (s)")
        axis.tick_params(labelbottom=True)
    figure.suptitle(f"{findings.device}: estimates with 1 sigma (grey: 1 sigma before the run)")
    return figure


def correlation(findings: Findings) -> Figure:
    """Correlations at the end; a frame around what cannot be told apart."""
    names, n = findings.names, len(findings.names)
    figure = Figure(figsize=(0.55 * n + 2.5, 0.5 * n + 2.0), layout="constrained")
    axis = figure.subplots()
    image = axis.imshow(findings.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    axis.set_xticks(range(n), [titled(name) for name in names], rotation=60, ha="right")
    axis.set_yticks(range(n), [titled(name) for name in names])
    for i in range(n):
        for j in range(n):
            value = findings.correlation[i, j]
            if i != j and abs(value) >= 0.1:
                colour = "white" if abs(value) > 0.6 else "black"
                axis.text(j, i, f"{value:.2f}", ha="center", va="center", color=colour, size=6.5)
            if i != j and abs(value) > INSEPARABLE:
                axis.plot(
                    [j - 0.5, j + 0.5, j + 0.5, j - 0.5, j - 0.5],
                    [i - 0.5, i - 0.5, i + 0.5, i + 0.5, i - 0.5],
                    color="black",
                    linewidth=1.5,
                )
    figure.colorbar(image, ax=axis, shrink=0.7)
    axis.set_title(f"{findings.device}: correlation (framed: above {INSEPARABLE})")
    return figure


def _spread(axis: Axes, row: Residuals) -> None:
    """Histograms turned on their side."""
    both = np.concatenate([row.before, row.after])
    low, high = np.nanpercentile(both, [0.5, 99.5])
    bins = np.linspace(low, high, 30)
    for numbers, colour in ((row.before, _BEFORE), (row.after, _AFTER)):
        axis.hist(
            numbers, bins=bins.tolist(), orientation="horizontal", histtype="step", color=colour
        )


def _undated(kind: str) -> dict[str, None] | None:
    """No date in the file: the same input gives the same bytes."""
    return {"Date": None} if kind == "svg" else None
