"""Progress: bars where somebody looks at them, on a real terminal, and nothing elsewhere."""

import os
import pty
import subprocess
import sys

from tests.shared_data import ROOT

LONG = """
import sys
from gateway import progress
progress.PATIENCE_S = 0.0
with progress.bars() as tell:
    tell("replaying", 0.42)
    sys.stdin.read()
"""
SHORT = """
from gateway import progress
with progress.bars() as tell:
    tell("replaying", 0.42)
"""


def start(program: str, stderr: int) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-c", program],
        stdin=subprocess.PIPE,
        stderr=stderr,
        cwd=ROOT,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "80"},
    )


def read_until(fd: int, *words: bytes) -> None:
    seen = b""
    while not all(word in seen for word in words):
        seen += os.read(fd, 4096)


def test_a_terminal_shows_what_is_done_and_how_far() -> None:
    ours, theirs = pty.openpty()
    process = start(LONG, theirs)
    try:
        read_until(ours, b"replaying", b"42%")
    finally:
        process.communicate(timeout=30)
        os.close(theirs)
        os.close(ours)
    assert process.returncode == 0


def test_what_is_over_soon_shows_nothing() -> None:
    ours, theirs = pty.openpty()
    process = start(SHORT, theirs)
    process.communicate(timeout=30)
    os.write(theirs, b"end")
    assert os.read(ours, 4096) == b"end"
    os.close(theirs)
    os.close(ours)


def test_a_pipe_is_told_nothing() -> None:
    assert start(LONG, subprocess.PIPE).communicate(timeout=30) == (None, b"")
