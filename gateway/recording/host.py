"""The daemon's end of a recording: gathers events into batches and keeps a writer running."""

import asyncio
import logging
import socket
import sys
import time
from collections import deque
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version
from typing import NamedTuple

import msgspec

from drivers.hosttime import now_ns
from gateway.clock.utc import UtcSample
from gateway.config import Config, Recording
from gateway.filter_process.channel import MAX_MESSAGE
from gateway.filter_process.launcher import ending
from gateway.filter_process.pair import pair
from gateway.health import HealthReport
from gateway.machine.realtime import ordinary
from gateway.outputs.schema import CalibrationReport, InnovationReport, NavReport, TargetReport
from gateway.outputs.sinks import SinkStatus
from gateway.recording.events import (
    Batch,
    Event,
    Fault,
    LineEvent,
    Orders,
    Pulse,
    Raw,
    Report,
    Run,
    Saved,
    Topic,
    encode,
    read_in_recorder,
)
from gateway.resume import COLD, Resume
from gateway.supervise import Alive, Backoff, keep_running

BATCH_S = 0.1
BATCH_BYTES = 64 * 1024
OVERHEAD = 64
"""What an event costs beside its bytes."""
MAX_HELD_BYTES = 16 * 1024 * 1024
"""What is kept of batches that are in no file yet: a minute and more of a fast IMU."""
END_S = 1.0
"""How long the writer may take to end its file."""
KILLED_S = 0.2
BACKOFF = Backoff(first_s=0.25, longest_s=5.0)
"""Between two writers: the first gives up where the disk is away or full."""

TYPES: dict[Topic, type[msgspec.Struct]] = {
    "nav": NavReport,
    "innovation": InnovationReport,
    "calibration": CalibrationReport,
    "target": TargetReport,
    "status": HealthReport,
}

_log = logging.getLogger(__name__)


class _Held(NamedTuple):
    """A batch on its way: how many events, the number after its last, its message."""

    events: int
    end: int
    message: bytes


class Recorder:
    """A feed that writes everything down; nothing here waits for the disk.

    What is in no file yet is kept, so that a writer that ends, for whatever reason, is followed by
    one that goes on where it was. What is kept is bounded: beyond that the oldest goes, and is
    counted.

    Parameters
    ----------
    settings, config
        Where to, and what the daemon runs.
    rate_hz
        Of the solutions.
    resume
        Where it began.

    Attributes
    ----------
    name
        Of the output, as in its status.
    up
        Set while a writer writes.
    """

    def __init__(
        self,
        settings: Recording,
        config: Config,
        rate_hz: float,
        resume: Resume = COLD,
    ) -> None:
        self.up = asyncio.Event()
        self.name = f"recording {settings.folder}"
        now = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        name, software = f"{now}-{time.monotonic_ns():x}", f"usblnav {version('usblnav')}"
        run = Run(name, software, rate_hz, config, resume)
        schemas = {t: msgspec.json.encode(msgspec.json.schema(k)) for t, k in TYPES.items()}
        self._orders = encode(Orders(run, settings, schemas))
        self._events: list[Event] = []
        self._resume: Resume | None = None
        self._size = 0
        self._next = 0
        self._waiting: deque[_Held] = deque()
        self._unsaved: deque[_Held] = deque()
        self._held_bytes = 0
        self._saved = self._dropped = 0
        self._socket: socket.socket | None = None
        self._alive: Alive = _nothing
        self._handed_on = asyncio.Event()
        self._blocked = self._slow = False
        self._error = ""

    def raw(self, device: str, data: bytes, t_rx_ns: int, source: str = "") -> None:
        """Take a chunk, before the device's intake is fed with it."""
        self._add(Raw(device, t_rx_ns, data, source), len(data))

    def pulse(self, device: str, t_ns: int) -> None:
        """Take an edge, before the device's intake is told of it."""
        self._add(Pulse(device, t_ns), 0)

    def resume(self, newest: Resume) -> None:
        """Take the newest state, for the beginning of the next file."""
        self._resume = newest

    def line(self, device: str, up: bool) -> None:
        """Take note of a line that was opened or lost."""
        self._add(LineEvent(device, now_ns(), up), 0)

    def utc(self, sample: UtcSample) -> None:
        """Take a sample of Unix time."""
        self._add(sample, 0)

    def nav(self, report: NavReport) -> bool:
        """Take a solution; that is no publication."""
        self._report("nav", report.utc_ns, report)
        return False

    def target(self, report: TargetReport, own: NavReport) -> None:
        """Take where a target is."""
        self._report("target", report.utc_ns, report)

    def innovation(self, report: InnovationReport) -> None:
        """Take the verdict on a fix."""
        self._report("innovation", report.utc_ns, report)

    def calibration(self, report: CalibrationReport) -> None:
        """Take the estimated constants."""
        self._report("calibration", report.utc_ns, report)

    def health(self, report: msgspec.Struct) -> None:
        """Take the daemon's status."""
        self._report("status", time.time_ns(), report)

    def status(self) -> SinkStatus:
        """Events in files and events lost."""
        return SinkStatus(self.name, self.up.is_set(), self._saved, self._dropped, self._error)

    async def run(self) -> None:
        """Keep a writer running until cancelled; then let it end its file."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._gather())
            group.create_task(keep_running("recording", self._write, backoff=BACKOFF))

    def _report(self, topic: Topic, utc_ns: int, report: msgspec.Struct) -> None:
        data = msgspec.json.encode(report)
        self._add(Report(topic, utc_ns, data), len(data))

    def _add(self, event: Event, size: int) -> None:
        self._events.append(event)
        self._size += size + OVERHEAD
        if self._size >= BATCH_BYTES:
            self._close_batch()

    async def _gather(self) -> None:
        """Send what has gathered, ten times a second."""
        while True:
            await asyncio.sleep(BATCH_S)
            self._close_batch()

    def _close_batch(self) -> None:
        """Number the gathered events and send them on their way."""
        if not self._events:
            return
        message = encode(Batch(self._next, self._events, self._resume))
        self._resume = None
        self._next += len(self._events)
        self._handed_on.clear()
        self._waiting.append(_Held(len(self._events), self._next, message))
        self._held_bytes += len(message)
        self._events, self._size = [], 0
        self._pump()
        self._bound()

    def _bound(self) -> None:
        """Let the oldest go where too much is kept; what a writer has been given is not lost."""
        while self._held_bytes > MAX_HELD_BYTES and (self._unsaved or self._waiting):
            lost = not self._unsaved
            oldest = (self._waiting if lost else self._unsaved).popleft()
            self._held_bytes -= len(oldest.message)
            if lost:
                self._dropped += oldest.events
                if not self._slow:
                    self._slow = True
                    _log.warning("%s: does not keep up, data is dropped and counted", self.name)

    def _pump(self) -> None:
        """Give the writer what waits, as far as the channel takes it."""
        if self._socket is None or self._blocked:
            return
        try:
            while self._waiting:
                self._socket.send(self._waiting[0].message)
                self._unsaved.append(self._waiting.popleft())
            self._handed_on.set()
        except BlockingIOError:
            self._blocked = True
            asyncio.get_running_loop().add_writer(self._socket, self._unblock, self._socket)
        except OSError:
            pass  # the writer is ending; that is seen by `_write`

    def _unblock(self, channel: socket.socket) -> None:
        asyncio.get_running_loop().remove_writer(channel)
        self._blocked = False
        self._pump()

    async def _write(self, alive: Alive) -> None:
        """Run one writer to its end, which is the loss of this line."""
        ours, theirs = pair()
        ours.send(self._orders)
        with ordinary():
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "gateway.recording.writer", str(theirs.fileno())),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
            )
        theirs.close()
        self._alive, self._error = alive, ""
        try:
            self._attach(ours)
            code = await process.wait()
            self._read(ours)
            self._error = self._error or f"writer {ending(code)}"
            raise OSError(self._error)
        finally:
            await self._detach(ours, process)

    def _attach(self, channel: socket.socket) -> None:
        """Begin with what the last writer has not saved, and hear the new one."""
        self._waiting.extendleft(reversed(self._unsaved))
        self._unsaved.clear()
        self._socket = channel
        asyncio.get_running_loop().add_reader(channel, self._read, channel)
        self._pump()

    async def _detach(self, channel: socket.socket, process: asyncio.subprocess.Process) -> None:
        """See a writer to its end: a channel that is closed tells it to end its file."""
        if process.returncode is None:
            self._close_batch()
            try:
                async with asyncio.timeout(END_S):
                    await self._handed_on.wait()
                    channel.shutdown(socket.SHUT_WR)
                    await process.wait()
            except TimeoutError:
                process.kill()
                with suppress(TimeoutError):  # one that hangs in a disk ends when the disk lets it
                    await asyncio.wait_for(process.wait(), KILLED_S)
        loop = asyncio.get_running_loop()
        loop.remove_reader(channel)
        loop.remove_writer(channel)
        channel.close()
        self._socket, self._blocked = None, False
        self.up.clear()

    def _read(self, channel: socket.socket) -> None:
        """Take what the writer says."""
        try:
            while data := channel.recv(MAX_MESSAGE):
                self._take(read_in_recorder(data))
        except BlockingIOError:
            return
        except OSError:
            pass
        asyncio.get_running_loop().remove_reader(channel)

    def _take(self, word: Saved | Fault) -> None:
        if isinstance(word, Fault):
            self._error = word.text
            self.up.clear()
            return
        self.up.set()
        self._slow = self._slow and bool(self._waiting)
        self._alive()
        while self._unsaved and self._unsaved[0].end <= word.end:
            saved = self._unsaved.popleft()
            self._held_bytes -= len(saved.message)
            self._saved += saved.events


def _nothing() -> None:
    pass
