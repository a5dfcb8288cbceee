"""The folder of recordings: numbered names that no clock can bring back, and the disk quota."""

import os
import re
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from mcap.writer import MCAP0_MAGIC

PROFILE = "usblnav"
"""What the header of a recording says it is."""
_PROFILE_AT = len(MCAP0_MAGIC) + 9


class _Old(NamedTuple):
    """A recording that is there."""

    number: int
    path: Path
    size: int


class Folder:
    """Where the recordings of one vehicle are.

    Parameters
    ----------
    path
        It must exist: a mount point without its disk is not to be filled.
    vehicle
        Begins the names: ``<vehicle>-<number>-<UTC of the start>.mcap``.
    quota
        Bytes that the recordings may take in all.
    """

    def __init__(self, path: Path, vehicle: str, quota: int) -> None:
        self._path = path
        self._vehicle = vehicle
        self._quota = quota
        self._name = re.compile(re.escape(vehicle) + r"-(\d{6,})-\d{8}T\d{6}Z\.mcap")
        self._others: list[_Old] = []

    def create(self, now_s: float) -> tuple[int, Path]:
        """Make the next file; give its descriptor and path.

        Raises
        ------
        OSError
            Where that cannot be done.
        """
        self._others = sorted(self._present())
        number = self._others[-1].number + 1 if self._others else 1
        stamp = datetime.fromtimestamp(now_s, UTC).strftime("%Y%m%dT%H%M%SZ")
        path = self._path / f"{self._vehicle}-{number:06d}-{stamp}.mcap"
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666), path

    def make_room(self, size: int) -> None:
        """Remove the oldest recordings, while they and the open one of `size` are too much.

        A file whose header is not a recording's is nobody's to remove.
        """
        total = size + sum(old.size for old in self._others)
        while self._others and total > self._quota:
            oldest = self._others.pop(0)
            total -= oldest.size
            if _is_ours(oldest.path):
                with suppress(FileNotFoundError):
                    oldest.path.unlink()

    def _present(self) -> list[_Old]:
        found = []
        for entry in os.scandir(self._path):
            name = self._name.fullmatch(entry.name)
            if name and entry.is_file(follow_symlinks=False):
                found.append(_Old(int(name[1]), Path(entry.path), entry.stat().st_size))
        return found


def _is_ours(path: Path) -> bool:
    """Whether the file begins as recordings do."""
    try:
        with path.open("rb") as file:
            head = file.read(_PROFILE_AT + 4 + len(PROFILE))
    except OSError:
        return False
    profile = len(PROFILE).to_bytes(4, "little") + PROFILE.encode()
    return head.startswith(MCAP0_MAGIC) and head[_PROFILE_AT:] == profile
