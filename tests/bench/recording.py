"""What recording costs: processor time of the daemon's end and of the writer, at 1 kHz."""

import asyncio
import os
import tempfile
import time
from itertools import cycle, islice
from pathlib import Path

import msgspec

from drivers.capture.streams import read_streams
from gateway.clock.utc import UtcHistory
from gateway.config import Config, Recording, load
from gateway.estimator import Estimator
from gateway.ingest import intakes
from gateway.messages import NavSolution
from gateway.outputs.schema import NavReport, nav_report
from gateway.recording.host import Recorder
from tests.bench.replayed import Row, Source

RATE_HZ = 1000
SOLUTIONS_HZ = 100
SECONDS = 10.0
TICK_S = 0.005


def measure(source: Source) -> list[Row]:
    """Percent of a core, with decoded records and without."""
    config = load(source.config)
    rows: list[Row] = []
    for records in (True, False):
        with tempfile.TemporaryDirectory() as folder:
            settings = Recording(folder=folder, records=records)
            daemon, writer, size = asyncio.run(_record(source, config, settings))
        what = "records and all" if records else "without decoded records"
        rows += [
            (f"recording 1 kHz, {what}: daemon", daemon, "% of a core"),
            (f"recording 1 kHz, {what}: writer", writer, "% of a core"),
            (f"recording 1 kHz, {what}", size, "MB an hour"),
        ]
    return rows


async def _record(
    source: Source, config: Config, settings: Recording
) -> tuple[float, float, float]:
    """Processor time of both ends over wall time, and what was written."""
    chunks, solution = _material(source, config)
    idle = await _feed(None, config, chunks, solution)
    recorder = Recorder(settings, config, SOLUTIONS_HZ)
    running = asyncio.create_task(recorder.run())
    recorder.utc(UtcHistory().sample(time.monotonic_ns(), 0))
    await recorder.up.wait()
    (writer,) = _children()
    before = _processor_s(writer)
    busy = await _feed(recorder, config, chunks, solution)
    written = _processor_s(writer) - before
    assert recorder.status().dropped == 0
    running.cancel()
    await asyncio.wait([running])
    size = sum(entry.stat().st_size for entry in os.scandir(settings.folder))
    share = 100.0 / SECONDS
    return (busy - idle) * share, written * share, size * 3600.0 / SECONDS / 1e6


async def _feed(
    recorder: Recorder | None, config: Config, chunks: "cycle[bytes]", solution: NavReport
) -> float:
    """Processor seconds of this process at the pace of a live run, or of doing nothing at it."""
    imu, _ = config.imu
    spent, begun, sent = time.process_time(), time.perf_counter(), 0
    while (elapsed := time.perf_counter() - begun) < SECONDS:
        due = int(elapsed * RATE_HZ)
        for data in islice(chunks, due - sent):
            t_ns = time.monotonic_ns()
            sent += 1
            if recorder is not None:
                recorder.raw(imu, data, t_ns)
                if sent % (RATE_HZ // SOLUTIONS_HZ) == 0:
                    recorder.nav(msgspec.structs.replace(solution, utc_ns=time.time_ns()))
        await asyncio.sleep(TICK_S)
    return time.process_time() - spent


def _material(source: Source, config: Config) -> tuple["cycle[bytes]", NavReport]:
    """Chunks of the inertial unit without end, and a solution."""
    links = {name: device.link for name, device in config.devices.items()}
    imu, _ = config.imu
    devices, estimator = intakes(config), Estimator(config, 10.0)
    chunks, report = [], None
    for name, data, t_ns, _ in islice(read_streams([source.capture], links), 4000):
        if name == imu:
            chunks.append(data)
        devices[name].feed(data, t_ns)
        for measurement in devices[name].flush():
            for output in estimator.feed(measurement):
                if isinstance(output, NavSolution):
                    report = nav_report(output, 0)
    assert report is not None
    return cycle(chunks), report


def _children() -> list[int]:
    """Process ids of this process's children."""
    tasks = Path("/proc/self/task").iterdir()
    return [int(pid) for task in tasks for pid in (task / "children").read_text().split()]


def _processor_s(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
