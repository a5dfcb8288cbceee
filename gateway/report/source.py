"""What a replay or an export left in its folder, as tables."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.config import Config, load
from gateway.emulator.truth import TruthRow
from gateway.errors import ConfigError, cause
from gateway.nav.attitude import turn
from gateway.nav.earth import north_east
from gateway.outputs.files import NAV_DECIMALS

Array = NDArray[np.float64]

_NO_TRUTH = "not a truth file of the emulator"

NAV_COLUMNS = ("t_s", *NAV_DECIMALS)


@dataclass(frozen=True)
class Navigation:
    """nav.csv: a (k,) column by name, without ``mode``; and (k,) modes."""

    columns: dict[str, Array]
    modes: NDArray[np.str_]

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]


@dataclass(frozen=True)
class Innovations:
    """One component of all fixes of a device, each (k,): measured minus predicted."""

    t_s: Array
    value: Array
    sigma: Array
    nis: Array
    accepted: NDArray[np.bool_]


@dataclass(frozen=True)
class Alignment:
    """What the IMU found of the attitude in one window: by component, value and sigma."""

    t_s: float
    found: dict[str, tuple[float, float]]
    accepted: bool
    reason: str


@dataclass(frozen=True)
class Errors:
    """Solution minus truth at the epochs (k,) that the truth covers; metres and degrees."""

    t_s: Array
    north_m: Array
    east_m: Array
    down_m: Array
    heading_deg: Array
    sigma: dict[str, Array]
    """By the names above."""

    @property
    def horizontal_m(self) -> Array:
        """Length of the horizontal error."""
        return np.hypot(self.north_m, self.east_m)


@dataclass(frozen=True)
class Source:
    """All there is; times are Unix times.

    Attributes
    ----------
    calibration
        By name: (k, 3) time, value and sigma.
    innovations
        Of fixes, by ``(device, component)``.
    alignments
        In order of time.
    refused
        Fixes by device and reason that were not compared at all.
    targets
        By name: (k, 2) latitude and longitude (deg) of each followed; NaN where it was lost.
    """

    folder: Path
    nav: Navigation
    innovations: dict[tuple[str, str], Innovations]
    alignments: list[Alignment]
    refused: dict[tuple[str, str], int]
    calibration: dict[str, Array]
    summary: dict[str, Any]
    config: Config | None
    config_text: str
    errors: Errors | None
    targets: dict[str, Array]


def read(folder: Path, truth: Path | None = None) -> Source:
    """Read the folder of a replay or an export, and the emulator's truth where it is known.

    Raises
    ------
    ConfigError
        Naming what is missing or cannot be read.
    """
    _complete(folder)
    file = folder / "config.yaml"
    config = load(file) if file.is_file() else None
    imu = config.imu[0] if config else ""
    try:
        nav = _navigation(folder / "nav.csv")
        rows = _rows(folder / "innovations.csv")
        innovations, refused = _innovations([row for row in rows if row["device"] != imu])
        alignments = _alignments([row for row in rows if row["device"] == imu])
        calibration = _calibration(folder / "calibration.csv")
        targets = _targets(folder / "targets.csv")
        summary = msgspec.json.decode((folder / "summary.json").read_bytes(), type=dict[str, Any])
    except (msgspec.DecodeError, ValueError, KeyError) as error:
        raise ConfigError([f"{folder}: not what a replay writes: {error}"]) from error
    if not len(nav["t_s"]):
        raise ConfigError([f"{folder}/nav.csv: holds no solution"])
    return Source(
        folder=folder,
        nav=nav,
        innovations=innovations,
        alignments=alignments,
        refused=refused,
        calibration=calibration,
        summary=summary,
        config=config,
        config_text=file.read_text() if config else "",
        errors=None if truth is None else _errors(nav, truth),
        targets=targets,
    )


def _complete(folder: Path) -> None:
    """Raise unless the tables are there."""
    wanted = ("nav.csv", "innovations.csv", "calibration.csv", "summary.json")
    missing = [name for name in wanted if not (folder / name).is_file()]
    if not missing:
        return
    several = sorted(str(inner.parent) for inner in folder.glob("*/summary.json"))
    if several:
        raise ConfigError([f"{folder}: holds several filters; give one of {', '.join(several)}"])
    raise ConfigError([f"{folder}: no {', '.join(missing)}; give the folder that a replay wrote"])


def _navigation(path: Path) -> Navigation:
    rows = _rows(path)
    columns = {name: np.array([float(row[name]) for row in rows]) for name in NAV_COLUMNS}
    return Navigation(columns, np.array([row["mode"] for row in rows], dtype=np.str_))


def _innovations(
    table: list[dict[str, str]],
) -> tuple[dict[tuple[str, str], Innovations], dict[tuple[str, str], int]]:
    compared: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    refused: dict[tuple[str, str], int] = {}
    for row in table:
        if not row["component"]:
            key = row["device"], row["reason"]
            refused[key] = refused.get(key, 0) + 1
            continue
        numbers = [float(row[name] or "nan") for name in ("t_s", "value", "sigma", "nis")]
        key = row["device"], row["component"]
        compared.setdefault(key, []).append((*numbers, float(row["accepted"])))
    found = {}
    for key, numbers_of in compared.items():
        t_s, value, sigma, nis, accepted = np.array(numbers_of).T
        found[key] = Innovations(t_s, value, sigma, nis, accepted > 0.0)
    return found, refused


def _alignments(table: list[dict[str, str]]) -> list[Alignment]:
    windows: dict[str, Alignment] = {}
    for row in table:
        told = Alignment(float(row["t_s"]), {}, row["accepted"] == "1", row["reason"])
        window = windows.setdefault(row["t_s"], told)
        if row["component"]:
            window.found[row["component"]] = float(row["value"]), float(row["sigma"])
    return list(windows.values())


def _calibration(path: Path) -> dict[str, Array]:
    table: dict[str, list[list[float]]] = {}
    for row in _rows(path):
        numbers = [float(row[name]) for name in ("t_s", "value", "sigma")]
        table.setdefault(row["name"], []).append(numbers)
    return {name: np.array(rows) for name, rows in table.items()}


def _targets(path: Path) -> dict[str, Array]:
    """Nothing where nothing is followed."""
    table: dict[str, list[tuple[float, float]]] = {}
    for row in _rows(path) if path.is_file() else []:
        place = float(row["lat_deg"]), float(row["lon_deg"])
        table.setdefault(row["name"], []).append(
            (np.nan, np.nan) if row["state"] == "lost" else place
        )
    return {name: np.array(places) for name, places in table.items()}


def _truth(truth: Path) -> dict[str, Array]:
    """Read the columns (k,) of a truth file of the emulator."""
    try:
        rows = _rows(truth)
        return {name: np.array([float(row[name]) for row in rows]) for name in TruthRow._fields}
    except OSError as error:
        raise ConfigError([f"{truth}: {cause(error)}"]) from error
    except KeyError as error:
        raise ConfigError([f"{truth}: {_NO_TRUTH}: no column {error.args[0]}"]) from error
    except UnicodeDecodeError as error:
        raise ConfigError([f"{truth}: {_NO_TRUTH}: no text"]) from error
    except (TypeError, ValueError, csv.Error) as error:
        raise ConfigError([f"{truth}: {_NO_TRUTH}: {error}"]) from error


def _errors(nav: Navigation, truth: Path) -> Errors:
    """Compare with a truth file of the emulator."""
    true, t_s = _truth(truth), nav["t_s"]
    inside = np.zeros(len(t_s), dtype=np.bool_)
    if len(true["t_s"]) > 1:
        inside = (t_s >= true["t_s"][0]) & (t_s <= true["t_s"][-1])
    if not inside.any():
        raise ConfigError([f"{truth}: its times and those of nav.csv do not overlap"])
    t_s = t_s[inside]
    at = {
        name: np.interp(t_s, true["t_s"], true[name]) for name in ("lat_deg", "lon_deg", "height_m")
    }
    heading = np.unwrap(true["heading_deg"], period=360.0)
    lat, lon = np.radians(nav["lat_deg"][inside]), np.radians(nav["lon_deg"][inside])
    true_place = np.radians(at["lat_deg"]), np.radians(at["lon_deg"])
    north, east = north_east(lat, lon, *true_place, at["height_m"])
    off_deg = nav["heading_deg"][inside] - np.interp(t_s, true["t_s"], heading)
    sigmas = {
        "north_m": "sd_n_m",
        "east_m": "sd_e_m",
        "down_m": "sd_d_m",
        "heading_deg": "sd_heading_deg",
    }
    return Errors(
        t_s=t_s,
        north_m=north,
        east_m=east,
        down_m=at["height_m"] - nav["height_m"][inside],
        heading_deg=turn(off_deg, 360.0),
        sigma={name: nav[column][inside] for name, column in sigmas.items()},
    )


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
