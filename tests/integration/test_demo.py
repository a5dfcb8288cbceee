"""The demo as a user starts it: in a pipe, on a terminal, stopped half-way."""

import asyncio
import fcntl
import os
import pty
import re
import signal
import termios
from contextlib import suppress
from pathlib import Path

import pytest

from tests.integration.rig import USBLNAV
from tests.shared_data import ROOT

pytestmark = pytest.mark.live

SUMMARY = re.compile(
    r"demo: 12 s, horizontal RMS error (?P<error>[\d.]+) m and heading (?P<heading>[\d.]+) deg "
    r"over the last 12 s; (?P<used>\d+) fixes used, \d+ refused; "
    r"heard (?P<solutions>\d+) solutions by Zenoh and (?P<sentences>\d+) NMEA sentences"
)


async def test_it_ends_with_its_error_against_the_truth() -> None:
    demo = await asyncio.create_subprocess_exec(
        *(*USBLNAV, "demo", "--duration", "12"),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        cwd=ROOT,
    )
    out, err = await asyncio.wait_for(demo.communicate(), 120)
    assert (demo.returncode, err) == (0, b"")
    *lines, last = out.decode().splitlines()
    summary = SUMMARY.fullmatch(last)
    assert summary, last
    assert float(summary["error"]) < 3.0  # RMS from the first moment on, with 5 m initial sigma
    assert float(summary["heading"]) < 0.5
    assert int(summary["used"]) >= 4
    assert int(summary["solutions"]) > 100
    assert int(summary["sentences"]) > 70
    status = [line for line in lines if line.startswith("aided ")]
    assert float(status[-1].split("error ")[1].split()[0]) < 2.0


@pytest.mark.parametrize("how", ["Ctrl-C", "SIGTERM"])
async def test_stopped_half_way_it_leaves_nothing_running(how: str, tmp_path: Path) -> None:
    screen = bytearray()
    near, far = pty.openpty()
    demo = await asyncio.create_subprocess_exec(
        *(*USBLNAV, "demo"),
        stdin=far,
        stdout=far,
        stderr=far,
        env=os.environ | {"TMPDIR": str(tmp_path), "TERM": "xterm", "COLUMNS": "100"},
        cwd=ROOT,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )
    os.close(far)
    shown = asyncio.Event()

    def look() -> None:
        with suppress(OSError):  # the last program has left the terminal
            screen.extend(os.read(near, 65536))
        if b"fixes" in screen:
            shown.set()

    asyncio.get_running_loop().add_reader(near, look)
    try:
        await asyncio.wait_for(shown.wait(), 90)
        family = descendants(demo.pid)
        assert len(family) == 4  # the gateway, its filter and the spare one, the emulator
        if how == "Ctrl-C":
            os.write(near, b"\x03")
        else:
            demo.send_signal(signal.SIGTERM)
        assert await asyncio.wait_for(demo.wait(), 30) == (130 if how == "Ctrl-C" else 1)
    finally:
        asyncio.get_running_loop().remove_reader(near)
        with suppress(ProcessLookupError):
            demo.kill()
    with suppress(OSError):
        screen.extend(os.read(near, 65536))
    os.close(near)
    for pid in family:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert files(tmp_path) == []
    assert b"Traceback" not in screen
    assert (b"usblnav: terminated" in screen) == (how == "SIGTERM")


def files(folder: Path) -> list[Path]:
    return list(folder.rglob("*"))


def descendants(pid: int) -> list[int]:
    """Children of a process and theirs, from /proc."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            found += [int(child), *descendants(int(child))]
    return found
