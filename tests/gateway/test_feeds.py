"""What an NMEA output is given: solutions at its rate, honest blanks, time that never goes back."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec
import pytest

from drivers.settings import UdpLink
from gateway.config import NmeaOutput
from gateway.outputs.feeds import STALE_S, Feed, open_feed
from gateway.outputs.schema import NavReport, nav_report
from tests.gateway.reports import TARGET
from tests.gateway.test_outputs_schema import solution

RATE_HZ = 10.0


class Plotter:
    """The reader, and the feed it hears."""

    def __init__(self, feed: Feed, ear: socket.socket) -> None:
        self.feed = feed
        self._ear = ear

    async def hear(self) -> list[str]:
        """Fields of the next ZDA (time) and RMC (status)."""
        data = await asyncio.wait_for(asyncio.get_running_loop().sock_recv(self._ear, 4096), 5)
        zda, rmc = data.decode().splitlines()
        return [zda.split(",")[1], rmc.split(",")[2]]


@pytest.fixture
async def plotter() -> AsyncIterator[Plotter]:
    async with opened() as one:
        yield one


@asynccontextmanager
async def opened(target: str | None = None) -> AsyncIterator[Plotter]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.setblocking(False)
        link = UdpLink(port=ear.getsockname()[1])
        settings = NmeaOutput(link=link, sentences=("ZDA", "RMC"), rate_hz=RATE_HZ, target=target)
        async with open_feed(settings, "ship") as feed:
            running = asyncio.create_task(feed.run())
            yield Plotter(feed, ear)
            running.cancel()


def report(utc_ns: int) -> NavReport:
    return nav_report(solution(t_ns=utc_ns), 0)


def hhmmss(utc_ns: int) -> str:
    utc_ns += 5_000_000  # to the nearest hundredth
    return time.strftime("%H%M%S", time.gmtime(utc_ns // 10**9)) + f".{utc_ns // 10**7 % 100:02d}"


async def test_the_first_solution_of_each_period_is_sent(plotter: Plotter) -> None:
    begin = time.time_ns() // 10**9 * 10**9 + 10**9
    for n in range(20):  # 50 Hz
        plotter.feed.nav(report(begin + n * 20_000_000))
    heard = [await plotter.hear() for _ in range(4)]
    assert heard == [[hhmmss(begin + n * 100_000_000), "A"] for n in range(4)]


async def test_a_time_declared_blank_stays_so(plotter: Plotter) -> None:
    begun = time.monotonic()
    plotter.feed.nav(report(time.time_ns()))
    assert (await plotter.hear())[1] == "A"
    blank, status = await plotter.hear()
    assert status == "V"
    assert time.monotonic() - begun >= STALE_S
    now = time.time_ns()
    for late_ns in (1_200_000_000, 900_000_000, 300_000_000):  # a filter that catches up
        plotter.feed.nav(report(now - late_ns))
    plotter.feed.nav(report(time.time_ns() + 1))
    again, status = await plotter.hear()
    assert status == "A"
    assert again >= blank


async def test_solutions_that_are_always_late_are_better_than_none(plotter: Plotter) -> None:
    assert (await plotter.hear())[1] == "V"
    statuses = []
    for _ in range(100):
        plotter.feed.nav(report(time.time_ns() - 2 * 10**9))
        await asyncio.sleep(0.03)
    while len(statuses) < 5:
        statuses.append((await plotter.hear())[1])
    assert statuses.count("A") == 5


async def test_an_output_of_a_target_speaks_of_nothing_else_and_says_when_it_is_lost() -> None:
    async with opened("rov") as plotter:
        now = time.time_ns()
        own = report(now)
        seen = msgspec.structs.replace(TARGET, utc_ns=now)
        plotter.feed.nav(own)
        plotter.feed.target(msgspec.structs.replace(seen, name="sledge"), own)
        plotter.feed.target(seen, own)
        assert await plotter.hear() == [hhmmss(now), "A"]
        plotter.feed.target(msgspec.structs.replace(seen, state="lost"), own)
        assert (await plotter.hear())[1] == "V"
