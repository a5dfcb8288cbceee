"""Speed and memory of whole replays, each in a process of its own."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import msgspec
import pytest
import yaml

from gateway.emulator import twin
from gateway.emulator.player import emulate
from tests.shared_data import ROOT, shared

RUNS = 3
Row = tuple[str, float, str]
"""What was measured, its median, its unit."""


@dataclass(frozen=True)
class Source:
    """A capture of 25 minutes at 200 Hz with its configuration."""

    name: str
    capture: Path
    config: Path


def source(folder: Path) -> Source:
    """The shared capture, or where there is none one of the packaged scenario."""
    try:
        place = shared("captures", "lawnmower")
    except pytest.skip.Exception:
        return _emulated(folder)
    return Source("lawnmower", place / "capture.pcap.gz", place / "config.yaml")


def _emulated(folder: Path) -> Source:
    made = Source("packaged scenario", folder / "demo.pcap", folder / "config.yaml")
    demo = msgspec.structs.replace(twin.load(twin.DEMO), duration_s=1500.0)
    scenario = twin.for_capture(demo)
    emulate(scenario, pcap=made.capture, say=lambda _line: None)
    made.config.write_text(yaml.safe_dump(twin.gateway_config(scenario)))
    return made


def measure(source: Source, folder: Path) -> list[Row]:
    """Times real time, by the clock and by processor time (start included), and peak memory."""
    factors, cpu_factors, peaks = [], [], []
    for _ in range(RUNS):
        command = [sys.executable, "-m", "gateway", "replay", source.capture]
        options = ["-c", source.config, "-o", folder / "out"]
        with subprocess.Popen([*command, *options], cwd=ROOT, stdout=subprocess.DEVNULL) as run:
            _, status, usage = os.wait4(run.pid, 0)
            run.returncode = os.waitstatus_to_exitcode(status)
        assert run.returncode == 0
        summary = json.loads((folder / "out" / "summary.json").read_text())
        factors.append(summary["real_time_factor"])
        cpu_factors.append(summary["duration_s"] / (usage.ru_utime + usage.ru_stime))
        peaks.append(usage.ru_maxrss / 1024)
    return [
        ("replay on one core", median(factors), "times real time"),
        ("replay, by processor time", median(cpu_factors), "times real time"),
        ("replay, peak memory", median(peaks), "MB"),
    ]
