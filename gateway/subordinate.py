"""How a process that the daemon starts behaves: a name of its own, and no ear for signals."""

import signal
from contextlib import suppress
from pathlib import Path


def serve_as(name: str) -> None:
    """Leave SIGINT and SIGTERM to the daemon, which decides about the whole; be called `name`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    call_it(name)


def call_it(name: str) -> None:
    """Name this process, for `ps` and `top`: the kernel keeps fifteen bytes of it."""
    with suppress(OSError):
        Path("/proc/self/comm").write_text(name)
