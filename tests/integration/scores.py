"""Errors of a replay against the truth, as the captures' README defines them."""

import gzip
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gateway.nav.earth import radii

Table = NDArray[np.void]


@dataclass(frozen=True)
class Errors:
    """Errors of each solution (m, deg) at its time after the capture's zero (s)."""

    t: NDArray[np.float64]
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    up: NDArray[np.float64]
    heading: NDArray[np.float64]

    def rms(self, begin: float, end: float = np.inf) -> dict[str, float]:
        """RMS of the horizontal (2-D), vertical (m) and heading (deg) errors within a time."""
        chosen = (self.t >= begin) & (self.t <= end)
        squares = {
            "horizontal": self.north**2 + self.east**2,
            "vertical": self.up**2,
            "heading": self.heading**2,
        }
        return {name: float(np.sqrt(np.mean(square[chosen]))) for name, square in squares.items()}


def read(path: Path) -> Table:
    """Numbers of a CSV file, gzipped or not, by the names of its columns."""
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as file:
        header, *rows = (line.rstrip("\n").split(",") for line in file)
    names = [name for name in header if name not in ("mode",)]
    numbers = np.array([row[: len(names)] for row in rows], dtype=np.float64)
    return np.rec.fromarrays(numbers.T, names=names)


def errors(nav: Path, truth: Path, zero_s: float = 0.0) -> Errors:
    """Solution minus truth, the truth interpolated to the times of the solution.

    Parameters
    ----------
    zero_s
        Unix time of the truth's t = 0.
    """
    solved, true = read(nav), read(truth)
    t_true = true["t" if "t" in (true.dtype.names or ()) else "t_s"]
    t = solved["t_s"] - zero_s
    inside = (t >= t_true[0]) & (t <= t_true[-1])
    solved, t = solved[inside], t[inside]

    def minus_truth(name: str) -> NDArray[np.float64]:
        return solved[name] - np.interp(t, t_true, true[name])

    lat = np.radians(solved["lat_deg"])
    R_M, R_N = radii(lat)
    heading = np.degrees(np.unwrap(np.radians(true["heading_deg"])))
    return Errors(
        t=t,
        north=np.radians(minus_truth("lat_deg")) * (R_M + solved["height_m"]),
        east=np.radians(minus_truth("lon_deg")) * (R_N + solved["height_m"]) * np.cos(lat),
        up=minus_truth("height_m"),
        heading=(solved["heading_deg"] - np.interp(t, t_true, heading) + 180.0) % 360.0 - 180.0,
    )


def shown(figures: Iterable[tuple[str, float, float]]) -> str:
    """Attained figures beside their bounds, for a person."""
    return ", ".join(f"{name} {value:.3f} (bound {bound:.3f})" for name, value, bound in figures)
