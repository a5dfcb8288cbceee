"""The host's hold on the template process and on the workers forked of it."""

import asyncio
import logging
import os
import signal
import socket
from collections import deque
from contextlib import suppress

from gateway.filter_process.begun import Begun, begin
from gateway.filter_process.channel import (
    MAX_MESSAGE,
    Born,
    Compiling,
    Ended,
    Fork,
    Prepare,
    Ready,
    Start,
    encode,
    read_of_template,
)
from gateway.filter_process.pair import pair
from gateway.filter_process.progress import Progress, shared

RETRY_S = (0.0, 0.5, 1.0, 2.0, 5.0)
"""Waits before a template is started again that keeps dying before it is ready."""
END_S = 1.0
"""How long a process may take to end by itself."""

_log = logging.getLogger(__name__)


class Worker:
    """A worker as the host holds it.

    Attributes
    ----------
    channel
        The host's end. It says nothing more once the worker is gone.
    progress
        What the worker is at, or was when it died.
    pid
        None until the template has answered.
    code
        Exit code, or minus the signal that killed it; None where nobody saw the end.
    """

    def __init__(self, channel: socket.socket, progress: Progress) -> None:
        self.channel = channel
        self.progress = progress
        self.pid: int | None = None
        self.code: asyncio.Future[int | None] = asyncio.get_running_loop().create_future()
        self._pidfd: int | None = None

    def born(self, pid: int, pidfd: int) -> None:
        """Note the answer of the template."""
        self.pid, self._pidfd = pid, pidfd

    def ended(self, code: int | None) -> None:
        """Note the end."""
        if not self.code.done():
            self.code.set_result(code)

    async def end(self) -> int | None:
        """See it to its end; its channel is closed, which tells it. Gives its code."""
        self.channel.close()
        if self._pidfd is None:
            await self._code_in_time()
        if self._pidfd is not None:
            if not await _readable(self._pidfd, END_S):
                signal.pidfd_send_signal(self._pidfd, signal.SIGKILL)
            os.close(self._pidfd)
            self._pidfd = None
        return await self._code_in_time()

    async def _code_in_time(self) -> int | None:
        """The code, if the template is quick to tell."""
        with suppress(TimeoutError):
            return await asyncio.wait_for(asyncio.shield(self.code), END_S)
        return None


class Launcher:
    """Keeps a template ready and has workers forked of it.

    Parameters
    ----------
    orders
        What the workers will run.
    begun
        A first template, started earlier.

    Attributes
    ----------
    pid
        Of the template; None while there is none.
    ready
        Whether a worker would start at once.
    """

    def __init__(self, orders: Prepare, begun: Begun | None = None) -> None:
        self.pid: int | None = None
        self.ready = asyncio.Event()
        self._orders = orders
        self._begun = begun
        self._control: socket.socket | None = None
        self._unborn: deque[Worker] = deque()
        self._alive: dict[int, Worker] = {}

    async def run(self) -> None:
        """Keep a template running until cancelled; then end it."""
        failures = 0
        while True:
            how, was_ready = await self._run_once()
            failures = 0 if was_ready else failures + 1
            _log.log(
                logging.INFO if was_ready else logging.ERROR,
                "spare filter process %s; starting another",
                how,
            )
            await asyncio.sleep(RETRY_S[min(failures, len(RETRY_S) - 1)])

    async def launch(self, start: Start) -> Worker:
        """Have a worker forked with its orders already in the channel."""
        while True:
            await self.ready.wait()
            assert self._control is not None
            ours, theirs = pair()
            progress, page = shared()
            ours.send(encode(start))
            try:
                socket.send_fds(self._control, [encode(Fork())], [theirs.fileno(), page])
            except OSError:  # the template is dying, which `run` will see
                self.ready.clear()
                ours.close()
            else:
                self._unborn.append(Worker(ours, progress))
                return self._unborn[-1]
            finally:
                theirs.close()
                os.close(page)

    async def _run_once(self) -> tuple[str, bool]:
        """Run one template to its end; say how it ended and whether it had been ready."""
        process, control = self._begun or begin()
        self._begun = None
        with suppress(BrokenPipeError):  # it is dead already
            control.send(encode(self._orders))
        loop, pidfd = asyncio.get_running_loop(), os.pidfd_open(process.pid)
        self.pid, self._control = process.pid, control
        loop.add_reader(control, self._read, control)
        try:
            await _readable(pidfd)
            self._read(control)
            return ending(process.wait()), self.ready.is_set()
        finally:
            loop.remove_reader(control)
            control.close()
            self.ready.clear()
            self.pid = self._control = None
            for worker in (*self._unborn, *self._alive.values()):
                worker.ended(None)
            self._unborn.clear()
            self._alive.clear()
            if not await _readable(pidfd, END_S):
                process.kill()
            process.wait()
            os.close(pidfd)

    def _read(self, control: socket.socket) -> None:
        """Take what the template says."""
        try:
            while True:
                data, fds, _, _ = socket.recv_fds(control, MAX_MESSAGE, 1)
                if not data:
                    break
                self._take(data, fds)
        except BlockingIOError:
            return
        except OSError:
            pass
        asyncio.get_running_loop().remove_reader(control)

    def _take(self, data: bytes, fds: list[int]) -> None:
        match read_of_template(data):
            case Compiling():
                _log.info("compiling the filter, once (half a minute or more); what comes waits")
            case Ready():
                self.ready.set()
            case Born(pid):
                worker = self._unborn.popleft()
                worker.born(pid, fds[0])
                self._alive[pid] = worker
            case Ended(pid, code):
                self._alive.pop(pid).ended(code)


def ending(code: int | None) -> str:
    """How a process ended."""
    if code is None:
        return "ended unseen"
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"


async def _readable(fd: int, within_s: float | None = None) -> bool:
    """Whether a file descriptor becomes readable in time; that of a process, when it ends."""
    loop, event = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(fd, event.set)
    try:
        await asyncio.wait_for(event.wait(), within_s)
    except TimeoutError:
        return False
    finally:
        loop.remove_reader(fd)
    return True
