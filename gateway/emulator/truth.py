"""The truth as a CSV file: written ahead of the clock, read while it grows."""

from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from gateway.emulator.trajectory import Trajectory
from gateway.nav.attitude import turn

_ROW = "{:.6f},{:.12f},{:.12f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f}\n"
_BLOCK_S = 1.0


class TruthRow(NamedTuple):
    """One row of the file, with the columns of ``nav.csv``; ``t_s`` is Unix time."""

    t_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    vn_m_s: float
    ve_m_s: float
    vd_m_s: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float


class TruthWriter:
    """Writes rows at ``rate_hz`` up to, but never behind, the time it is asked for."""

    def __init__(
        self, file: TextIO, trajectory: Trajectory, start_unix_s: float, rate_hz: float = 10.0
    ) -> None:
        self._file = file
        self._trajectory = trajectory
        self._start = start_unix_s
        self._rate = rate_hz
        self._rows = 0
        file.write(",".join(TruthRow._fields) + "\n")

    def write_until(self, t: float) -> None:
        """Make sure the file holds the truth to ``t`` (s after the start) and a little beyond."""
        if self._rows > t * self._rate + 1.0:
            return
        until = int((t + _BLOCK_S) * self._rate) + 1
        times = np.arange(self._rows, until) / self._rate
        g = self._trajectory.geodetic(times)
        attitude = np.rad2deg(np.column_stack([g.roll, g.pitch, g.heading % (2.0 * np.pi)]))
        position = np.column_stack([np.rad2deg(g.lat), np.rad2deg(g.lon), g.h])
        table = np.column_stack([self._start + times, position, g.v_eb_n, attitude])
        self._file.writelines(_ROW.format(*row) for row in table.tolist())
        self._file.flush()
        self._rows = until


class TruthFile:
    """Reads a truth file that may still be growing, and interpolates it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = 0
        self._rest = ""
        self._table = np.empty((0, len(TruthRow._fields)))

    def at(self, t_s: float) -> TruthRow | None:
        """Truth at a Unix time, linear between rows; None outside what the file holds so far."""
        if not self._covers(t_s):
            self._refresh()
        if not self._covers(t_s):
            return None
        table = self._table
        k = max(1, int(np.searchsorted(table[:, 0], t_s)))
        before, after = table[k - 1], table[k]
        step = after - before
        step[-1] = turn(step[-1], 360.0)
        row = before + step * (t_s - before[0]) / (after[0] - before[0])
        row[-1] %= 360.0
        return TruthRow(*row.tolist())

    def _covers(self, t_s: float) -> bool:
        return len(self._table) > 1 and bool(self._table[0, 0] <= t_s <= self._table[-1, 0])

    def _refresh(self) -> None:
        if not self._path.exists():
            return
        with self._path.open(encoding="ascii") as file:
            file.seek(self._read)
            text = self._rest + file.read()
            self._read = file.tell()
        *lines, self._rest = text.split("\n")
        rows = [line.split(",") for line in lines if line and line[0] != "t"]
        if rows:
            self._table = np.vstack([self._table, np.array(rows, dtype=np.float64)])
