"""A live run is recorded, and its recording replayed to the solutions that were published."""

import os
import random
import signal
import subprocess
import time
from pathlib import Path

import pytest

from drivers.hosttime import now_ns
from gateway.outputs.files import seconds
from gateway.recording.events import Raw, Report
from gateway.recording.reader import RecordedRun
from tests.gateway.recorded import topics
from tests.integration.rig import USBLNAV, Rig, brisk
from tests.shared_data import ROOT

pytestmark = pytest.mark.live

TABLES = ["nav.csv", "innovations.csv", "calibration.csv"]


class Taped:
    """A rig whose gateway records."""

    def __init__(
        self,
        folder: Path,
        duration_s: float = 120.0,
        imu_hz: float | None = None,
        **settings: object,
    ) -> None:
        self._folder = folder
        self.tapes = folder / "tapes"
        self.tapes.mkdir()
        scenario = brisk(folder) | {"duration_s": duration_s}
        if imu_hz is not None:
            scenario["devices"]["imu0"]["rate_hz"] = imu_hz
        self.rig = Rig(folder, scenario)
        self.rig.write({"recording": {"folder": str(self.tapes), **settings}})

    def parts(self) -> list[Path]:
        return sorted(self.tapes.glob("*.mcap"))

    def run(self) -> RecordedRun:
        return RecordedRun(self.parts())

    def table(self, command: str, name: str) -> bytes:
        """What `export` or `replay` writes."""
        out = self._folder / command
        if not out.exists():
            done = subprocess.run(
                [*USBLNAV, command, *reversed(self.parts()), "-o", out],
                capture_output=True,
                text=True,
                cwd=ROOT,
                check=False,
            )
            assert (done.returncode, done.stderr) == (0, "")
        return (out / name).read_bytes()


async def test_a_replay_of_a_live_run_gives_its_solutions(tmp_path: Path) -> None:
    taped = Taped(tmp_path, max_file_s=2)
    rig = taped.rig
    async with rig.gateway(), rig.emulator():
        rig.hear_zenoh()
        await rig.until("five fixes", lambda: rig.navs and rig.navs[-1].fixes_used >= 5)
        await rig.until("a second part", lambda: taped.parts()[1:])
        tape = rig.statuses[-1]["outputs"][-1]
        assert tape["name"] == f"recording {taped.tapes}"
        assert tape["up"]
        heard = list(rig.navs)
    for name in TABLES:
        assert taped.table("replay", name) == taped.table("export", name)
    rows = taped.table("export", "nav.csv").decode().splitlines()
    assert {seconds(nav.utc_ns) for nav in heard} <= {row.split(",")[0] for row in rows}
    assert len(taped.table("export", "innovations.csv").splitlines()) > 15
    run = taped.run()
    assert list(run.events())
    assert (run.counts.missing, run.counts.repeated, run.counts.unclosed) == (0, 0, 0)
    found = set().union(*(topics(part) for part in taped.parts()))
    assert found >= {"/raw/usbl0", "/records/imu0/imu", "/nav", "/location", "/status", "/utc"}


async def test_of_a_run_that_is_killed_a_second_is_lost_at_most(tmp_path: Path) -> None:
    taped = Taped(tmp_path)
    rig = taped.rig
    async with rig.emulator(), rig.gateway(ends=-signal.SIGKILL):
        await rig.until("a true position", rig.is_right)
        seen = len(rig.epochs)
        await rig.until("half a second more", lambda: len(rig.epochs) > seen + 5)
        os.killpg(rig.process.pid, signal.SIGKILL)
        killed_ns = now_ns()
    run = taped.run()
    events = list(run.events())
    assert killed_ns - max(e.t_rx_ns for e in events if isinstance(e, Raw)) < 1_000_000_000
    assert any(isinstance(event, Report) for event in events)
    assert (run.counts.missing, run.counts.unclosed) == (0, 1)
    live, again = (taped.table(command, "nav.csv") for command in ("export", "replay"))
    assert again.startswith(live)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("imu_hz", [200.0, 1000.0])
async def test_ten_minutes_with_a_filter_that_is_killed(tmp_path: Path, imu_hz: float) -> None:
    """``pytest -m slow tests/integration/test_recording.py``."""
    taped = Taped(tmp_path, duration_s=720.0, imu_hz=imu_hz, max_file_s=60)
    rig = taped.rig
    rng = random.Random(4)
    async with rig.gateway(), rig.emulator():
        end = time.monotonic() + 600.0
        await rig.until("a true position", rig.is_right)
        while time.monotonic() < end:
            seen, pause = len(rig.epochs), rng.randrange(200, 1200)
            await rig.until("time", lambda s=seen, p=pause: len(rig.epochs) > s + p, 300.0)
            os.kill(rig.worker(), signal.SIGKILL)
            await rig.until("a true position again", rig.is_right)
    for name in TABLES:
        assert taped.table("replay", name) == taped.table("export", name)
    assert len(taped.table("export", "nav.csv").splitlines()) > 5500
