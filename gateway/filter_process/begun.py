"""A template process begun; this imports little, so that it can be begun before all else."""

import os
import socket
import subprocess
import sys
from typing import NamedTuple

from gateway.filter_process.pair import pair
from gateway.machine.realtime import ordinary

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""The matrices are small; and only a process of a single thread may be forked safely."""


class Begun(NamedTuple):
    """A template that waits for its orders."""

    process: "subprocess.Popen[bytes]"
    control: socket.socket

    def end(self) -> None:
        """See that it is gone, whoever had it."""
        self.process.kill()
        self.process.wait()
        self.control.close()


def begin() -> Begun:
    """Start a template: it compiles what it needs, then waits. It ends with this process."""
    ours, theirs = pair()
    with theirs, ordinary():  # a worker takes its priority when it begins
        process = subprocess.Popen(
            [sys.executable, "-m", "gateway.filter_process", str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=os.environ | ONE_THREAD,
            pass_fds=(theirs.fileno(),),
            process_group=0,  # the terminal's Ctrl-C is for the daemon
        )
    return Begun(process, ours)
