"""docs/install.md followed line by line on a booted Debian, to the service's removal.

Needs root, systemd-nspawn and a folder that can be booted, which is left as it is; a few minutes.
``debootstrap --include=dbus,udev,ca-certificates bookworm /srv/bookworm``
``DEBIAN_ROOT=/srv/bookworm pytest -m slow tests/integration/test_install.py``
Where the machine has packages in folders of its own, DEBIAN_BIND names them, a colon between two.
"""

import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from gateway.emulator.twin import DEMO
from tests.gateway.test_docs import blocks
from tests.shared_data import ROOT

FOLDER = os.environ.get("DEBIAN_ROOT")
pytestmark = [
    pytest.mark.live,
    pytest.mark.slow,
    pytest.mark.timeout(1500),
    pytest.mark.skipif(
        not FOLDER or not shutil.which("systemd-nspawn"), reason="no Debian to boot (DEBIAN_ROOT)"
    ),
]

MOST_S = 600.0
"""For a command of the page."""
SOON_S = 60.0
PAGE = ROOT / "docs" / "install.md"
HERE = "/mnt"
"""Where the machine has the folder of the test, with the checkout."""
EDIT = f"""#!/bin/sh
# What a person does in `systemctl edit`: type these lines in the place for them.
sed -i '/^### Anything between here/r {HERE}/typed' "$1"
"""
USBLNAV = "/opt/usblnav/bin/usblnav"
EMULATE = f"{USBLNAV} emulate -c {HERE}/scenario.yaml --duration 1200"


@dataclass(frozen=True)
class Machine:
    """A booted Debian; `leader` is its first process, as this machine counts them."""

    leader: int

    def shell(self, script: str) -> subprocess.CompletedProcess[str]:
        """Run as root in the checkout, as typed there."""
        given = {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
        given |= {
            "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
            "HOME": HERE,
            "SYSTEMD_EDITOR": f"{HERE}/editor",
            "SYSTEMD_PAGER": "cat",
            "DEBIAN_FRONTEND": "noninteractive",
        }
        script = f"cd {HERE}/usblnav; {script}"
        return subprocess.run(
            [*("nsenter", "--target", str(self.leader), "--all"), "bash", "-ec", script],
            env=given,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=MOST_S,
        )

    def run(self, script: str) -> str:
        """What it prints, if it succeeds."""
        done = self.shell(script)
        assert done.returncode == 0, f"{script}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def write(self, path: str, text: str) -> None:
        """Make a file there, or give it another content."""
        self.run(f"cat > {path} <<'END'\n{text}END\n")

    def until(self, script: str, pattern: str) -> str:
        """What it prints, as soon as that has the pattern in it."""
        end = time.monotonic() + SOON_S
        while not re.search(pattern, printed := self.shell(script).stdout):
            assert time.monotonic() < end, f"{script}: no {pattern} in\n{printed}"
            time.sleep(0.5)
        return printed


def first_process(nspawn: int) -> int | None:
    children = Path(f"/proc/{nspawn}/task/{nspawn}/children").read_text().split()
    return int(children[0]) if children else None


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """A Debian whose disk is forgotten at its end, with a checkout in it."""
    folder = tmp_path_factory.mktemp("debian")
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder / "usblnav")], check=True)
    editor = folder / "editor"
    editor.write_text(EDIT)
    editor.chmod(0o755)
    settings = folder / "90yes"
    settings.write_text('APT::Get::Assume-Yes "true";\nAPT::Install-Recommends "false";\n')
    shown = [path for path in os.environ.get("DEBIAN_BIND", "").split(":") if path]
    log = (folder / "boot.log").open("wb")
    nspawn = subprocess.Popen(
        [
            *("systemd-nspawn", "--quiet", "--boot", "--volatile=overlay"),
            *(f"--directory={FOLDER}", "--register=no", "--keep-unit"),
            *("--resolv-conf=copy-host", "--console=pipe"),
            *(f"--bind={folder}:{HERE}", f"--bind-ro={settings}:/etc/apt/apt.conf.d/90yes"),
            *(f"--bind-ro={path}" for path in shown),
        ],
        # Writable, /sys lets the machine have its own udev.
        env=os.environ | {"SYSTEMD_NSPAWN_API_VFS_WRITABLE": "1"},
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
    )
    try:
        end = time.monotonic() + SOON_S
        while (leader := first_process(nspawn.pid)) is None:
            assert nspawn.poll() is None, (folder / "boot.log").read_text()
            assert time.monotonic() < end
            time.sleep(0.1)
        booted = Machine(leader)
        booted.until("systemctl is-system-running || true", "running|degraded")
        yield booted
    finally:
        nspawn.terminate()
        nspawn.wait(60)
        log.close()


def state_of(machine: Machine) -> str:
    return machine.run("systemctl show -p ActiveState --value usblnav").strip()


def typed(block: str) -> tuple[str, str]:
    """The command of a block, and what is to be typed in the editor that it opens."""
    command, *lines = block.splitlines()
    return command, "\n".join(line.removeprefix("# ") for line in lines)


def test_the_page_from_its_first_line_to_its_last(machine: Machine) -> None:
    install, start, allow, newer, remove, devices = blocks(PAGE, "sh")
    machine.run("apt update")
    machine.run(install)

    # A fault is named, by the check and by the journal, and systemd does not try again.
    machine.write("/etc/usblnav/config.yaml", "devices: {imu0: {kind: imu, codec: nosuch}}\n")
    refused = machine.shell(start)
    assert refused.returncode == 2
    assert "devices.imu0.codec" in refused.stderr
    machine.shell("systemctl start usblnav")
    machine.until("journalctl -u usblnav", "devices.imu0.codec")
    assert state_of(machine) == "failed"

    scenario, config = on_udp()
    machine.write(f"{HERE}/scenario.yaml", yaml.safe_dump(scenario))
    machine.write("/etc/usblnav/config.yaml", yaml.safe_dump(config))
    machine.run(start)
    assert state_of(machine) == "active"
    exposure = machine.run("systemd-analyze security --no-pager usblnav")
    assert "exposure level for usblnav.service: 1.4 OK" in exposure

    machine.run(f"{EMULATE} >{HERE}/emulate.log 2>&1 &")
    machine.until("systemctl status usblnav", "Status: .*aided")
    machine.until("timeout 3 journalctl -u usblnav -f", "ready: imu0, usbl0")
    machine.until(f"{USBLNAV} status --json", '"fixes_used": ?[1-9]')
    a_plotter(machine)

    for block, where, wanted in (
        (allow, "IPAddressAllow", "198.51.100.7"),
        (devices, "DeviceAllow", "char-ttyTHS"),
    ):
        command, lines = typed(block)
        machine.write(f"{HERE}/typed", lines + "\n")
        machine.run(f"script -qec '{command}' /dev/null")  # it wants a terminal
        assert wanted in machine.run(f"systemctl show -p {where} usblnav")

    machine.run(newer)
    assert state_of(machine) == "active"
    machine.until("journalctl -u usblnav", "going on from a state")
    machine.until("systemctl status usblnav", "Status: .*aided")

    machine.run(remove)
    assert machine.shell("systemctl cat usblnav").returncode != 0
    left = "find / -xdev -name '*usblnav*'"
    assert machine.run(left) == ""
    assert machine.shell("getent passwd usblnav").returncode != 0


def a_plotter(machine: Machine) -> None:
    """The lines of the README for gpsd: it hears the service."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    install, listen, stop = (
        line
        for line in re.findall("`([^`]*)`", readme)
        if re.match("apt.* gpsd|gpsd |.* gpsd$", line)
    )
    machine.run(install)
    machine.run(stop)
    machine.run(f"{listen} >{HERE}/gpsd.log 2>&1 & sleep 1")
    machine.until("timeout 10 gpspipe -w -n 10", '"class":"TPV".*"mode":3')
    machine.run("pkill gpsd")


def on_udp() -> tuple[dict[str, Any], dict[str, Any]]:
    """The example's scenario and configuration, with the array on UDP as well.

    The service's /tmp, where the example has its serial line, is its own.
    """
    scenario = yaml.safe_load(DEMO.read_text(encoding="utf-8"))
    config = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))
    scenario["devices"]["usbl0"]["port"] = {"type": "udp", "host": "127.0.0.1", "port": 7002}
    config["devices"]["usbl0"]["link"] = {"type": "udp", "bind": "127.0.0.1", "port": 7002}
    return scenario, config
