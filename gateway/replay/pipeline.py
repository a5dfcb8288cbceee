"""Captured or recorded traffic through the daemon's intake and estimator, as fast as they go."""

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from drivers.capture.streams import Payload
from gateway.config import Config
from gateway.errors import UsblnavError
from gateway.fusion.initial import initial_state
from gateway.fusion.report import calibration, calibration_covariance
from gateway.ingest import Intake, intakes
from gateway.messages import (
    Calibration,
    FilterOutput,
    Innovation,
    Measurement,
    NavSolution,
    TargetSighting,
)
from gateway.outputs.files import ReplayFiles
from gateway.outputs.following import target_report
from gateway.outputs.schema import calibration_report, innovation_report, nav_report
from gateway.progress import Tell, nobody
from gateway.recording.events import Pulse
from gateway.replay.passes import ForwardPass, SmoothedPass
from gateway.replay.traffic import Traffic, open_traffic
from gateway.targets import Targets

CHUNKS_PER_BLOCK = 64
"""IMU chunks gathered for one call of the filter, where no fix comes between; the result does not
depend on it."""


LOOSE = "loose"
"""In place of an error definition: the configured one, with fixes as positions."""


def run(
    captures: Sequence[Path],
    config: Config | None,
    *,
    out: Path,
    rate_hz: float | None = None,
    filters: Sequence[str] = (),
    smooth: bool = False,
    tell: Tell = nobody,
) -> dict[str, Any]:
    """Replay captures or a recording into the files of `out`; give the summary written there.

    Parameters
    ----------
    config, rate_hz
        None takes those of the recording.
    filters
        Error definitions (or `LOOSE`) to run side by side on the same input. With more than one,
        each writes into a folder of its name, and what is given back is
        ``{"filters": {name: summary}}``; with none, the configured one runs.
    smooth
        Whether every solution is made from all measurements, the later ones too.
    tell
        Is told how far it is.

    Raises
    ------
    UsblnavError
        For a capture that cannot be read to its end (what came before is written), one without a
        byte for any device, or files that cannot be written.
    """
    begun = time.perf_counter()
    traffic = open_traffic(captures, config, rate_hz)
    config = traffic.config
    devices = intakes(config, traffic.resume.clocks)
    with ExitStack() as stack:
        runs = {
            name: _Run(
                chosen(config, name) if filters else config,
                stack.enter_context(ReplayFiles(out / name if len(filters) > 1 else out)),
                traffic,
                smooth,
                _named(tell, name) if len(filters) > 1 else tell,
            )
            for name in filters or (config.filter.error,)
        }
        for measurement in measurements(traffic, devices):
            for one in runs.values():
                one.take(measurement)
            tell("reading" if smooth else "replaying", traffic.share)
        common = {
            "devices": {name: _device(name, intake) for name, intake in devices.items()},
            **traffic.told(),
        }
        summaries = {n: one.close(common, begun) for n, one in runs.items()}
    if traffic.fault is not None:
        raise UsblnavError(str(traffic.fault)) from traffic.fault
    return {"filters": summaries} if len(filters) > 1 else next(iter(summaries.values()))


def chosen(config: Config, name: str) -> Config:
    """The configuration with another filter."""
    what = {"coupling": "loose"} if name == LOOSE else {"error": name, "coupling": "tight"}
    block = msgspec.structs.replace(config.filter, **what)
    return msgspec.structs.replace(config, filter=block)


def _named(tell: Tell, name: str) -> Tell:
    """Tell of several filters, each by its name."""
    return lambda what, share: tell(f"{name}, {what}", share)


class _Run:
    """One filter on the traffic, the files it fills and what it amounts to."""

    def __init__(
        self, config: Config, files: ReplayFiles, traffic: Traffic, smooth: bool, tell: Tell
    ) -> None:
        how = config, traffic.rate_hz, traffic.resume.state
        self._config = config
        self._files = files
        self._traffic = traffic
        self._targets = Targets(traffic.config.targets)
        self._pass = SmoothedPass(*how, tell) if smooth else ForwardPass(*how)
        self._smooth = smooth
        self._calibration: Calibration | None = None
        self._solution: NavSolution | None = None
        self._nis: list[tuple[float, int]] = []
        self._beacons: dict[str, dict[str, Any]] = {}

    def take(self, measurement: Measurement) -> None:
        """Take the next measurement."""
        for output in self._pass.feed(measurement):
            self._write(output)

    def close(self, common: dict[str, Any], begun: float) -> dict[str, Any]:
        """Write what remains; give the summary."""
        utc, seconds = self._traffic.utc, self._traffic.seconds
        for output in self._pass.finish():
            self._write(output)
        for row in self._pass.residuals():
            self._files.residual(row.t_ns + utc.at(row.t_ns), row[1:4], row[4:])
        last = self._pass.last()
        if last is not None:
            names, P = calibration_covariance(last)
            self._files.covariance(names, P.tolist())
        self._files.config(self._config)
        ran_s = time.perf_counter() - begun
        summary = common | {
            "filter": self._filter(),
            "beacons": self._beacons,
            "final_sigma": _final_sigma(self._solution),
            "calibration": self._constants(),
            "duration_s": round(seconds, 3),
            "run_time_s": round(ran_s, 3),
            "real_time_factor": round(seconds / ran_s, 1),
        }
        self._files.summary(summary)
        return summary

    def _write(self, output: FilterOutput) -> None:
        """Put an output where it belongs."""
        offset_ns = self._traffic.utc.at(output.t_ns)
        if isinstance(output, NavSolution):
            self._solution = output
            nav = nav_report(output, offset_ns)
            self._files.nav(nav)
            for followed in self._targets.due(output.t_ns):
                self._files.target(target_report(followed, nav))
        elif isinstance(output, TargetSighting):
            self._targets.take(output)
        elif isinstance(output, Innovation):
            if output.accepted and math.isfinite(output.nis):
                self._nis.append((output.nis, len(output.components)))
            self._count_beacon(output)
            self._files.innovation(innovation_report(output, offset_ns))
        elif isinstance(output, Calibration):
            self._calibration = output
            self._files.calibration(calibration_report(output, offset_ns))

    def _count_beacon(self, verdict: Innovation) -> None:
        """Count what became of a beacon's fixes; its quality is that of the last one heard."""
        if not verdict.beacon:
            return
        beacon = self._beacons.setdefault(
            verdict.beacon, {"used": 0, "refused": 0, "quality": None}
        )
        beacon["used" if verdict.accepted else "refused"] += 1
        if verdict.quality is not None:
            beacon["quality"] = _rounded(verdict.quality, 4)

    def _filter(self) -> dict[str, Any]:
        """Which filter it was, its totals, and whether its innovations were as it said."""
        totals, block = self._pass.counts(), self._config.filter
        nis, rows = np.mean(self._nis, axis=0) if self._nis else (math.nan, math.nan)
        return {
            "error": block.error,
            "coupling": block.coupling,
            "smoothed": self._smooth,
            "imu_samples": totals.imu_samples,
            "fixes_used": totals.fixes_used,
            "gated": totals.fixes_gated,
            "late": totals.fixes_late,
            "too_late": totals.fixes_too_late,
            "too_early": totals.fixes_too_early,
            "duplicate": totals.fixes_duplicate,
            "resets": totals.resets,
            "mean_nis": _rounded(nis, 4),
            "expected_nis": _rounded(rows, 4),
        }

    def _constants(self) -> dict[str, dict[str, float]]:
        """Final calibration by name, with the sigma that each constant began with."""
        if self._calibration is None:
            return {}
        first = calibration(initial_state(self._config), 0)
        prior = {c.name: c.sigma for c in first.constants}
        return {
            c.name: {"value": c.value, "sigma": c.sigma, "prior": prior[c.name]}
            for c in self._calibration.constants
        }


def measurements(
    traffic: Iterable[Payload | Pulse], devices: dict[str, Intake]
) -> Iterator[Measurement]:
    """Measurements in the order in which their bytes arrived."""
    gathered: Intake | None = None
    chunks = 0
    for item in traffic:
        line = devices[item.device]
        if isinstance(item, Pulse):
            if gathered is line:
                yield from line.flush()
                gathered = None
            line.pulse(item.t_ns, item.device)
            continue
        if gathered is not None and (line is not gathered or chunks >= CHUNKS_PER_BLOCK):
            yield from gathered.flush()
            chunks = 0
        line.feed(item.data, item.t_rx_ns, item.source)
        gathered, chunks = line, chunks + 1
    for line in dict.fromkeys(devices.values()):
        line.close()
        yield from line.flush()


def _device(name: str, intake: Intake) -> dict[str, Any]:
    """Counts of one device; those of the bytes are where the line has its name from."""
    ingest = intake.ingests[name]
    counts = ingest.counts
    return {
        "line": intake.name,
        "bytes": counts.bytes,
        "records": counts.records,
        "measurements": counts.measurements,
        "rejected": dict(counts.rejected),
        "rejected_bytes": counts.rejected_bytes,
        "ignored": dict(counts.ignored),
        "gaps": counts.gaps,
        "missing": counts.missing,
        "clock": msgspec.to_builtins(ingest.clock_report()),
    }


def _final_sigma(last: NavSolution | None) -> dict[str, float]:
    """How sure the last solution was."""
    if last is None:
        return {}
    (n, e, d), (_, _, heading) = last.sd_position, last.sd_attitude
    return {
        "horizontal_m": round(math.hypot(n, e), 4),
        "vertical_m": round(d, 4),
        "heading_deg": round(math.degrees(heading), 5),
    }


def _rounded(number: float, decimals: int) -> float | None:
    """A number as JSON can say it."""
    return round(float(number), decimals) if math.isfinite(number) else None
