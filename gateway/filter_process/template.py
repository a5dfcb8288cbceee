"""The template process: the filter compiled and idle, of which a worker is forked on demand.

Run as ``python -m gateway.filter_process FD``. It and its workers end when the host closes
their channels, and leave signals to the host, which decides about the whole.
"""

import gc
import os
import socket
from contextlib import suppress
from select import POLLIN, poll, select

from gateway.estimator import Estimator
from gateway.filter_process import worker
from gateway.filter_process.channel import (
    MAX_MESSAGE,
    Born,
    Compiling,
    Ended,
    Prepare,
    Ready,
    encode,
    read_in_template,
)
from gateway.filter_process.progress import Progress
from gateway.fusion.warmup import warm_up
from gateway.machine.subordinate import call_it, serve_as
from gateway.nav.compiled import told_of_compiling

END_S = 0.5
"""How long a worker may take to end after its host has."""


def main(fd: int) -> None:
    """Fork workers for one host until it closes the channel; in a worker, serve it."""
    serve_as("usblnav-spare")
    with suppress(BrokenPipeError, ConnectionResetError):  # the host is gone
        with socket.socket(fileno=fd) as control:
            orders = _prepare(control)
            given = None if orders is None else _fork_on_demand(control)
        if orders is not None and given is not None:
            call_it("usblnav-filter")
            channel, progress = given
            with channel:
                worker.serve(channel, progress, orders)


def _prepare(control: socket.socket) -> Prepare | None:
    """Compile all that a worker will need, then hear what it is; None if the host is gone."""
    with told_of_compiling(lambda: control.send(encode(Compiling()))):
        warm_up()
        if not (data := control.recv(MAX_MESSAGE)):
            return None
        orders = read_in_template(data)
        assert isinstance(orders, Prepare)
        Estimator(orders.config, orders.rate_hz)
    gc.freeze()  # a worker's collections would else copy every page
    control.send(encode(Ready()))
    return orders


def _fork_on_demand(control: socket.socket) -> tuple[socket.socket, Progress] | None:
    """Fork and bury workers until the host is gone: None; in a worker, give what it came with."""
    children: dict[int, int] = {}  # file descriptor -> process id
    events = poll()
    events.register(control, POLLIN)
    while True:
        for fd, _ in events.poll():
            if fd in children:
                events.unregister(fd)
                _bury(control, fd, children.pop(fd))
                continue
            data, fds, _, _ = socket.recv_fds(control, MAX_MESSAGE, 2)
            if not data:
                _see_off(children)
                return None
            pid = os.fork()
            if pid == 0:
                for other in children:
                    os.close(other)
                return socket.socket(fileno=fds[0]), Progress(fds[1])
            for fd in fds:
                os.close(fd)
            fd = os.pidfd_open(pid)
            children[fd] = pid
            events.register(fd, POLLIN)
            socket.send_fds(control, [encode(Born(pid))], [fd])


def _bury(control: socket.socket, fd: int, pid: int) -> None:
    """Take the exit code of a worker that ended, and tell it."""
    os.close(fd)
    _, status = os.waitpid(pid, 0)
    control.send(encode(Ended(pid, os.waitstatus_to_exitcode(status))))


def _see_off(children: dict[int, int]) -> None:
    """Bury the workers, which end with the host as this process does."""
    for fd, pid in children.items():
        if select([fd], [], [], END_S)[0]:
            os.waitpid(pid, 0)
