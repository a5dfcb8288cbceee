"""Who holds the lock of a file or device, as Linux tells in /proc/locks."""

import os
from contextlib import suppress
from pathlib import Path

LOCKS = Path("/proc/locks")


def holder(path: str) -> int | None:
    """Id of the process that has locked `path`; None where that cannot be told.

    A lock of a process that the system hides (another container, `ProtectProc=`) has no id.
    """
    try:
        status = Path(path).stat()
        lines = LOCKS.read_text("ascii", errors="replace").splitlines()
    except OSError:
        return None
    device = status.st_dev
    place = f"{os.major(device):02x}:{os.minor(device):02x}:{status.st_ino}"
    for line in lines:
        # 1: FLOCK  ADVISORY  WRITE 15625 00:1a:3 0 EOF
        words = line.split()
        if len(words) > 5 and words[1] == "FLOCK" and words[5] == place and int(words[4]) > 0:
            return int(words[4])
    return None


def process_name(pid: int) -> str:
    """What to call a process: ``minicom, process 4711``."""
    with suppress(OSError):
        return f"{Path(f'/proc/{pid}/comm').read_text().strip()}, process {pid}"
    return f"process {pid}"
