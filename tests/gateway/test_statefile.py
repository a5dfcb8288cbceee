"""The state on disk: fresh, old, damaged, foreign, and a disk that will not take it."""

import hashlib
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from drivers.hosttime import now_ns
from drivers.links.holder import process_name
from gateway import statefile
from gateway.clock import ClockMemory, Clocks, DeviceClock, aged
from gateway.config import Config, StateFile
from gateway.emulator import twin
from gateway.machine import bootclock
from gateway.machine.bootclock import Moment
from gateway.messages import SavedState
from gateway.resume import COLD, Resume
from gateway.schema import build
from gateway.statefile import Keeper, Saved
from tests.gateway.emulated import demo_data, make

S = 1_000_000_000
WRITTEN = Moment("boot", 500 * S, 1_780_000_000 * S, True)
STATE = SavedState(499 * S, b"x" * 20, b"P" * 80, b"c" * 8, 7, 1, 0, None, {"1": (3, 1.1)})
"""A second old when it was written."""


def clocks() -> Clocks:
    """A clock that heard its device each 50 ms, up to the time of the state."""
    clock = DeviceClock(1e-6, 1 << 32)
    for n in range(400):
        clock.take([(50_000 * n, STATE.t_ns + (n - 399) * 50_000_000)])
    memory = clock.memory()
    assert memory is not None
    return {"imu0": {"time": memory}}


def left(now_ns: int | None) -> Clocks:
    return {"imu0": {"time": aged(clocks()["imu0"]["time"], now_ns)}}


def placed(resume: Resume) -> ClockMemory:
    return resume.clocks["imu0"]["time"]


@pytest.fixture(scope="module")
def config() -> Config:
    config = build(Config, twin.gateway_config(make(demo_data())), [])
    assert config is not None
    return config


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state"


def packed(config: Config) -> bytes:
    setup = statefile.setup_of(config)
    return statefile.pack(Saved(WRITTEN, config.vehicle, setup, STATE, clocks()))


def after(seconds: float, **changes: object) -> Moment:
    """A moment after the writing, the clocks running on."""
    ns = round(seconds * S)
    at = Moment(WRITTEN.boot, WRITTEN.mono_ns + ns, WRITTEN.utc_ns + ns, True)
    return msgspec.structs.replace(at, **changes)


def test_a_fresh_state_is_gone_on_from(
    config: Config, path: Path, said: Callable[[], list[str]]
) -> None:
    path.write_bytes(packed(config))
    at = after(2.5)
    assert statefile.resume(path, config, at) == Resume(STATE, left(at.mono_ns))
    assert said() == [f"state file {path}: going on from a state 3.5 s old"]


def test_after_another_boot_its_time_is_on_the_new_clock(config: Config, path: Path) -> None:
    path.write_bytes(packed(config))
    resume = statefile.resume(path, config, after(60.0, boot="next", mono_ns=20 * S))
    assert resume.state == msgspec.structs.replace(STATE, t_ns=(20 - 61) * S)
    assert placed(resume).placed is None  # the host's time begins anew, the device's need not
    assert placed(resume).before == clocks()["imu0"]["time"].before


def test_a_file_of_the_version_before_has_no_clocks(
    config: Config, path: Path, said: Callable[[], list[str]]
) -> None:
    class Saved1(msgspec.Struct, array_like=True):
        written: Moment
        vehicle: str
        setup: bytes
        state: SavedState

    body = msgspec.msgpack.encode(
        Saved1(WRITTEN, config.vehicle, statefile.setup_of(config), STATE)
    )
    digest = hashlib.blake2b(body, digest_size=16).digest()
    path.write_bytes(b"usblnav state\n\x01\x00" + digest + body)
    assert statefile.resume(path, config, after(1.0)) == Resume(STATE)
    path.write_bytes(b"usblnav state\n\x03\x00" + digest + body)
    said()
    assert statefile.resume(path, config, after(1.0)) == COLD
    assert said() == [
        f"state file {path}: is of version 3, not 2; kept as state.foreign; starting cold"
    ]


def test_what_is_old_or_of_an_unknown_age_is_not(
    config: Config, path: Path, said: Callable[[], list[str]]
) -> None:
    path.write_bytes(packed(config))
    for at, why in (
        (after(298.9), None),
        (after(299.1), "5 min old"),
        (after(86400.0 * 5), "5 days old"),
        (after(-1.0), "was written in the future, by the clock of now"),
        (after(9.0, boot="next", is_sure=False), "is of another boot, and no hardware clock"),
    ):
        resume = statefile.resume(path, config, at)
        assert (resume.state is None) == (why is not None)
        assert placed(resume).before == clocks()["imu0"]["time"].before  # of clocks always
        (line,) = said()
        assert why is None or line.startswith(f"state file {path}: {why}")
        assert why is None or line.endswith("; starting cold")
    assert path.read_bytes() == packed(config)


def test_there_need_be_no_file(config: Config, path: Path, said: Callable[[], list[str]]) -> None:
    assert statefile.resume(path, config, after(1.0)) == COLD
    assert said() == []


def test_no_damage_is_overlooked_and_none_is_a_traceback(
    config: Config, path: Path, said: Callable[[], list[str]]
) -> None:
    """Each byte in turn changed, and the file cut off after each."""
    whole = packed(config)
    aside = path.with_name("state.damaged"), path.with_name("state.foreign")
    for n in range(len(whole)):
        for data in (whole[:n] + bytes([whole[n] ^ 0x41]) + whole[n + 1 :], whole[:n]):
            path.write_bytes(data)
            assert statefile.resume(path, config, after(1.0)) == COLD
            assert not path.exists()
            assert data in [file.read_bytes() for file in aside if file.exists()]
            (line,) = said()
            assert line.startswith(f"state file {path}: is ")
            assert line.endswith("; starting cold")


def test_what_is_no_file_or_cannot_be_read_is_said(
    config: Config, path: Path, said: Callable[[], list[str]]
) -> None:
    path.mkdir()
    assert statefile.resume(path, config, after(1.0)) == COLD
    assert said() == [f"state file {path}: is a directory; starting cold"]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"vehicle": "auv2"}, "is of the vehicle auv2"),
        ({"sound_speed_m_s": 1480.0}, "is of another configuration"),
        ({"beacons": {}}, "is of another configuration"),
        ({"outputs": ()}, None),
        ({"state": StateFile(period_s=7.0)}, None),
    ],
)
def test_the_state_of_another_vehicle_or_setup_is_set_aside(
    config: Config,
    path: Path,
    said: Callable[[], list[str]],
    change: dict[str, object],
    why: str | None,
) -> None:
    data = packed(msgspec.structs.replace(config, **change))
    path.write_bytes(data)
    state = statefile.resume(path, config, after(1.0)).state
    if why is None:
        assert state == STATE
        return
    assert state is None
    assert path.with_name("state.foreign").read_bytes() == data
    assert said() == [f"state file {path}: {why}; kept as state.foreign; starting cold"]


def test_an_instrument_moved_on_the_vehicle_is_another_setup_its_line_is_not(
    config: Config,
) -> None:
    def with_usbl(**change: object) -> bytes:
        usbl = msgspec.structs.replace(config.devices["usbl0"], **change)
        devices = config.devices | {"usbl0": usbl}
        return statefile.setup_of(msgspec.structs.replace(config, devices=devices))

    assert with_usbl(link=config.devices["imu0"].link) == statefile.setup_of(config)
    assert with_usbl(lever_arm_m=(0.0, 0.0, 1.0)) != statefile.setup_of(config)


def test_where_it_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert statefile.place(StateFile()) is None
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/usblnav:/var/lib/other")
    assert statefile.place(StateFile()) == Path("/var/lib/usblnav/state")
    assert statefile.place(StateFile(file="/data/state")) == Path("/data/state")


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


@contextmanager
def keeper(path: Path, config: Config) -> Iterator[Keeper]:
    brisk = msgspec.structs.replace(config, state=StateFile(period_s=0.01))
    keeper = Keeper(path, brisk)
    try:
        yield keeper
    finally:
        keeper.close()


def test_what_is_kept_is_what_is_taken_up(config: Config, path: Path) -> None:
    now = now_ns()
    with keeper(path, config) as running:
        for n in range(50):
            running.keep(msgspec.structs.replace(STATE, t_ns=now - 50 + n), clocks())
    resume = statefile.resume(path, config, bootclock.now())
    assert placed(resume).before == clocks()["imu0"]["time"].before
    assert resume.state == msgspec.structs.replace(STATE, t_ns=now - 1)  # the last, at the end too
    assert [file.name for file in path.parent.iterdir()] == ["state"]
    assert running.status.failed == 0
    assert running.status.age_s is not None


@contextmanager
def full_disk() -> Iterator[None]:
    """Let no file grow beyond a few bytes, as if the disk were full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_said_once_and_so_is_its_end(
    config: Config, path: Path, said: Callable[[], list[str]]
) -> None:
    now = now_ns()
    with keeper(path, config) as running:
        running.keep(msgspec.structs.replace(STATE, t_ns=now), {})
        until(lambda: running.status.written == 1)
        kept = path.read_bytes()
        with full_disk():
            for n in range(3):
                running.keep(STATE, {})
                until(lambda n=n: running.status.failed > n)
        assert path.read_bytes() == kept
        assert [file.name for file in path.parent.iterdir()] == ["state"]
        running.keep(STATE, {})
        until(lambda: running.status.written == 2)
    assert said() == [
        f"state file {path}: file too large; trying again",
        f"state file {path}: written again",
    ]


def test_a_folder_that_is_not_there_yet_is_waited_for(
    config: Config, tmp_path: Path, said: Callable[[], list[str]]
) -> None:
    path = tmp_path / "later" / "state"
    with keeper(path, config) as running:
        running.keep(STATE, {})
        until(lambda: running.status.failed == 1)
        path.parent.mkdir()
        running.keep(STATE, {})
        until(lambda: running.status.written == 1)
    assert [line.rpartition(": ")[2] for line in said()] == [
        "no such file or directory; trying again",
        "written again",
    ]


def test_a_file_that_another_gateway_keeps_is_left_alone(
    path: Path, config: Config, caplog: pytest.LogCaptureFixture
) -> None:
    """Its state is not read, nor set aside, nor written over; with its process it is free again."""
    keeps = "import sys; from gateway.machine.claim import claim; from pathlib import Path\n"
    keeps += "claim(Path(sys.argv[1])); print('kept', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", keeps, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"kept\n"
        assert statefile.claimed(path) == (None, None)
        (record,) = caplog.records
        assert record.getMessage() == (
            f"state file {path}: kept by another gateway ({process_name(other.pid)});"
            " going on without one"
        )
        other.kill()
    place, held = statefile.claimed(path)
    assert place == path
    assert held is not None
    assert statefile.claimed(path) == (None, None), "it is held by this process now"
    os.close(held)


def test_a_disk_that_takes_no_lock_is_no_hindrance(tmp_path: Path) -> None:
    path = tmp_path / "missing" / "state"
    assert statefile.claimed(path) == (path, None)
    assert statefile.claimed(None) == (None, None)
