"""A file that one process at a time keeps: a lock beside it, which goes with the process."""

import fcntl
import os
from pathlib import Path

from drivers.links.holder import holder, process_name


class ClaimedError(Exception):
    """Another process keeps the file."""


def claim(path: Path) -> int | None:
    """Keep a file from now on to the end of this process; give the descriptor that stands for it.

    None where the disk takes no lock: it takes nothing else either, which is said by those who try.

    Raises
    ------
    ClaimedError
        Naming the process that keeps it.
    """
    try:
        lock = path.with_name(path.name + ".lock")
        fd = os.open(lock, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError:
        return None
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(fd)
        pid = holder(str(lock))
        who = "" if pid is None else f" ({process_name(pid)})"
        raise ClaimedError(f"kept by another gateway{who}") from None
    except OSError:  # a network disk without locks
        os.close(fd)
        return None
    return fd
