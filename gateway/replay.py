"""Captured traffic through the same intake and estimator as the daemon's, as fast as they go."""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from drivers.capture.files import CaptureError
from drivers.capture.streams import CaptureCounts, Payload, read_streams
from gateway.config import Config
from gateway.errors import UsblnavError
from gateway.estimator import Estimator
from gateway.ingest import Intake, intakes
from gateway.messages import (
    Calibration,
    FilterOutput,
    Innovation,
    Measurement,
    NavSolution,
)
from gateway.outputs.files import ReplayFiles
from gateway.outputs.schema import calibration_report, innovation_report, nav_report

CHUNKS_PER_BLOCK = 64
"""IMU chunks gathered for one call of the filter, where no fix comes between; the result does not
depend on it."""


def run(
    captures: list[Path], config: Config, *, out: Path, rate_hz: float, origin: str = "auto"
) -> dict[str, Any]:
    """Replay captures into the files of `out`; give the summary that is written there.

    Raises
    ------
    UsblnavError
        For a capture that cannot be read to its end (what came before is written), one without a
        byte for any device, or files that cannot be written.
    """
    begun = time.perf_counter()
    devices = intakes(config)
    estimator = Estimator(config, rate_hz)
    counts = CaptureCounts()
    links = {name: device.link for name, device in config.devices.items()}
    last: Calibration | None = None
    traffic = _Traffic(read_streams(captures, links, counts))
    with ReplayFiles(out) as files:
        for measurement in _measurements(traffic, devices):
            for output in estimator.feed(measurement):
                _write(files, output)
                last = output if isinstance(output, Calibration) else last
        ran_s = time.perf_counter() - begun
        summary = _summary(estimator, devices, counts, last, traffic.seconds, ran_s)
        files.summary(summary)
    if traffic.fault is not None:
        raise UsblnavError(str(traffic.fault)) from traffic.fault
    if not counts.selected:
        raise UsblnavError(
            f"{', '.join(map(str, captures))}: no packet for any device of the configuration"
            f" ({counts.packets} packets read)"
        )
    return summary


class _Traffic:
    """The payloads of captures up to their end or to where they cannot be read any further."""

    def __init__(self, payloads: Iterable[Payload]) -> None:
        self.fault: CaptureError | None = None
        self._payloads = payloads
        self._first_ns: int | None = None
        self._last_ns = 0

    def __iter__(self) -> Iterator[Payload]:
        try:
            for payload in self._payloads:
                if self._first_ns is None:
                    self._first_ns = payload[2]
                self._last_ns = payload[2]
                yield payload
        except CaptureError as error:
            self.fault = error

    @property
    def seconds(self) -> float:
        """From the first arrival to the last."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) * 1e-9


def _measurements(payloads: Iterable[Payload], devices: dict[str, Intake]) -> Iterator[Measurement]:
    """Measurements in the order in which their bytes arrived."""
    gathered: str | None = None
    chunks = 0
    for name, data, t_rx_ns in payloads:
        if gathered is not None and (name != gathered or chunks >= CHUNKS_PER_BLOCK):
            yield from devices[gathered].flush()
            chunks = 0
        devices[name].feed(data, t_rx_ns)
        gathered, chunks = name, chunks + 1
    for device in devices.values():
        device.close()
        yield from device.flush()


def _write(files: ReplayFiles, output: FilterOutput) -> None:
    """Put an output of the filter where it belongs; packet times are Unix times already."""
    if isinstance(output, NavSolution):
        files.nav(nav_report(output, 0))
    elif isinstance(output, Innovation):
        files.innovation(innovation_report(output, 0))
    elif isinstance(output, Calibration):
        files.calibration(calibration_report(output, 0))


def _summary(
    estimator: Estimator,
    devices: dict[str, Intake],
    capture: CaptureCounts,
    last: Calibration | None,
    seconds: float,
    ran_s: float,
) -> dict[str, Any]:
    """What summary.json holds."""
    totals = estimator.counts()
    return {
        "devices": {name: _device(intake) for name, intake in devices.items()},
        "capture": msgspec.to_builtins(capture),
        "filter": {
            "imu_samples": totals.imu_samples,
            "fixes_used": totals.fixes_used,
            "gated": totals.fixes_gated,
            "late": totals.fixes_late,
            "too_late": totals.fixes_too_late,
            "duplicate": totals.fixes_duplicate,
            "resets": totals.resets,
        },
        "calibration": _constants(last),
        "duration_s": round(seconds, 3),
        "run_time_s": round(ran_s, 3),
        "real_time_factor": round(seconds / ran_s, 1),
    }


def _device(intake: Intake) -> dict[str, Any]:
    """Counts of one device."""
    counts = intake.counts
    return {
        "bytes": counts.bytes,
        "records": counts.records,
        "measurements": counts.measurements,
        "rejected": dict(counts.rejected),
        "rejected_bytes": counts.rejected_bytes,
        "ignored": dict(counts.ignored),
        "gaps": counts.gaps,
        "missing": counts.missing,
    }


def _constants(last: Calibration | None) -> dict[str, dict[str, float]]:
    """Final calibration by name."""
    if last is None:
        return {}
    return {c.name: {"value": c.value, "sigma": c.sigma} for c in last.constants}
