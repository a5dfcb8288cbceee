"""The figures of the page, as SVG that stands inside it."""

import io
import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import scipy.special
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogFormatter
from numpy.typing import NDArray

from gateway.modes import Mode
from gateway.nav.earth import north_east
from gateway.outputs.schema import titled
from gateway.report.source import Errors, Innovations, Source

Array = NDArray[np.float64]

SOLUTION, TRUTH, REFUSED, BAND = "#0072b2", "0.35", "#d55e00", "#cfe3f1"
FOLLOWED = "#009e73"
"""Colours that stay apart for colour-blind readers and in print."""
POINTS = 1500
"""A line has no more: what a screen can show, and a page can carry."""
WIDTH = 9.6
DAY_S = 86_400.0
_MODES = {"aided": "#d7efdc", "dead_reckoning": "#fdf1c7", "aligning": "#dde3ea"}
"""Background by mode; any other is red."""
_TIMES = ["%Y", "%b", "%b %d", "%H:%M", "%H:%M", "%H:%M:%S"]
"""Labels of ticks that are years, months, days, hours, minutes, seconds apart."""


class _Plain(LogFormatter):
    """Names the same ticks, without powers of ten."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Name of a tick, or nothing."""
        return f"{x:g}" if super().__call__(x, pos) else ""


def draw(source: Source) -> dict[str, tuple[str, str]]:
    """Caption and SVG of each figure that there is data for, by its name."""
    makers: dict[str, tuple[str, Callable[[], Figure | None]]] = {
        "track": (f"Track, north up, in metres from {_place(source)}", lambda: track(source)),
        "errors": (
            "Solution minus truth; the band is 3 sigma of what the filter claimed",
            lambda: None if source.errors is None else errors(source.errors, source),
        ),
        "sigmas": ("Claimed 1 sigma; the background is the mode", lambda: sigmas(source)),
        "motion": ("Height, speed and heading", lambda: motion(source)),
        "innovations": (
            "Innovations in sigmas: used (dots), refused (crosses), 3 sigma (lines)",
            lambda: innovations(source.innovations, source),
        ),
        "nis": (
            "Normalised innovation squared, its expectation (grey) and the gate (orange)",
            lambda: nis(source),
        ),
        "calibration": ("Estimated constants with 1 sigma", lambda: calibration(source)),
    }
    drawn = {}
    for name, (caption, make) in makers.items():
        figure = make()
        if figure is not None:
            drawn[name] = caption, _svg(figure, name)
    return drawn


def track(source: Source) -> Figure:
    """The way, the beacons, and what was followed."""
    figure = Figure(figsize=(WIDTH, 6.0), layout="constrained")
    axis = figure.subplots()
    nav = source.nav
    middle = _middle(source)
    north, east = north_east(np.radians(nav["lat_deg"]), np.radians(nav["lon_deg"]), *middle)
    if source.errors is not None:
        inside = np.isin(nav["t_s"], source.errors.t_s)
        true_e, true_n = east[inside] - source.errors.east_m, north[inside] - source.errors.north_m
        axis.plot(*_thin(true_e, true_n), color=TRUTH, linewidth=2.5, label="truth")
    axis.plot(*_thin(east, north), color=SOLUTION, linewidth=1.0, label="solution")
    axis.plot(east[0], north[0], "o", color=SOLUTION, markersize=5, label="begin")
    axis.plot(east[-1], north[-1], "s", color=SOLUTION, markersize=5, label="end")
    if source.config is not None:
        for name, beacon in source.config.moored.items():
            place = np.radians(beacon.lat_deg), np.radians(beacon.lon_deg)
            b_n, b_e = map(float, north_east(*place, *middle))
            axis.plot(b_e, b_n, "^", color=REFUSED, markersize=7)
            axis.annotate(
                f"beacon {name}",
                (b_e, b_n),
                xytext=(6, 4),
                textcoords="offset points",
                color=REFUSED,
            )
    for name, places in source.targets.items():
        t_n, t_e = north_east(np.radians(places[:, 0]), np.radians(places[:, 1]), *middle)
        axis.plot(*_thin(t_e, t_n), color=FOLLOWED, linewidth=1.0, label=f"target {name}")
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("east (m)")
    axis.set_ylabel("north (m)")
    axis.grid(color="0.9")
    axis.legend(loc="best", fontsize="small")
    return figure


def errors(found: Errors, source: Source) -> Figure:
    """Errors against the truth, with what was claimed."""
    names = {
        "north_m": "north (m)",
        "east_m": "east (m)",
        "down_m": "down (m)",
        "heading_deg": "heading (deg)",
    }
    figure, axes = _stack(len(names), source)
    for axis, (name, label) in zip(axes, names.items(), strict=True):
        error, sigma = getattr(found, name), found.sigma[name]
        t, low, high, line = _thin(_days(found.t_s), -3 * sigma, 3 * sigma, error)
        axis.fill_between(t, low, high, color=BAND, linewidth=0)
        axis.plot(t, line, color=SOLUTION, linewidth=0.9)
        axis.set_ylabel(label)
        # What was not known yet at the beginning would hide all the rest.
        span = 4.0 * float(np.quantile(np.maximum(np.abs(line), high / 3.0), 0.9))
        axis.set_ylim(-max(span, 1e-6), max(span, 1e-6))
    return figure


def sigmas(source: Source) -> Figure:
    """Claimed uncertainties over time, on a background that tells the mode."""
    figure, axes = _stack(3, source)
    nav = source.nav
    t = _days(nav["t_s"])
    horizontal = np.hypot(nav["sd_n_m"], nav["sd_e_m"])
    rows = (
        ("horizontal (m)", horizontal),
        ("down (m)", nav["sd_d_m"]),
        ("heading (deg)", nav["sd_heading_deg"]),
    )
    for axis, (label, values) in zip(axes, rows, strict=True):
        axis.plot(*_thin(t, values), color=SOLUTION, linewidth=1.0)
        axis.set_ylabel(label)
        axis.set_yscale("log")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter(_Plain(minor_thresholds=(1.5, 0.4)))
        _shade(axis, t, source.nav.modes)
    seen = [mode for mode in Mode if mode in source.nav.modes]
    swatches = [Patch(color=_colour(mode), label=mode.value.replace("_", " ")) for mode in seen]
    axes[0].legend(handles=swatches, loc="best", ncols=len(seen), fontsize="small")
    return figure


def motion(source: Source) -> Figure:
    """What the vehicle did."""
    figure, axes = _stack(3, source)
    nav = source.nav
    t = _days(nav["t_s"])
    speed = np.hypot(nav["vn_m_s"], nav["ve_m_s"])
    rows = (
        ("height (m)", nav["height_m"]),
        ("speed (m/s)", speed),
        ("heading (deg)", nav["heading_deg"]),
    )
    for axis, (label, values) in zip(axes, rows, strict=True):
        x, y = _thin(t, values)
        if label.startswith("heading"):
            y[np.abs(np.diff(y, prepend=y[0])) > 180.0] = np.nan  # through north
        axis.plot(x, y, color=SOLUTION, linewidth=1.0)
        axis.set_ylabel(label)
    return figure


def innovations(found: dict[tuple[str, str], Innovations], source: Source) -> Figure | None:
    """Each component over time, in its own sigmas."""
    if not found:
        return None
    figure, axes = _stack(len(found), source, 1.6)
    for axis, ((device, component), rows) in zip(axes, found.items(), strict=True):
        t, ratio = _days(rows.t_s), rows.value / rows.sigma
        for gate in (-3.0, 0.0, 3.0):
            axis.axhline(gate, color="0.6", linewidth=0.8)
        used = rows.accepted
        axis.plot(t[used], ratio[used], ".", color=SOLUTION, markersize=3)
        axis.plot(t[~used], np.clip(ratio[~used], -8, 8), "x", color=REFUSED, markersize=5)
        axis.set_ylim(-8.5, 8.5)
        axis.set_ylabel(f"{device}\n{component.rpartition('_')[0] or component}")
    return figure


def nis(source: Source) -> Figure | None:
    """One point a fix; the line is the gate for as many components."""
    fixes = _fixes(source)
    if not fixes or source.config is None:
        return None
    figure, axes = _stack(len(fixes), source, 1.8)
    for axis, (device, (rows, components)) in zip(axes, fixes.items(), strict=True):
        gate = float(scipy.special.chdtri(components, 1.0 - source.config.filter.innovation_gate))
        t, used = _days(rows.t_s), rows.accepted
        axis.plot(t[used], rows.nis[used], ".", color=SOLUTION, markersize=3)
        axis.plot(t[~used], rows.nis[~used], "x", color=REFUSED, markersize=5)
        axis.axhline(gate, color=REFUSED, linewidth=0.9)
        axis.axhline(components, color="0.6", linewidth=0.8)
        axis.set_yscale("log")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_ylabel(device)
    return figure


def calibration(source: Source) -> Figure | None:
    """Every constant, small."""
    rows = source.calibration
    if not rows:
        return None
    columns = 3
    lines = -(-len(rows) // columns)
    figure = Figure(figsize=(WIDTH, 1.7 * lines), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True).ravel()
    for axis, (name, table) in zip(axes, rows.items(), strict=False):
        t, value, sigma = _thin(_days(table[:, 0]), table[:, 1], table[:, 2])
        axis.fill_between(t, value - sigma, value + sigma, color=BAND, linewidth=0)
        axis.plot(t, value, color=SOLUTION, linewidth=1.0)
        axis.set_title(titled(name), fontsize="small")
        axis.tick_params(labelsize="small")
        axis.tick_params(axis="x", labelbottom=True)
        _utc(axis, 4)
    for axis in axes[len(rows) :]:
        axis.set_axis_off()
    return figure


def _stack(count: int, source: Source, height: float = 1.7) -> tuple[Figure, Sequence[Axes]]:
    """Axes above each other with one time axis."""
    figure = Figure(figsize=(WIDTH, height * count + 0.5), layout="constrained")
    axes: list[Axes] = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0].tolist()
    for axis in axes:
        axis.grid(color="0.92")
    nav = source.nav
    begin, end = nav["t_s"][0], max(nav["t_s"][-1], nav["t_s"][0] + 1.0)
    axes[-1].set_xlim(begin / DAY_S, end / DAY_S)
    axes[-1].set_xlabel(f"UTC, {datetime.fromtimestamp(begin, UTC):%Y-%m-%d}")
    _utc(axes[-1], 10)
    return figure, axes


def _utc(axis: Axes, ticks: int) -> None:
    """Time of the day along the axis; midnight has its date."""
    locator = AutoDateLocator(tz=UTC, minticks=2, maxticks=ticks)
    words = ConciseDateFormatter(locator, tz=UTC, formats=_TIMES, show_offset=False)
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(words)


def _fixes(source: Source) -> dict[str, tuple[Innovations, int]]:
    """By device: its first component, which has every fix once, and how many components it has."""
    found: dict[str, tuple[Innovations, int]] = {}
    for (device, _), rows in source.innovations.items():
        first, count = found.get(device, (rows, 0))
        found[device] = first, count + 1
    return found


def _shade(axis: Axes, t: Array, modes: NDArray[np.str_]) -> None:
    """Colour the background by the mode."""
    starts = [0, *(np.flatnonzero(modes[1:] != modes[:-1]) + 1).tolist(), len(modes)]
    for begin, end in pairwise(starts):
        colour = _colour(str(modes[begin]))
        axis.axvspan(t[begin], t[min(end, len(t) - 1)], color=colour, linewidth=0, zorder=0)


def _colour(mode: str) -> str:
    return _MODES.get(mode, "#f9d7d2")


def _middle(source: Source) -> tuple[float, float]:
    """Mean latitude and longitude, rad; where the metres are counted from."""
    nav = source.nav
    return math.radians(np.mean(nav["lat_deg"])), math.radians(np.mean(nav["lon_deg"]))


def _place(source: Source) -> str:
    lat, lon = map(math.degrees, _middle(source))
    return f"{abs(lat):.6f}° {'NS'[lat < 0.0]}, {abs(lon):.6f}° {'EW'[lon < 0.0]}"


def _days(t_s: Array) -> Array:
    """Unix days, as matplotlib counts them."""
    return np.asarray(t_s / DAY_S)


def _thin(*columns: Array) -> list[Array]:
    """As many points as can be seen, the last one among them."""
    step = max(1, len(columns[0]) // POINTS)
    chosen = np.unique(np.append(np.arange(0, len(columns[0]), step), len(columns[0]) - 1))
    return [column[chosen] for column in columns]


def _svg(figure: Figure, name: str) -> str:
    """The drawing without what only a file of its own needs; the same bytes each time."""
    text = io.StringIO()
    with mpl.rc_context(
        {"svg.fonttype": "none", "svg.hashsalt": name, "font.family": "sans-serif"}
    ):
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
