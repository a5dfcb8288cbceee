"""Every command of the README, and of the docs about what a run leaves, runs as it stands there."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

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


def commands(page: str = "README.md") -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
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
    listed = commands()
    assert listed[:2] == ["scripts/demo", "scripts/test"]
    for command in listed:
        if command in BY_CI | INSTALL:
            continue
        if command in UNTIL_STOPPED:
            run_until(command, UNTIL_STOPPED[command], clone)
            continue
        run(command, clone)
    assert (clone / "out" / "nav.csv").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_commands_about_what_a_run_leaves(clone: Path) -> None:
    """``pytest -m slow tests/integration/test_readme.py``."""
    for command in commands():
        if command.startswith(("usblnav emulate --duration", "usblnav replay sea.pcap")):
            run(command, clone)
    config = yaml.safe_load((clone / "sea.yaml").read_text())
    config |= {"vehicle": "auv1", "recording": {"folder": "recordings"}}
    (clone / "sea.yaml").write_text(yaml.safe_dump(config))
    (clone / "recordings").mkdir()
    with running("usblnav run -c sea.yaml", "ready: ", clone):
        run("usblnav emulate --duration 20", clone)
    for page in ("docs/calibration.md", "docs/recording.md", "docs/report.md"):
        for command in commands(page):
            if command.startswith("usblnav"):  # the rest are how to run other tests
                run(command, clone)
    pages = (clone / "out" / "report.html", clone / "sea-trial.html")
    assert all("navigation report" in page.read_text() for page in pages)
    again, live = ((clone / name / "nav.csv").read_bytes() for name in ("again", "live"))
    assert again == live


def run(command: str, clone: Path) -> None:
    """Run a command to its end."""
    done = subprocess.run(
        command, shell=True, cwd=clone, env=environment(), capture_output=True, timeout=120
    )
    assert done.returncode == 0, (command, done.stderr.decode())


def run_until(command: str, sign: str, clone: Path) -> None:
    """Start a command that runs on, wait for a line of it, and end it."""
    with running(command, sign, clone):
        pass


def environment() -> dict[str, str]:
    """With the program in the path, as in an activated environment."""
    return os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}


@contextmanager
def running(command: str, sign: str, clone: Path) -> Iterator[None]:
    """A command that runs on, from a line of it to the end of the body."""
    with subprocess.Popen(
        command.split(),
        cwd=clone,
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        try:
            assert any(sign in line for line in process.stderr), command
            yield
        finally:
            process.send_signal(signal.SIGTERM)
        process.stderr.read()
        assert process.wait(30) == 0, command
