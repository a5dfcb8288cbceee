"""The filter process and its host: the same answers as in-process, through deaths of all kinds."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from gateway.config import Config
from gateway.estimator import Estimator
from gateway.filter_process import channel, pair
from gateway.filter_process import host as host_module
from gateway.messages import (
    FilterCounts,
    ImuBlock,
    NavSolution,
    UsblFix,
)
from tests.integration.hosted import RATE_HZ, Input, answers, encoded, hosted, last_nav, recorded
from tests.integration.rig import session
from tests.shared_data import ROOT

pytestmark = pytest.mark.live


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Input:
    return recorded(tmp_path_factory.mktemp("frames"))


async def test_a_process_says_what_the_estimator_says(given: Input) -> None:
    async with hosted(given) as running:
        for measurement in given.measurements:  # all at once: the channel fills up
            running.host.send(measurement)
        expected = answers(given.outputs)
        await running.until(lambda: len(running.outputs) >= len(expected))
        assert encoded(running.outputs) == encoded(expected)
        assert (running.host.status.waiting, running.host.status.dropped) == (0, 0)


async def test_a_new_worker_goes_on_where_the_last_one_was(given: Input) -> None:
    half = len(given.measurements) // 2
    end = last_nav(given)
    async with hosted(given) as running:
        first = await running.ready()
        for measurement in given.measurements[:half]:
            running.host.send(measurement)
        await running.until(lambda: len(running.navs()) >= 50)
        used = running.navs()[-1].fixes_used
        assert used > 5
        os.kill(first, signal.SIGKILL)
        for measurement in given.measurements[half:]:
            running.host.send(measurement)
        await running.solved(end.t_ns)
        assert running.host.status.restarts == 1
        assert running.host.status.pid != first
    navs = running.navs()
    whole = [output for output in given.outputs if isinstance(output, NavSolution)]
    assert [nav.t_ns for nav in navs] == [nav.t_ns for nav in whole]  # none lost, none twice
    assert navs == whole  # with the last bit


async def test_a_spare_that_dies_is_replaced_and_nothing_else_minds(
    given: Input, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    half = len(given.measurements) // 2
    async with hosted(given) as running:
        await running.until(lambda: running.host.status.spare_pid is not None)
        before_it_works = running.host.status.spare_pid
        assert before_it_works is not None
        os.kill(before_it_works, signal.SIGKILL)
        worker = await running.ready()
        spare = running.host.status.spare_pid
        assert spare not in (None, before_it_works, worker)
        for measurement in given.measurements[:half]:
            running.host.send(measurement)
        await running.until(lambda: len(running.navs()) >= 50)
        os.kill(spare, signal.SIGKILL)
        os.kill(worker, signal.SIGKILL)
        for measurement in given.measurements[half:]:
            running.host.send(measurement)
        await running.solved(last_nav(given).t_ns)
        assert running.host.status.restarts == 1
        assert running.host.status.dropped == 0
        assert running.host.status.pid not in (None, worker)
    said = [message.split(" process ")[1] for message in caplog.messages if "process" in message]
    assert sorted(said) == [
        "ended unseen; starting it again",
        "was killed by SIGKILL; starting another",
        "was killed by SIGKILL; starting another",
    ]


async def test_an_input_that_kills_workers_is_thrown_away_and_no_other(
    given: Input, caplog: pytest.LogCaptureFixture
) -> None:
    ragged = ImuBlock(b"\0" * 8, b"\0" * 56)  # seven numbers in a row of eight
    async with hosted(given) as running:
        await running.ready()
        for measurement in (*given.measurements[:900], ragged, *given.measurements[900:]):
            running.host.send(measurement)
        expected = answers(given.outputs)
        await running.until(lambda: len(running.outputs) >= len(expected))
        assert (running.host.status.restarts, running.host.status.dropped) == (2, 1)
    assert encoded(running.outputs) == encoded(expected)
    said = [message.partition("filter process")[2] for message in caplog.messages]
    assert sorted(said) == [
        " ended with exit code 1; starting it again",
        " ended with exit code 1; starting it again",
        ": an input of which 2 died is thrown away",
    ]


async def test_a_worker_that_hangs_costs_the_oldest_data_only(
    given: Input, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_module, "most_kept", lambda _config: 500)
    monkeypatch.setattr(pair, "BUFFER_BYTES", 65_536)
    async with hosted(given) as running:
        pid = await running.ready()
        os.kill(pid, signal.SIGSTOP)
        for measurement in given.measurements:
            running.host.send(measurement)
        status = running.host.status
        assert (status.waiting, status.kept) == (500, 0)
        assert 0 < status.dropped < len(given.measurements) - 500
        os.kill(pid, signal.SIGCONT)
        await running.solved(last_nav(given).t_ns)
        assert running.host.status.restarts == 0
        assert running.navs()[-1].t_ns == last_nav(given).t_ns


@pytest.mark.parametrize("hangs", [False, True])
async def test_a_worker_ends_with_its_host(given: Input, hangs: bool) -> None:
    async with hosted(given) as running:
        pid = await running.ready()
        if hangs:
            os.kill(pid, signal.SIGSTOP)
        else:  # signals are for the host to judge
            os.kill(pid, signal.SIGTERM)
            os.kill(pid, signal.SIGINT)
            running.host.send(given.measurements[0])
            await running.until(lambda: running.host.status.waiting == 0)
            assert running.host.status.restarts == 0
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


async def test_what_was_sent_is_answered_before_the_end(given: Input) -> None:
    sent = given.measurements[:800]
    fix, newest = next(m for m in sent if isinstance(m, UsblFix)), sent[-1]
    assert isinstance(newest, ImuBlock)
    sent = [*sent, msgspec.structs.replace(fix, t_ns=newest.t_last_ns - 900_000_000)]
    async with hosted(given) as running:
        await running.ready()
        for measurement in sent:
            running.host.send(measurement)
        await running.host.drain()
        said = encoded(running.outputs)
    estimator = Estimator(given.config, given.rate_hz)
    before = [output for m in sent for output in estimator.feed(m)]
    at_the_end = list(estimator.finish())  # too much was to be run again to be done at once
    assert len(at_the_end) == 1
    assert said == encoded(answers([*before, *at_the_end]))
    assert running.host.status.restarts == 0


COMPILED = """
import sys
import msgspec
from gateway.estimator import Estimator
from gateway.filter_process.channel import Prepare, read_in_template, read_in_worker
from gateway.fusion.warmup import warm_up
from gateway.messages import Checkpoint, SavedState

def kernels():
    found = {}
    for module in [m for name, m in sys.modules.items() if name.startswith("gateway.")]:
        for name, value in vars(module).items():
            if hasattr(value, "nopython_signatures"):
                found[value.__module__ + "." + name] = list(value.nopython_signatures)
    return found

first, *rest = msgspec.msgpack.decode(sys.stdin.buffer.read())
orders, measurements = read_in_template(first), [read_in_worker(data) for data in rest]
assert isinstance(orders, Prepare)
warm_up()
before = kernels()
half = len(measurements) // 2

def given_by(resume, measurements, kind):
    estimator = Estimator(orders.config, orders.rate_hz, resume)
    outputs = [output for measurement in measurements for output in estimator.feed(measurement)]
    return estimator, [output for output in outputs if isinstance(output, kind)]

_, states = given_by(None, measurements[:half], SavedState)
estimator, _ = given_by(states[-1], measurements[half:], SavedState)
_, checkpoints = given_by(None, measurements, Checkpoint)
for checkpoint in checkpoints[:1]:
    given_by(checkpoint, measurements[checkpoint.received :], Checkpoint)
after = kernels()
assert before
compiled = {name for name in after if after[name] != before[name]}
print(len(checkpoints), compiled or "nothing", estimator.counts())
"""


@pytest.mark.parametrize("unusual", [False, True])
def test_ready_means_that_nothing_is_left_to_compile(given: Input, unusual: bool) -> None:
    """Nor is anything for a worker that takes up where another left off."""
    plain = msgspec.to_builtins(given.config)
    plain["filter"]["history_s"] = 1.0
    if unusual:
        plain["filter"] |= {"coupling": "loose", "error": "left_invariant"}
        plain["initial"]["align"] = {"heading": "unknown", "level_s": 5.0}
        plain["devices"]["usbl0"]["prior"] |= {"latency_ms": 10.0, "lever_arm_m": 0.1}
    config = msgspec.convert(plain, Config)
    messages = [channel.Prepare(config, RATE_HZ), *given.measurements]
    done = subprocess.run(
        [sys.executable, "-c", COMPILED],
        input=msgspec.msgpack.encode([channel.encode(message) for message in messages]),
        capture_output=True,
        cwd=ROOT,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr.decode()
    checkpoints, compiled, counts = done.stdout.decode().split(" ", 2)
    assert compiled == "nothing"
    assert int(checkpoints) > 0 or unusual
    assert "fixes_used=0" not in counts
    assert FilterCounts.__name__ in counts


async def test_a_cold_start_is_told(
    given: Input,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """Half a minute in which nothing else is said: the cache of compiled functions is empty."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    caplog.set_level("INFO")
    async with hosted(given) as running:
        await running.until(lambda: "compiling the filter" in caplog.text)
        assert not running.host.status.ready


def test_one_begun_for_a_configuration_that_is_wrong_is_gone_with_the_command(
    tmp_path: Path,
) -> None:
    (tmp_path / "config.yaml").write_text("vehicle: 1\n")
    command = [sys.executable, "-m", "gateway", "run", "-c", str(tmp_path / "config.yaml")]
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, cwd=ROOT, start_new_session=True
    ) as process:
        _, said = process.communicate(timeout=60)
    assert process.returncode == 2
    assert said.startswith(bytes(tmp_path / "config.yaml"))
    assert session(process.pid) == []
