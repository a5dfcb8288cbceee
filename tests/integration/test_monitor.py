"""The monitor beside a running gateway: on a terminal, into a pipe, and when the gateway ends."""

import asyncio
import fcntl
import os
import pty
import signal
import struct
import subprocess
import termios
from contextlib import closing
from pathlib import Path

import pytest

from gateway.monitor.watch import Listener
from gateway.outputs.zenoh import at
from tests.integration.rig import USBLNAV, Rig
from tests.shared_data import ROOT

pytestmark = pytest.mark.live


async def test_a_gateway_is_watched_through_its_restart(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    async with rig.emulator():
        with closing(Listener(at(rig.endpoint), "*")) as listener:
            async with rig.gateway():
                await rig.until("a true position", rig.is_right)
                await rig.until("word of it", lambda: up_s(listener) is not None)
                shown = await asyncio.to_thread(one_screen, rig.endpoint)
                seen = up_s(listener)
            assert seen is not None
            async with rig.gateway():
                await rig.until("word of the next", lambda: (up_s(listener) or seen) < seen, 20.0)
    vehicle = rig.scenario["vehicle"]
    assert shown.splitlines()[0].startswith(f"{vehicle}   A")
    assert "imu0    kvh1750" in shown
    assert max(map(len, shown.splitlines())) <= 80


def up_s(listener: Listener) -> float | None:
    """How long the gateway runs that is heard."""
    return next((h.status.up_s for h in listener.heard.values() if h.status is not None), None)


def one_screen(endpoint: str) -> str:
    command = [*USBLNAV, "monitor", "--connect", endpoint]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_on_a_terminal_it_waits_for_a_gateway_until_interrupted() -> None:
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    command = [*USBLNAV, "monitor", "--connect", "tcp/127.0.0.1:9"]
    with subprocess.Popen(command, stdout=theirs, stderr=theirs, cwd=ROOT) as process:
        os.close(theirs)
        said = b""
        while b"nobody answers" not in said:
            said += os.read(ours, 4096)
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 130
    os.close(ours)


def test_into_a_pipe_it_says_why_there_is_nothing_to_see() -> None:
    command = [*USBLNAV, "monitor", "--once", "--connect", "tcp/127.0.0.1:9"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 1
    assert done.stderr == "usblnav: zenoh tcp/127.0.0.1:9: nobody answers\n"
