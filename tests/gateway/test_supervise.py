"""Supervision: what is retried, how long it waits, what it says."""

import asyncio

import pytest

from drivers.links import LinkError
from gateway.supervise import Alive, Notice, is_retryable, keep_running


class Rig:
    """A line that follows a script, on a clock that only moves when somebody sleeps."""

    def __init__(self, script: list[object]) -> None:
        self.script = script
        self.now = 100.0
        self.waits: list[float] = []
        self.notices: list[Notice] = []

    async def sleep(self, seconds: float) -> None:
        self.waits.append(seconds)
        self.now += seconds

    async def line(self, alive: Alive) -> None:
        """A number is so many seconds of life, an exception ends the try, the script's end too."""
        while self.script:
            step = self.script.pop(0)
            if isinstance(step, BaseException):
                raise step
            alive()
            self.now += step
            alive()

    async def run(self) -> None:
        await keep_running(
            "imu0",
            self.line,
            report=self.notices.append,
            clock=lambda: self.now,
            sleep=self.sleep,
        )


def gone() -> LinkError:
    return LinkError("/dev/ttyUSB0: hung up")


async def test_loss_and_recovery_are_said_once_each() -> None:
    rig = Rig([60, gone(), gone(), gone(), gone(), 60])
    await rig.run()
    assert rig.notices == [
        Notice("imu0", False, "imu0: /dev/ttyUSB0: hung up; trying until it is back"),
        Notice("imu0", True, "imu0: back after 3.8 s"),
    ]


async def test_waits_double_up_to_the_longest() -> None:
    rig = Rig([gone() for _ in range(8)])
    await rig.run()
    assert rig.waits == [0.25, 0.5, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0]


async def test_a_healthy_while_starts_the_waits_anew() -> None:
    rig = Rig([gone(), gone(), gone(), 10, gone(), gone(), 1, gone(), gone()])
    await rig.run()
    assert rig.waits == [0.25, 0.5, 1.0, 0.25, 0.5, 1.0, 2.0]


async def test_a_line_that_comes_and_goes_is_not_told_of_every_time() -> None:
    flapping: list[object] = [20.0]
    for _ in range(20):
        flapping += [gone(), 0.1]
    rig = Rig([*flapping, 20.0])
    await rig.run()
    assert [notice.up for notice in rig.notices] == [False, True, False, True]
    assert rig.notices[2].text.endswith("until it is steady")


async def test_the_first_failure_at_start_is_said_too() -> None:
    rig = Rig([gone(), gone(), 1])
    await rig.run()
    assert [notice.up for notice in rig.notices] == [False, True]


@pytest.mark.parametrize(
    "bug",
    [ValueError("a bug"), ExceptionGroup("mixed", [OSError("line"), ZeroDivisionError()])],
)
async def test_what_is_not_a_lost_line_goes_through(bug: Exception) -> None:
    rig = Rig([1, bug])
    with pytest.raises(type(bug)) as caught:
        await rig.run()
    assert caught.value is bug
    assert rig.waits == []


async def test_cancelling_ends_it_during_a_wait() -> None:
    async def line(_alive: Alive) -> None:
        raise gone()

    said = asyncio.Event()
    task = asyncio.create_task(keep_running("imu0", line, report=lambda _notice: said.set()))
    await said.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


async def test_a_group_of_lost_lines_shows_its_first_line() -> None:
    rig = Rig([ExceptionGroup("tasks", [ExceptionGroup("inner", [gone()])]), 1])
    await rig.run()
    assert rig.notices[0].text == "imu0: /dev/ttyUSB0: hung up; trying until it is back"


async def test_the_log_is_told_by_default(caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig([gone(), 1])
    with caplog.at_level("INFO"):
        await keep_running("imu0", rig.line, clock=lambda: rig.now, sleep=rig.sleep)
    assert [record.levelname for record in caplog.records] == ["WARNING", "INFO"]


def test_what_may_be_tried_again() -> None:
    assert is_retryable(gone())
    assert is_retryable(ConnectionResetError())
    assert is_retryable(TimeoutError())
    assert is_retryable(ExceptionGroup("tasks", [gone(), OSError()]))
    assert not is_retryable(ExceptionGroup("tasks", [gone(), KeyError()]))
    assert not is_retryable(RuntimeError())
    assert not is_retryable(asyncio.CancelledError())
