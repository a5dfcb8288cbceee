"""Recordings as a command line names them, and what it is told of their damage."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from gateway.errors import ConfigError


def named(paths: Sequence[Path]) -> list[Path]:
    """The files, with those of each folder in its place.

    Raises
    ------
    ConfigError
        For what is not there, and folders without a recording.
    """
    found, faults = [], []
    for path in paths:
        inner = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if not path.exists():
            faults.append(f"{path}: no such file or folder")
        elif not inner:
            faults.append(f"{path}: a folder without a recording (*.mcap)")
        found += inner
    if faults:
        raise ConfigError(faults)
    return found


def tell_damage(counts: dict[str, Any]) -> None:
    """Say what of recordings is lost, each place once; `counts` are a summary's."""
    from gateway.recording.reader import Damage  # it takes a while to import

    for told in counts.get("recording", {}).get("damaged", ()):
        print(f"usblnav: {msgspec.convert(told, Damage)}", file=sys.stderr)
