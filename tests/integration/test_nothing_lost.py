"""What dies is replaced and nothing is lost: the filter process under load, the whole daemon."""

import asyncio
import math
import os
import random
import signal
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from gateway import statefile
from gateway.messages import FilterCounts
from gateway.modes import Mode
from tests.integration.disks import fill
from tests.integration.hosted import Hosted, Input, answers, encoded, hosted, recorded
from tests.integration.rig import Rig, brisk

pytestmark = pytest.mark.live


class Death(NamedTuple):
    """A worker killed: after how many inputs, how many were kept for the next, when."""

    at: int
    kept: int
    t: float


async def survive(given: Input, kills: set[int], duration_s: float) -> tuple[Hosted, list[Death]]:
    """Feed a recording in some time, killing the worker at some of its inputs; hear it all."""
    deaths: list[Death] = []
    async with hosted(given) as running:
        await running.ready()
        host, begun = running.host, time.perf_counter()
        killed = None
        for n, measurement in enumerate(given.measurements):
            due = begun + duration_s * n / len(given.measurements)
            if n % 16 == 0 or due > time.perf_counter():
                await asyncio.sleep(max(0.0, due - time.perf_counter()))
            if n in kills:
                await running.until(lambda old=killed: host.status.pid not in (None, old))
                killed, kept = host.status.pid, host.status.kept
                assert killed is not None
                os.kill(killed, signal.SIGKILL)
                deaths.append(Death(n, kept, time.perf_counter()))
            host.send(measurement)
        await running.until(lambda: len(running.outputs) >= len(answers(given.outputs)))
        assert host.status.restarts == len(kills)
        assert (host.status.dropped, host.status.forgotten) == (0, 0)
    return running, deaths


def back_s(running: Hosted, deaths: list[Death]) -> list[float]:
    """From each death to the first word of the next worker."""
    firsts = [min(t for t, worker in running.heard if worker > n) for n in range(len(deaths))]
    return [first - death.t for first, death in zip(firsts, deaths, strict=True)]


def assert_as_if_nothing_had_died(running: Hosted, given: Input) -> None:
    """Each output once, in order, and equal with the last bit to the uninterrupted run's."""
    assert encoded(running.outputs) == encoded(answers(given.outputs))
    counts = [output for output in running.outputs if isinstance(output, FilterCounts)]
    samples = sum(len(m.t_ns) // 8 for m in given.measurements if isinstance(m.t_ns, bytes))
    assert 0 <= samples - counts[-1].imu_samples <= 1.1 * given.config.imu[1].rate_hz


async def test_a_filter_killed_again_and_again_says_what_it_would_have_said(
    tmp_path: Path,
) -> None:
    """Before the first checkpoint, after it, and while the one before catches up."""
    given = recorded(tmp_path, duration_s=15.0, rate_hz=50.0)
    n = len(given.measurements)
    early, late = n // 5, 9 * n // 10
    running, deaths = await survive(given, {early, late, late + 40}, 3.0)
    assert_as_if_nothing_had_died(running, given)
    assert deaths[0].kept == early


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("imu_hz", [200.0, 1000.0])
async def test_twenty_kills_at_random_moments_under_load(tmp_path: Path, imu_hz: float) -> None:
    """``pytest -m slow -s -k twenty tests/integration``: in real time, with 10 s of history."""
    seconds = 90.0
    given = recorded(tmp_path, duration_s=seconds, imu_hz=imu_hz, history_s=10.0, rate_hz=50.0)
    n = len(given.measurements)
    chance = random.Random(4)
    kills = sorted(chance.sample(range(n // 50, n), 20))
    running, deaths = await survive(given, set(kills), seconds)
    print(f"\nIMU {imu_hz:g} Hz: killed after (s), inputs kept, back after (ms)")
    for death, took_s in zip(deaths, back_s(running, deaths), strict=True):
        print(f"{seconds * death.at / n:8.2f} {death.kept:8d} {took_s * 1e3:8.1f}")
    assert_as_if_nothing_had_died(running, given)
    assert max(back_s(running, deaths)) < 5.0


@pytest.mark.slow
async def test_kills_during_a_long_alignment(tmp_path: Path) -> None:
    """``pytest -m slow -k alignment tests/integration``: no input of a minute is forgotten."""
    given = recorded(tmp_path, duration_s=90.0, rate_hz=50.0, level_s=60.0)
    n = len(given.measurements)
    kills = {n // 3, 3 * n // 5, 2 * n // 3, 5 * n // 6}
    running, deaths = await survive(given, kills, 15.0)
    assert_as_if_nothing_had_died(running, given)
    solved = [nav for nav in running.navs() if nav.mode is not Mode.ALIGNING]
    assert (solved[0].t_ns - running.navs()[0].t_ns) * 1e-9 == pytest.approx(60.0, abs=0.5)
    assert deaths[2].kept > 40.0 * given.config.imu[1].rate_hz


async def test_a_killed_daemon_goes_on_from_its_state_file(tmp_path: Path) -> None:
    """With the state of its filter, and with the clock of an IMU that tells its own time."""
    scenario = brisk(tmp_path)
    scenario["devices"]["imu0"]["options"]["format"] = "b"
    rig = Rig(tmp_path, scenario)
    rig.write({"state": {"period_s": 0.5}})
    folder = tmp_path / "state directory"
    folder.mkdir()
    async with rig.emulator():
        async with rig.gateway(ends=-signal.SIGKILL, STATE_DIRECTORY=str(folder)):
            rig.hear_zenoh()
            await rig.until("a true position", rig.is_right)
            await rig.until("a state", lambda: rig.state_file().get("written", 0) >= 2)
            clock = await rig.until("a clock to rely on", lambda: locked_clock(rig))
            written = rig.state_file()["written"] + 2
            await rig.until("its state", lambda: rig.state_file()["written"] >= written)
            used = rig.navs[-1].fixes_used
            killed = time.monotonic()
            await rig.kill()
        rig.forget()
        async with rig.gateway(STATE_DIRECTORY=str(folder)):
            rig.hear_zenoh()
            first = await rig.until("a solution", lambda: rig.navs and rig.navs[0])
            print(f"solutions again {time.monotonic() - killed:.2f} s after the kill")
            (said,) = rig.said("state file")
            assert f"state file {folder / 'state'}: going on from a state" in said
            await rig.until("no claim before a fix", lambda: rig.said("aligning (was invalid)"))
            assert used - 6 <= first.fixes_used  # a state is at most 3 s old
            error_m = await rig.until("the truth", lambda: rig.error_m(first))
            assert error_m < 3.0 * math.hypot(first.sd_n_m, first.sd_e_m)
            heard = await rig.until("the IMU", lambda: first_heard(rig, "imu0"))
            assert (heard["clock"]["state"], heard["clock"]["resets"]) == ("locked", 0)
            assert heard["clock"]["offset_s"] == pytest.approx(clock["offset_s"], abs=2e-3)
            await rig.until("a true position again", rig.is_right)


def locked_clock(rig: Rig) -> dict[str, Any] | None:
    """What the IMU's clock says of itself once it is locked, eight seconds after its first word."""
    clock: dict[str, Any] = rig.device("imu0").get("clock", {})
    return clock if clock.get("state") == "locked" else None


def first_heard(rig: Rig, name: str) -> dict[str, Any] | None:
    """The first status in which a device has been heard."""
    told = (status["devices"][name] for status in rig.statuses)
    return next((device for device in told if device["records"]), None)


async def test_a_daemon_that_is_told_to_begins_cold(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.write({"state": {"file": str(tmp_path / "state")}})
    (tmp_path / "state").write_bytes(b"a state is not even looked at")
    async with rig.gateway("--cold"):
        pass
    assert not rig.said("state file")


async def test_a_full_disk_under_the_state_file_holds_up_nothing(
    tmp_path: Path, small_disk: Path
) -> None:
    rig = Rig(tmp_path)
    state, filler = small_disk / "state", small_disk / "filler"
    state.write_bytes(b"no state at all")
    rig.write({"state": {"file": str(state), "period_s": 0.1}})
    async with rig.gateway(), rig.emulator():
        (damaged,) = rig.said("state file")
        assert damaged.endswith(
            ": is damaged or no state file; kept as state.damaged; starting cold"
        )
        rig.hear_zenoh()
        await rig.until("a state", lambda: rig.state_file().get("written", 0) >= 1)
        fill(filler)
        failed = rig.state_file()["failed"] + 2
        await rig.until("failures", lambda: rig.state_file()["failed"] >= failed)
        await rig.until("a true position", rig.is_right)
        assert state.read_bytes().startswith(statefile.MAGIC)  # the one before
        filler.unlink()
        await rig.until("news of it", lambda: rig.said("written again"))
        complaints = [line.rpartition(": ")[2] for line in rig.said("state file")[1:]]
        assert complaints == ["no space left on device; trying again", "written again"]
    epochs = [epoch for epoch in rig.epochs if epoch.quality > 0]
    assert max(b.t_s - a.t_s for a, b in pairwise(epochs)) < 0.35
