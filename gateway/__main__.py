"""Entry point of the `usblnav` command."""

import os
import sys
import threading

from gateway import cli

BACKGROUND = "usblnav-background"
"""As in `gateway.outputs.background`, which is imported only where it is needed."""
CALLBACKS = "pyo3-closure"
"""In the names of threads in which Zenoh calls back; one may still be ending after the session."""


def main() -> int:
    """Run a command and leave; gives the exit code."""
    return leave(cli.main())


def leave(code: int) -> int:
    """Give the exit code back, or end the process at once where a thread is left behind.

    A call that is still inside Zenoh (a router that does not answer) would be cancelled by the
    interpreter's end, and that aborts the process.
    """
    if any(
        thread.name == BACKGROUND or CALLBACKS in thread.name for thread in threading.enumerate()
    ):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


if __name__ == "__main__":
    sys.exit(main())
