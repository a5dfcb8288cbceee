"""The daemon under the unit's system call filter: all that it does is permitted there."""

import ctypes.util
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.gateway.recorded import files, topics
from tests.integration.rig import USBLNAV, session
from tests.loopback import free_port
from tests.shared_data import ROOT

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(
        shutil.which("systemd-analyze") is None or ctypes.util.find_library("seccomp") is None,
        reason="systemd-analyze or libseccomp is not installed",
    ),
]
UNIT = ROOT / "systemd" / "usblnav.service"
FILTERED = (sys.executable, "-m", "tests.callfilter")
PROBE = """
import ctypes, errno, os, signal, socket
os.nice(1)
os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
os.close(os.memfd_create("probe"))
signal.pidfd_send_signal(os.pidfd_open(os.getpid()), 0)
libc = ctypes.CDLL(None, use_errno=True)
assert libc.mlockall(7) == 0 or ctypes.get_errno() == errno.ENOMEM
socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM, 4).close()
try:
    os.sched_setaffinity(0, os.sched_getaffinity(0))
except PermissionError:
    print("filtered")
"""


def test_the_filter_permits_what_real_time_and_recording_ask_for() -> None:
    done = subprocess.run(
        [*FILTERED, str(UNIT), sys.executable, "-c", PROBE],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert (done.stdout, done.stderr) == ("filtered\n", "")


def configuration(folder: Path, port: int) -> dict[str, Any]:
    """The example with the IMU alone, a pty and recordings."""
    config: dict[str, Any] = yaml.safe_load((ROOT / "config.yaml").read_text())
    imu = config["devices"]["imu0"] | {"link": {"type": "udp", "bind": "127.0.0.1", "port": port}}
    (folder / "recordings").mkdir()
    return config | {
        "devices": {"imu0": imu},
        "outputs": [{"type": "nmea", "link": {"type": "pty", "symlink": str(folder / "nmea")}}],
        "recording": {"folder": str(folder / "recordings")},
    }


def niceness(pids: list[int]) -> set[int]:
    """Of each process, beside our own; one that has just ended is none."""
    alive = [pid for pid in pids if Path(f"/proc/{pid}").exists()]
    return {os.getpriority(os.PRIO_PROCESS, pid) - os.nice(0) for pid in alive}


@pytest.mark.parametrize(("without", "nice"), [((), {0, 5}), (("setpriority",), {0})])
def test_a_filtered_daemon_records(
    tmp_path: Path, without: tuple[str, ...], nice: set[int]
) -> None:
    port, deadline = free_port(socket.SOCK_DGRAM), time.monotonic() + 120.0
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(configuration(tmp_path, port)))
    options = [word for call in without for word in ("--without", call)]
    command = [*FILTERED, *options, str(UNIT), *USBLNAV, "run", "-c", str(tmp_path / "config.yaml")]
    with (
        (tmp_path / "log").open("wb") as log,
        subprocess.Popen(command, stderr=log, cwd=ROOT, start_new_session=True) as daemon,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as imu,
    ):
        try:
            while not (
                any(file.stat().st_size > 10_000 for file in files(tmp_path / "recordings"))
                and (tmp_path / "nmea").is_symlink()
                and " ready" in (tmp_path / "log").read_text()
            ):
                assert time.monotonic() < deadline, (tmp_path / "log").read_text()
                imu.sendto(os.urandom(1000), ("127.0.0.1", port))
                time.sleep(0.02)
            assert niceness(session(daemon.pid)) == nice
        finally:
            daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(10) == 0
    text = (tmp_path / "log").read_text()
    assert "Traceback" not in text
    assert "not permitted" not in text
    (recording,) = files(tmp_path / "recordings")
    assert any(count > 10 for count in topics(recording).values())
