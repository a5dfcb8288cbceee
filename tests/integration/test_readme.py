"""Every command of the README runs as it stands there: here, or in CI."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.shared_data import ROOT

pytestmark = pytest.mark.live

BY_CI = {"scripts/demo", "scripts/test"}
INSTALL = {
    "python3 -m venv venv",
    "venv/bin/pip install .",
    "venv/bin/usblnav --version",
}
UNTIL_STOPPED = {
    "usblnav decode --codec kvh1750 --link udp:7001": "listening on udp 0.0.0.0:7001",
    "usblnav run -c config.yaml": "ready: imu0, usbl0",
    "usblnav run -c config.yaml --nmea -": "ready: imu0, usbl0",
    "usblnav emulate": "start: ",
}


def commands() -> list[str]:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^( *)```sh\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE)
    return [line.strip() for _, block in blocks for line in block.splitlines() if line.strip()]


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    shutil.copy(ROOT / "config.yaml", tmp_path)
    return tmp_path


def test_ci_runs_the_rest() -> None:
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for command in BY_CI | {"python3 -m venv venv", "venv/bin/usblnav --version"}:
        assert command in ci


@pytest.mark.timeout(600)
def test_commands(clone: Path) -> None:
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    listed = commands()
    assert listed[:2] == ["scripts/demo", "scripts/test"]
    for command in listed:
        if command in BY_CI | INSTALL:
            continue
        if command in UNTIL_STOPPED:
            run_until(command, UNTIL_STOPPED[command], clone, environment)
            continue
        done = subprocess.run(
            command, shell=True, cwd=clone, env=environment, capture_output=True, timeout=120
        )
        assert done.returncode == 0, (command, done.stderr.decode())
    assert (clone / "out" / "nav.csv").stat().st_size > 10_000


def run_until(command: str, sign: str, clone: Path, environment: dict[str, str]) -> None:
    """Start a command that runs on, wait for a line of it, and end it."""
    with subprocess.Popen(
        command.split(),
        cwd=clone,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        try:
            assert any(sign in line for line in process.stderr), command
        finally:
            process.send_signal(signal.SIGTERM)
        process.stderr.read()
        assert process.wait(30) == 0, command
