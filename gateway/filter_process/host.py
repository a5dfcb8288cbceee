"""The daemon's end of the filter process: starts it, feeds it, starts it again when it dies."""

import asyncio
import logging
import signal
import socket
import sys
from collections import deque
from collections.abc import Callable
from contextlib import suppress

import msgspec

from gateway import realtime
from gateway.config import Config
from gateway.filter_process.channel import (
    MAX_MESSAGE,
    Compiling,
    Ready,
    Start,
    encode,
    pair,
    read_in_host,
)
from gateway.messages import Checkpoint, FilterOutput, Measurement, SavedState

MAX_WAITING = 20_000
"""Messages kept for the worker: minutes of a fast IMU; beyond it the oldest go, and are counted."""
RETRY_S = (0.0, 0.5, 1.0, 2.0, 5.0)
END_S = 1.0
"""How long a worker may take to end by itself."""
DRAIN_S = 0.4
"""How long it may take over what was sent to it, when it is to end."""

_log = logging.getLogger(__name__)


class HostStatus(msgspec.Struct):
    """How the filter process fares."""

    pid: int | None = None
    ready: bool = False
    restarts: int = 0
    waiting: int = 0
    dropped: int = 0


class FilterHost:
    """Feeds a worker and hands on what it says.

    Everything sent since the worker's last checkpoint is kept, so that a new worker takes up where
    the dead one left off.

    Parameters
    ----------
    config, rate_hz
        What the worker runs, and how many solutions a second it gives.
    on_output
        Called on the event loop with everything the worker says.
    """

    def __init__(
        self, config: Config, rate_hz: float, on_output: Callable[[FilterOutput], None]
    ) -> None:
        self.status = HostStatus()
        self.ready = asyncio.Event()
        self._config = config
        self._rate_hz = rate_hz
        self._on_output = on_output
        self._resume: Checkpoint | SavedState | None = None
        self._state: SavedState | None = None
        self._acknowledged = 0
        self._said = 0
        self._heard = 0
        self._sent: deque[bytes] = deque()
        self._waiting: deque[bytes] = deque()
        self._socket: socket.socket | None = None
        self._blocked = False
        self._handed_on = asyncio.Event()
        self._drained: asyncio.Event | None = None

    def send(self, measurement: Measurement) -> None:
        """Queue a measurement for the worker; never blocks."""
        self._waiting.append(encode(measurement))
        self._handed_on.clear()
        self._pump()
        while len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self.status.dropped += 1
        while len(self._sent) > MAX_WAITING:
            self._sent.popleft()
            self._acknowledged += 1
        self.status.waiting = len(self._waiting)

    async def run(self) -> None:
        """Keep a worker running until cancelled; then end it."""
        failures = 0
        while True:
            solved_ns = self._solved_ns()
            how = await self._run_once()
            if self._drained is not None:
                self._drained.set()
                return
            failures = failures + 1 if self._solved_ns() <= solved_ns else 0
            if failures > 1:  # it may be dying of what it is fed
                self.status.dropped += len(self._sent)
                self._sent.clear()
                self._resume, self._heard = self._state, 0
            wait_s = RETRY_S[min(failures, len(RETRY_S) - 1)]
            self.status.restarts += 1
            _log.error("filter process %s; starting it again", how)
            await asyncio.sleep(wait_s)

    async def drain(self) -> None:
        """Let the worker end with what was sent so far, and hand on what it says to that."""
        channel = self._socket
        if channel is None or not self.status.ready:
            return
        self._drained = asyncio.Event()
        with suppress(TimeoutError):
            async with asyncio.timeout(DRAIN_S):
                self._pump()
                await self._handed_on.wait()
                channel.shutdown(socket.SHUT_WR)
                await self._drained.wait()

    async def _run_once(self) -> str:
        """Run one worker to its end; say how it ended."""
        ours, theirs = pair()
        # Before the worker is there: one that dies at once, or whose host does, finds its orders.
        ours.send(encode(Start(self._config, self._rate_hz, self._resume)))
        with realtime.ordinary():  # the worker takes its priority when it is compiled and ready
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "gateway.filter_process.worker", str(theirs.fileno())),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
            )
        theirs.close()
        self.status.pid = process.pid
        try:
            self._attach(ours)
            code = await process.wait()
            self._read(ours)  # its last words
            return ending(code)
        finally:
            self._detach(ours)
            await _end(process)

    def _attach(self, channel: socket.socket) -> None:
        """Put what the last worker had not finished before all else, and hear the new one."""
        self._waiting.extendleft(reversed(self._sent))
        self._sent.clear()
        at = self._resume
        self._acknowledged, self._said = (
            (at.received, at.said) if isinstance(at, Checkpoint) else (0, 0)
        )
        self._socket = channel
        asyncio.get_running_loop().add_reader(channel, self._read, channel)

    def _detach(self, channel: socket.socket) -> None:
        """Forget a worker."""
        loop = asyncio.get_running_loop()
        loop.remove_reader(channel)
        loop.remove_writer(channel)
        channel.close()
        self._socket, self._blocked = None, False
        self.status.ready, self.status.pid = False, None
        self.ready.clear()

    def _pump(self) -> None:
        """Send what waits as far as the channel takes it."""
        if self._socket is None or self._blocked or not self.status.ready:
            return
        try:
            while self._waiting:
                self._socket.send(self._waiting[0])
                self._sent.append(self._waiting.popleft())
            self._handed_on.set()
        except BlockingIOError:
            self._blocked = True
            asyncio.get_running_loop().add_writer(self._socket, self._unblock, self._socket)
        except OSError:
            pass  # the worker is dying; its end is seen by `_run_once`
        self.status.waiting = len(self._waiting)

    def _unblock(self, channel: socket.socket) -> None:
        asyncio.get_running_loop().remove_writer(channel)
        self._blocked = False
        self._pump()

    def _read(self, channel: socket.socket) -> None:
        """Take what the worker says."""
        try:
            while data := channel.recv(MAX_MESSAGE):
                self._take(data)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            asyncio.get_running_loop().remove_reader(channel)

    def _take(self, data: bytes) -> None:
        message = read_in_host(data)
        if isinstance(message, Ready):
            self.status.ready = True
            self.ready.set()
            self._pump()
        elif isinstance(message, Compiling):
            _log.info("compiling the filter, once: what comes meanwhile waits for it")
        elif isinstance(message, Checkpoint):
            self._keep(message)
        elif isinstance(message, SavedState):
            if message.t_ns > self._solved_ns():
                self._state = message
        else:
            self._said += 1
            if self._said > self._heard:  # else the last worker has given it
                self._heard = self._said
                self._on_output(message)

    def _solved_ns(self) -> int:
        """Time of the newest state that any worker reached."""
        return 0 if self._state is None else self._state.t_ns

    def _keep(self, checkpoint: Checkpoint) -> None:
        """Remember a checkpoint and forget the measurements it includes."""
        while self._acknowledged < checkpoint.received:
            self._sent.popleft()
            self._acknowledged += 1
        self._resume = checkpoint


def ending(code: int) -> str:
    """How a process ended, in words."""
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"


async def _end(process: asyncio.subprocess.Process) -> None:
    """See a process to its end; its channel is closed, which tells it."""
    if process.returncode is not None:
        return
    try:
        await asyncio.wait_for(process.wait(), END_S)
    except TimeoutError:
        process.kill()
        await process.wait()
