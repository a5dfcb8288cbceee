"""How a process that the daemon starts behaves: a name of its own, and no ear for signals."""

import signal
from contextlib import suppress
from pathlib import Path

ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
"""What a service manager, Ctrl-C and a terminal that closes send."""


def serve_as(name: str) -> None:
    """Leave signals that end to the daemon, which decides about the whole; be called `name`."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    call_it(name)


def call_it(name: str) -> None:
    """Name this process, for `ps` and `top`: the kernel keeps fifteen bytes of it."""
    with suppress(OSError):
        Path("/proc/self/comm").write_text(name)
