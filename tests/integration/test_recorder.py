"""The recorder with its writer as a process: what disks and signals do to it, and what is lost."""

import asyncio
import logging
import os
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from gateway.config import Recording
from gateway.recording import host
from gateway.recording.events import Raw
from gateway.recording.host import Recorder
from gateway.recording.reader import RecordedRun
from tests.gateway.recorded import config, files, raw, topics, utc
from tests.integration.disks import fill
from tests.integration.rig import comm

pytestmark = pytest.mark.live

PERIOD_S = 0.005


class Feeding:
    """A recorder that is given a chunk each 5 ms."""

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.recorder = Recorder(Recording(folder=str(folder), **settings), config(), 10.0)
        self.recorder.utc(utc())
        self.fed = 0
        self._news = asyncio.Event()

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Feed while the body runs; the recorder then ends as the daemon ends it."""
        tasks = [asyncio.create_task(self.recorder.run()), asyncio.create_task(self._feed())]
        try:
            yield
        finally:
            for task in tasks[::-1]:
                task.cancel()
                await asyncio.wait([task])

    async def until(self, condition: Callable[[], Any], within_s: float = 60.0) -> None:
        """Wait until the condition holds, looking as often as a chunk is fed."""
        async with asyncio.timeout(within_s):
            while not condition():
                self._news.clear()
                await self._news.wait()

    async def _feed(self) -> None:
        while True:
            chunk = raw(self.fed, 400)
            self.recorder.raw(chunk.device, chunk.data, chunk.t_rx_ns)
            self.fed += 1
            self._news.set()
            await asyncio.sleep(PERIOD_S)

    async def saved(self, more: int = 100) -> None:
        """Wait until so much more is on disk than was fed by now."""
        goal = self.fed + more
        await self.until(lambda: self.recorder.status().sent > goal)


def chunks(run: RecordedRun) -> list[int]:
    """The numbers of the chunks in a recording."""
    return [int.from_bytes(e.data[:8], "little") for e in run.events() if isinstance(e, Raw)]


def writers() -> list[int]:
    """Process ids of living writers of this process, by what `ps` calls them."""
    found: list[int] = []
    for task in Path("/proc/self/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # threads end
            found += map(int, (task / "children").read_text().split())
    return [pid for pid in found if comm(pid) == "usblnav-record"]


def said(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.message for record in caplog.records if "recording" in record.message]


@pytest.fixture(autouse=True)
def _log(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)


async def test_a_killed_writer_costs_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    feeding = Feeding(tmp_path)
    async with feeding.running():
        await feeding.saved()
        (writer,) = writers()
        os.kill(writer, signal.SIGKILL)
        await feeding.until(lambda: writers() not in ([], [writer]))
        await feeding.saved()
    run = RecordedRun(files(tmp_path))
    assert chunks(run) == list(range(feeding.fed))
    assert (run.counts.files, run.counts.unclosed, run.counts.missing) == (2, 1, 0)
    assert topics(files(tmp_path)[1])["/raw/usbl0"] > 100
    lost, back = said(caplog)
    assert lost == "recording: writer was killed by SIGKILL; trying until it is back"
    assert back.startswith("recording: back after ")


async def test_a_missing_folder_is_waited_for(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "card"
    feeding = Feeding(folder)
    async with feeding.running():
        await feeding.until(lambda: said(caplog))
        status = feeding.recorder.status()
        assert (status.up, status.error) == (False, f"{folder}: no such file or directory")
        folder.mkdir()
        await feeding.saved()
        assert feeding.recorder.status().up
    assert chunks(RecordedRun(files(folder))) == list(range(feeding.fed))
    lost, back = said(caplog)
    assert lost == f"recording: {folder}: no such file or directory; trying until it is back"
    assert back.startswith("recording: back after ")


async def test_what_is_removed_under_way_is_said_and_recording_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Into a file without a name everything would be written, and be gone."""
    folder = tmp_path / "card"
    folder.mkdir()
    feeding = Feeding(folder)
    async with feeding.running():
        await feeding.saved()
        (tape,) = files(folder)
        tape.unlink()
        folder.rmdir()
        await feeding.until(lambda: said(caplog))
        folder.mkdir()
        await feeding.saved()
        assert feeding.recorder.status().up
    run = RecordedRun(files(folder))
    heard = chunks(run)
    assert heard == list(range(heard[0], feeding.fed))
    assert run.counts.missing > 0
    lost, back = said(caplog)
    assert (
        lost == f"recording: {folder}: {tape.name} was removed under way; trying until it is back"
    )
    assert back.startswith("recording: back after ")


async def test_a_full_disk_is_waited_for(
    small_disk: Path, caplog: pytest.LogCaptureFixture
) -> None:
    feeding = Feeding(small_disk)
    filler = small_disk / "filler"
    async with feeding.running():
        await feeding.saved()
        fill(filler)
        await feeding.until(lambda: said(caplog))
        assert said(caplog) == [
            f"recording: {small_disk}: no space left on device; trying until it is back"
        ]
        await feeding.until(lambda: feeding.recorder.status().error)
        filler.unlink()
        await feeding.saved(10)
    run = RecordedRun(files(small_disk))
    assert chunks(run) == list(range(feeding.fed))
    assert run.counts.missing == 0
    assert len(said(caplog)) == 2


async def test_a_disk_that_hangs_holds_up_nothing_and_what_is_lost_is_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host, "MAX_HELD_BYTES", 100_000)
    feeding = Feeding(tmp_path)
    async with feeding.running():
        await feeding.saved()
        (writer,) = writers()
        os.kill(writer, signal.SIGSTOP)
        burst = bytes(30_000)
        for n in range(200):  # more than the channel holds
            feeding.recorder.raw("imu0", burst, n)
        await feeding.until(lambda: feeding.recorder.status().dropped)
        dropped = feeding.recorder.status().dropped
        os.kill(writer, signal.SIGCONT)
        await feeding.saved()
        assert feeding.recorder.status().dropped - dropped < 100
        dropped = feeding.recorder.status().dropped
    run = RecordedRun(files(tmp_path))
    assert chunks(run)
    assert run.counts.missing == dropped > 0
    (slow,) = said(caplog)
    assert slow == f"recording {tmp_path}: does not keep up, data is dropped and counted"


async def test_the_end_waits_for_no_disk(tmp_path: Path) -> None:
    feeding = Feeding(tmp_path)
    async with feeding.running():
        await feeding.saved()
        (writer,) = writers()
        os.kill(writer, signal.SIGSTOP)
    assert writers() == []
