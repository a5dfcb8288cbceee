"""What a live run published, from its recording, as the files that a replay writes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from drivers.capture.files import CaptureError
from gateway.errors import UsblnavError
from gateway.outputs.files import ReplayFiles
from gateway.outputs.schema import CalibrationReport, InnovationReport, NavReport, TargetReport
from gateway.recording.events import Report
from gateway.recording.reader import RecordedRun


def export(recordings: Sequence[Path], out: Path) -> dict[str, Any]:
    """Write the recorded solutions, innovations and constants into `out`; give the counts.

    Raises
    ------
    UsblnavError
        For a recording that cannot be read to its end (what came before is written), or files that
        cannot be written.
    """
    try:
        run = RecordedRun(recordings)
        with ReplayFiles(out) as files:
            files.config(run.config())
            try:
                for event in run.events():
                    if isinstance(event, Report):
                        _write(files, event)
            finally:
                told = {"recording": msgspec.to_builtins(run.counts)}
                files.summary(told)
    except (CaptureError, msgspec.MsgspecError, ValueError) as error:
        raise UsblnavError(str(error)) from error
    return told


def _write(files: ReplayFiles, report: Report) -> None:
    match report.topic:
        case "nav":
            files.nav(msgspec.json.decode(report.data, type=NavReport))
        case "innovation":
            files.innovation(msgspec.json.decode(report.data, type=InnovationReport))
        case "calibration":
            files.calibration(msgspec.json.decode(report.data, type=CalibrationReport))
        case "target":
            files.target(msgspec.json.decode(report.data, type=TargetReport))
        case "status":
            pass
