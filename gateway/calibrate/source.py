"""What a replay left in its folder, read back for calibration."""

import csv
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.config import Config, load
from gateway.errors import ConfigError

Array = NDArray[np.float64]

NEEDED = ("summary.json", "config.yaml", "calibration.csv", "calibration_covariance.csv")


@dataclass(frozen=True)
class Constant:
    """One estimated constant in the unit that ends its name; ``prior`` is its first sigma."""

    value: float
    sigma: float
    prior: float


@dataclass(frozen=True)
class History:
    """One constant over the replay: ``t_s`` since its first entry, value and sigma, each (k,)."""

    t_s: Array
    value: Array
    sigma: Array


@dataclass(frozen=True)
class Residuals:
    """One component of all used fixes, each (k,): measured minus predicted, edge units."""

    t_s: Array
    before: Array
    after: Array
    sigma: Array


@dataclass(frozen=True)
class Source:
    """A replay's results.

    Attributes
    ----------
    constants
        By name, at the end.
    names, covariance
        n names of ``calibration_covariance.csv`` and the (n, n) matrix.
    smoothed
        Whether the residuals are against a smoothed track.
    """

    config: Config
    constants: dict[str, Constant]
    names: list[str]
    covariance: Array
    history: dict[str, History]
    residuals: dict[str, Residuals]
    smoothed: bool


class _Block(msgspec.Struct):
    smoothed: bool = False


class _Summary(msgspec.Struct):
    calibration: dict[str, Constant]
    filter: _Block


def read(out: Path) -> Source:
    """Read the folder of a replay.

    Raises
    ------
    ConfigError
        With one line for each thing that is missing or cannot be read.
    """
    _complete(out)
    try:
        summary = msgspec.json.decode((out / "summary.json").read_bytes(), type=_Summary)
        names, covariance = _covariance(out / "calibration_covariance.csv")
        history = _history(out / "calibration.csv")
        residuals = _residuals(out / "residuals.csv")
    except (msgspec.DecodeError, ValueError, KeyError) as error:
        raise ConfigError([f"{out}: not what a replay writes: {error}"]) from error
    return Source(
        config=load(out / "config.yaml"),
        constants=summary.calibration,
        names=names,
        covariance=covariance,
        history=history,
        residuals=residuals,
        smoothed=summary.filter.smoothed,
    )


def _complete(out: Path) -> None:
    """Raise unless all files are there."""
    missing = [name for name in NEEDED if not (out / name).is_file()]
    if not missing:
        return
    several = sorted(str(inner.parent) for inner in out.glob("*/summary.json"))
    if several:
        raise ConfigError([f"{out}: holds several filters; give one of {', '.join(several)}"])
    raise ConfigError([f"{out}: no {', '.join(missing)}; give the folder that a replay wrote"])


def _rows(path: Path) -> list[dict[str, str]]:
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _covariance(path: Path) -> tuple[list[str], Array]:
    rows = _rows(path)
    names = [row["name"] for row in rows]
    return names, np.array([[float(row[name]) for name in names] for row in rows])


def _history(path: Path) -> dict[str, History]:
    table: dict[str, list[list[float]]] = {}
    for row in _rows(path):
        numbers = [float(row[key]) for key in ("t_s", "value", "sigma")]
        table.setdefault(row["name"], []).append(numbers)
    return {name: History(*_from_zero(rows)) for name, rows in table.items()}


def _residuals(path: Path) -> dict[str, Residuals]:
    table: dict[str, list[list[float]]] = {}
    for row in _rows(path):
        if row["beacon"]:
            numbers = [float(row[key]) for key in ("t_s", "before", "after", "sigma")]
            table.setdefault(row["component"], []).append(numbers)
    return {name: Residuals(*_from_zero(rows)) for name, rows in table.items()}


def _from_zero(rows: list[list[float]]) -> Array:
    """Columns of a table, the first counted from its first entry."""
    columns: Array = np.array(rows).T
    columns[0] -= columns[0, 0]
    return columns
