"""Disks that are full."""

import errno
from pathlib import Path


def fill(path: Path) -> None:
    """Take all the space there is, in one file."""
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError as error:
            assert error.errno == errno.ENOSPC
