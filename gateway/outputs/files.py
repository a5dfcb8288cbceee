"""The files of a replay: its tables, its summary and the configuration it ran with.

Every number is written with fixed decimals, times from whole nanoseconds, so that the same input
gives the same bytes.
"""

import csv
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TextIO

import msgspec
import yaml

from gateway.errors import UsblnavError
from gateway.outputs.schema import CalibrationReport, InnovationReport, NavReport, TargetReport

NAV_DECIMALS = {
    "lat_deg": 10,
    "lon_deg": 10,
    "height_m": 4,
    "vn_m_s": 5,
    "ve_m_s": 5,
    "vd_m_s": 5,
    "roll_deg": 6,
    "pitch_deg": 6,
    "heading_deg": 6,
    "sd_n_m": 4,
    "sd_e_m": 4,
    "sd_d_m": 4,
    "sd_vn_m_s": 5,
    "sd_ve_m_s": 5,
    "sd_vd_m_s": 5,
    "sd_roll_deg": 6,
    "sd_pitch_deg": 6,
    "sd_heading_deg": 6,
}
"""The columns of nav.csv between time and mode, each a field of `NavReport`, and their decimals."""
NAV_HEADER = ",".join(("t_s", *NAV_DECIMALS, "mode"))
INNOVATION_HEADER = "t_s,device,beacon,component,value,sigma,nis,accepted,reason"
CALIBRATION_HEADER = "t_s,name,value,sigma"
TARGET_DECIMALS = {
    "age_s": 3,
    **{name: NAV_DECIMALS[name] for name in list(NAV_DECIMALS)[:6]},
    **{name: NAV_DECIMALS[name] for name in list(NAV_DECIMALS)[9:15]},
    "bearing_deg": 4,
    "range_m": 4,
}
"""The columns of targets.csv behind time, name and state, each a field of `TargetReport`."""
TARGET_HEADER = ",".join(("t_s", "name", "state", *TARGET_DECIMALS))
RESIDUAL_HEADER = "t_s,device,beacon,component,before,after,sigma"


class ReplayFiles:
    """The open files of one replay, used as a context manager.

    Parameters
    ----------
    folder
        Where they go; made if it is not there. Files of an earlier replay are replaced.

    Raises
    ------
    UsblnavError
        From every method, with one line naming the file, where it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._targets: _Table | None = None

    def __enter__(self) -> "ReplayFiles":
        with _naming(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            self._nav = self._table(stack, "nav.csv", NAV_HEADER)
            self._innovations = self._table(stack, "innovations.csv", INNOVATION_HEADER)
            self._calibration = self._table(stack, "calibration.csv", CALIBRATION_HEADER)
            self._residuals = self._table(stack, "residuals.csv", RESIDUAL_HEADER)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exc: object) -> None:
        self._stack.close()

    def nav(self, report: NavReport) -> None:
        """Add one row to nav.csv."""
        row = [f"{getattr(report, name):.{d}f}" for name, d in NAV_DECIMALS.items()]
        self._nav.add([seconds(report.utc_ns), *row, report.mode.value])

    def innovation(self, report: InnovationReport) -> None:
        """Add a row for each component to innovations.csv, one without for a fix that has none."""
        start = [seconds(report.utc_ns), report.device, report.beacon]
        nis = "" if report.nis is None else f"{report.nis:.6f}"
        end = [nis, str(int(report.accepted)), report.reason]
        rows = [[c.name, f"{c.value:.6f}", f"{c.sigma:.6f}"] for c in report.components]
        for row in rows or [["", "", ""]]:
            self._innovations.add([*start, *row, *end])

    def calibration(self, report: CalibrationReport) -> None:
        """Add a row for each constant to calibration.csv."""
        time = seconds(report.utc_ns)
        for name, c in report.constants.items():
            self._calibration.add([time, name, f"{c.value:.9f}", f"{c.sigma:.9f}"])

    def target(self, report: TargetReport) -> None:
        """Add a row to targets.csv, which is there only where something is followed."""
        if self._targets is None:
            self._targets = self._table(self._stack, "targets.csv", TARGET_HEADER)
        row = [f"{getattr(report, name):.{d}f}" for name, d in TARGET_DECIMALS.items()]
        self._targets.add([seconds(report.utc_ns), report.name, report.state, *row])

    def residual(self, utc_ns: int, source: Sequence[str], numbers: Sequence[float]) -> None:
        """Add a row to residuals.csv: device, beacon, component; before, after, sigma."""
        self._residuals.add([seconds(utc_ns), *source, *(f"{number:.6f}" for number in numbers)])

    def covariance(self, names: Sequence[str], covariance: Sequence[Sequence[float]]) -> None:
        """Write calibration_covariance.csv: a row and a column for each name, its unit squared."""
        table = _Table(self._folder / "calibration_covariance.csv", ",".join(["name", *names]))
        for name, row in zip(names, covariance, strict=True):
            table.add([name, *(f"{number:.9e}" for number in row)])
        table.close()

    def config(self, config: msgspec.Struct) -> None:
        """Write config.yaml, every default spelled out."""
        path = self._folder / "config.yaml"
        with _naming(path):
            path.write_text(yaml.safe_dump(msgspec.to_builtins(config), sort_keys=False))

    def summary(self, summary: msgspec.Struct | dict[str, Any]) -> None:
        """Write summary.json."""
        path = self._folder / "summary.json"
        text = msgspec.json.format(msgspec.json.encode(summary), indent=2)
        with _naming(path):
            path.write_bytes(text + b"\n")

    def _table(self, stack: ExitStack, name: str, header: str) -> "_Table":
        table = _Table(self._folder / name, header)
        stack.callback(table.close)
        return table


class _Table:
    """One CSV file, whose faults are one line."""

    def __init__(self, path: Path, header: str) -> None:
        self._path = path
        with _naming(path):
            self._file: TextIO = path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self.add(header.split(","))

    def add(self, row: Sequence[str]) -> None:
        """Write one row."""
        with _naming(self._path):
            self._writer.writerow(row)

    def close(self) -> None:
        """Write what is still buffered; a full disk often shows only here."""
        with _naming(self._path):
            self._file.close()


def seconds(utc_ns: int) -> str:
    """Unix seconds with six decimals, rounded from whole nanoseconds (halves up)."""
    whole, micro = divmod((utc_ns + 500) // 1000, 1_000_000)
    return f"{whole}.{micro:06d}"


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise UsblnavError(f"{path}: cannot write: {error.strerror or error}") from error
