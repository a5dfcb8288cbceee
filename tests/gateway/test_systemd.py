"""sd_notify on real sockets; the unit and its companions as systemd itself reads them."""

import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway import systemd

FOLDER = Path(__file__).resolve().parents[2] / "systemd"


@pytest.fixture(params=["path", "abstract"])
def manager(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[socket.socket]:
    """The service manager's end of the notification socket."""
    path = str(tmp_path / "notify")
    name = path if request.param == "path" else f"@usblnav-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.bind(name.replace("@", "\0"))
        channel.settimeout(5)
        monkeypatch.setenv("NOTIFY_SOCKET", name)
        yield channel


def test_the_manager_hears_each_message(manager: socket.socket) -> None:
    assert systemd.notify_ready()
    assert manager.recv(4096) == b"READY=1"
    assert systemd.notify_status("aided,\n0.3 m")
    assert manager.recv(4096) == b"STATUS=aided, 0.3 m"
    assert systemd.notify_watchdog()
    assert manager.recv(4096) == b"WATCHDOG=1"
    assert systemd.notify_stopping()
    assert manager.recv(4096) == b"STOPPING=1"


def test_a_manager_that_does_not_read_never_blocks(manager: socket.socket) -> None:
    accepted = 0
    while systemd.notify_watchdog():
        accepted += 1
        assert accepted < 100_000
    assert accepted > 0


def test_without_a_manager_nothing_happens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not systemd.notify_ready()
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    assert not systemd.notify_ready()


@pytest.mark.parametrize(
    ("usec", "pid", "expected"),
    [
        ("20000000", "", 10.0),
        pytest.param("20000000", str(os.getpid()), 10.0, id="own-pid"),
        ("20000000", "1", None),
        ("0", "", None),
        ("soon", "", None),
        (None, "", None),
    ],
)
def test_the_watchdog_is_fed_twice_as_often_as_it_asks(
    usec: str | None, pid: str, expected: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("WATCHDOG_USEC", raising=False)
    if usec is not None:
        monkeypatch.setenv("WATCHDOG_USEC", usec)
    monkeypatch.setenv("WATCHDOG_PID", pid)
    assert systemd.watchdog_interval_s() == expected


def run(*command: str) -> subprocess.CompletedProcess[str]:
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """The unit with a program that exists here: systemd-analyze looks for it."""
    text = (FOLDER / "usblnav.service").read_text()
    text, count = re.subn(r"(?m)^ExecStart=\S+", f"ExecStart={sys.executable}", text)
    assert count == 1
    path = tmp_path / "usblnav.service"
    path.write_text(text)
    return path


def test_systemd_has_nothing_to_say_about_the_unit(unit: Path) -> None:
    done = run("systemd-analyze", "verify", "--man=no", str(unit))
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_systemd_does_complain_about_a_broken_unit(unit: Path) -> None:
    unit.write_text(unit.read_text().replace("[Service]", "[Service]\nWatchdog=on"))
    assert "Watchdog" in run("systemd-analyze", "verify", "--man=no", str(unit)).stderr


def test_the_unit_is_hardened(unit: Path) -> None:
    done = run("systemd-analyze", "security", "--offline=true", "--no-pager", str(unit))
    exposure = re.search(r"Overall exposure level for \S+ ([\d.]+)", done.stdout)
    assert exposure is not None
    assert float(exposure[1]) <= 2.0


def settings(name: str) -> list[str]:
    """What a directive of the unit says, all of its lines together, word by word."""
    lines = (FOLDER / "usblnav.service").read_text().splitlines()
    return " ".join(line.partition("=")[2] for line in lines if line.startswith(f"{name}=")).split()


def test_drivers_of_adapters_are_loaded_before_devices_are_allowed() -> None:
    """A kind of device whose driver is not there yet is left out of what DeviceAllow= permits."""
    modules = {"char-ttyUSB": "usbserial", "char-ttyACM": "cdc_acm"}
    needed = {
        f"modprobe@{modules[word]}.service" for word in settings("DeviceAllow") if word in modules
    }
    assert len(needed) == len(modules)
    assert needed <= set(settings("Wants"))
    assert needed <= set(settings("After"))


def test_all_may_reach_the_ptys_of_the_service_but_not_its_state() -> None:
    modes = {kind: settings(f"{kind}DirectoryMode") for kind in ("Runtime", "State", "Cache")}
    assert modes == {"Runtime": ["0755"], "State": ["0750"], "Cache": ["0750"]}
    assert settings("RuntimeDirectory") == ["usblnav"]


def test_sysusers_and_tmpfiles_make_the_user_and_the_folder(tmp_path: Path) -> None:
    (tmp_path / "etc/usblnav").mkdir(parents=True)
    config = tmp_path / "etc/usblnav/config.yaml"
    config.write_text("")
    root = f"--root={tmp_path}"
    if os.geteuid() != 0:
        pytest.skip("only root can give files to another user")
    made = run("systemd-sysusers", root, str(FOLDER / "usblnav.sysusers"))
    assert made.returncode == 0, made.stderr
    user = (tmp_path / "etc/passwd").read_text().split("usblnav:", 1)[1].split(":")
    made = run("systemd-tmpfiles", root, "--create", str(FOLDER / "usblnav.tmpfiles"))
    assert (made.returncode, made.stderr) == (0, "")
    assert (config.stat().st_mode & 0o777, config.parent.stat().st_mode & 0o777) == (0o640, 0o750)
    assert (config.stat().st_uid, config.stat().st_gid) == (0, int(user[2]))
    groups = (tmp_path / "etc/group").read_text()
    assert re.search(r"(?m)^dialout:x:\d+:usblnav$", groups)


def test_every_udev_rule_is_well_formed() -> None:
    rules = (FOLDER / "99-usblnav.rules").read_text()
    lines = [line for line in rules.splitlines() if line and not line.startswith("#")]
    token = r'[A-Z_]+(\{[\w./]+\})?(==|!=|\+=|=)"[^"]*"'
    for line in lines:
        assert re.fullmatch(rf"{token}(, {token})*", line), line
    assert set(re.findall(r'GOTO="(\w+)"', rules)) == set(re.findall(r'LABEL="(\w+)"', rules))


def test_udev_has_nothing_to_say_about_the_rules() -> None:
    """From systemd 254 on, udev checks its rules itself."""
    if "verify" not in run("udevadm", "--help").stdout:
        pytest.skip("this udevadm cannot verify rules")
    done = run("udevadm", "verify", str(FOLDER / "99-usblnav.rules"))
    assert done.returncode == 0, done.stderr
