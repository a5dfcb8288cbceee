"""The daemon's end of the filter process: feeds a worker, and the next one when it dies."""

import asyncio
import logging
import math
import signal
import socket
from collections.abc import Callable
from contextlib import suppress

import msgspec

from gateway.config import Config
from gateway.filter_process.begun import Begun
from gateway.filter_process.channel import (
    MAX_MESSAGE,
    Prepare,
    encode,
    encode_many,
    read_of_worker,
    receive,
)
from gateway.filter_process.launcher import Launcher, Worker, ending
from gateway.filter_process.succession import Succession
from gateway.messages import FilterOutput, Measurement, SavedState
from gateway.timeline import LOOK_BACK_S

OTHERS_HZ = 100.0
"""Inputs beside the IMU's that come in a second, at most."""
FIRST_S = 300.0
"""How long the first worker may take to be compiled, on a slow machine."""
MARGIN_S = 10.0
"""How much older than the history a checkpoint may grow, while a worker hangs or is replaced."""
MOST_AT_ONCE = 100
"""Inputs that waited and go in one message: 18 s of a fast IMU are worked in again in no time."""
DRAIN_S = 0.4
"""How long a worker may take over what was sent to it, when it is to end."""
RETRY_S = (0.0, 0.0, 0.0, 0.5, 1.0, 2.0, 5.0)
"""Waits before a new worker, by how many died since one brought news."""

_log = logging.getLogger(__name__)


class HostStatus(msgspec.Struct, frozen=True):
    """How the filter process fares."""

    pid: int | None
    spare_pid: int | None
    ready: bool
    restarts: int
    waiting: int
    kept: int
    dropped: int
    forgotten: int


class FilterHost:
    """Feeds a worker and hands on what it says.

    When it dies the next one goes on as if nothing had happened, see `Succession`.

    Parameters
    ----------
    config, rate_hz
        What the worker runs, and how many solutions a second it gives.
    on_output
        Called on the event loop with everything the worker says but checkpoints.
    resume
        Where an earlier gateway left off.
    begun
        A first template, started earlier to save time.
    """

    def __init__(
        self,
        config: Config,
        rate_hz: float,
        on_output: Callable[[FilterOutput], None],
        resume: SavedState | None = None,
        begun: Begun | None = None,
    ) -> None:
        self._launcher = Launcher(Prepare(config, rate_hz), begun)
        self._on_output = on_output
        self._succession = Succession(most_kept(config), resume, most_at_first(config))
        self._backlog = self._succession.backlog
        self._worker: Worker | None = None
        self._blocked = False
        self._handed_on = asyncio.Event()
        self._gone = asyncio.Event()
        self._ends = False
        self._restarts = 0

    @property
    def ready(self) -> asyncio.Event:
        """Set while a filter is compiled and waits for measurements."""
        return self._launcher.ready

    @property
    def status(self) -> HostStatus:
        """How the filter process fares now."""
        worker, backlog = self._worker, self._backlog
        return HostStatus(
            pid=worker.pid if worker else None,
            spare_pid=self._launcher.pid,
            ready=worker is not None,
            restarts=self._restarts,
            waiting=backlog.waiting,
            kept=backlog.kept,
            dropped=backlog.dropped,
            forgotten=backlog.forgotten,
        )

    def send(self, measurement: Measurement) -> None:
        """Queue a measurement for the worker; never blocks."""
        self._backlog.add(encode(measurement))
        self._handed_on.clear()
        self._pump()

    async def run(self) -> None:
        """Keep a worker running until cancelled; then end it."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._launcher.run())
            while True:
                worker = await self._launcher.launch(self._succession.orders())
                code = await self._serve(worker)
                if self._ends:
                    return
                self._restarts += 1
                _log.error("filter process %s; starting it again", ending(code))
                is_its_own_fault = code not in (None, -signal.SIGKILL)
                self._succession.ended(worker.progress.at if is_its_own_fault else None)
                await asyncio.sleep(RETRY_S[min(self._succession.in_vain, len(RETRY_S) - 1)])

    async def drain(self) -> None:
        """Let the worker end with what was sent so far, and hand on what it says to that."""
        worker, self._ends = self._worker, True
        if worker is None:
            return
        with suppress(OSError):  # it takes too long, or dies of it
            async with asyncio.timeout(DRAIN_S):
                self._pump()
                await self._handed_on.wait()
                worker.channel.shutdown(socket.SHUT_WR)
                await self._gone.wait()

    async def _serve(self, worker: Worker) -> int | None:
        """Feed a worker and hear it until it is gone; give its code."""
        loop = asyncio.get_running_loop()
        self._worker = worker
        self._gone.clear()
        loop.add_reader(worker.channel, self._read, worker.channel)
        try:
            self._pump()
            await self._gone.wait()
        finally:
            loop.remove_reader(worker.channel)
            loop.remove_writer(worker.channel)
            self._worker, self._blocked = None, False
            code = await _to_its_end(worker)
        return code

    def _pump(self) -> None:
        """Send what waits as far as the channel takes it."""
        if self._worker is None or self._blocked:
            return
        channel = self._worker.channel
        try:
            while data := self._backlog.next(MOST_AT_ONCE, MAX_MESSAGE // 4):
                channel.send(encode_many(data))
                self._backlog.sent(len(data))
            self._handed_on.set()
        except BlockingIOError:
            self._blocked = True
            asyncio.get_running_loop().add_writer(channel, self._unblock, channel)
        except OSError:
            pass  # the worker is dying, which is seen when its last words are read

    def _unblock(self, channel: socket.socket) -> None:
        asyncio.get_running_loop().remove_writer(channel)
        self._blocked = False
        self._pump()

    def _read(self, channel: socket.socket) -> None:
        """Take what the worker says."""
        while True:
            try:
                data = receive(channel)
            except BlockingIOError:
                return
            except ConnectionResetError:
                continue  # it died with input unread; its last words come after this
            if not data:
                break
            output = read_of_worker(data)
            if self._succession.take(output):
                self._on_output(output)
        asyncio.get_running_loop().remove_reader(channel)
        self._gone.set()


def most_kept(config: Config) -> int:
    """How many inputs may wait for a next worker: those since the oldest moment of a checkpoint.

    An alignment has one at the beginning of each window; that of an hour keeps an hour.
    """
    past_s = config.filter.history_s + LOOK_BACK_S + MARGIN_S
    if config.initial.align is not None:
        past_s += config.initial.align.window_s
    return math.ceil(past_s * (config.imu[1].rate_hz + OTHERS_HZ))


def most_at_first(config: Config) -> int:
    """How many inputs may wait for the first worker."""
    return math.ceil(FIRST_S * (config.imu[1].rate_hz + OTHERS_HZ))


async def _to_its_end(worker: Worker) -> int | None:
    """See a worker to its end, also where this is cancelled meanwhile."""
    try:
        return await worker.end()
    except asyncio.CancelledError:
        await worker.end()
        raise
