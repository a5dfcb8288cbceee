"""The gateway and the emulator as a user runs them, and ears for all that the gateway says."""

import asyncio
import math
import os
import signal
import socket
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
import pynmeagps
import pytest
import yaml

from gateway.emulator import twin
from gateway.emulator.truth import TruthFile
from gateway.outputs.schema import NavReport
from gateway.outputs.zenoh import at, open_subscription
from tests.gateway.emulated import demo_data, make
from tests.integration.cables import Cable
from tests.loopback import free_port
from tests.shared_data import ROOT

T = TypeVar("T")
USBLNAV = (sys.executable, "-m", "gateway")
ROS = {"origin": {"lat_deg": 39.8, "lon_deg": 116.2}}
WITHIN_S = 40.0
"""How long what must come may take on a machine that does much else."""
END_S = 2.0
"""How long SIGTERM may take, as promised."""


def brisk(folder: Path) -> dict[str, Any]:
    """The packaged scenario with a fix every half second, on a port and a pty of its own."""
    data = demo_data() | {"start": "now", "duration_s": 120}
    imu, usbl = data["devices"]["imu0"], data["devices"]["usbl0"]
    imu["port"]["port"] = free_port(socket.SOCK_DGRAM)
    usbl["port"] = {"type": "pty", "symlink": str(folder / "usbl0"), "baud": 115200}
    usbl |= {"period_s": 0.5, "clock": {"source": "arrival", "latency_ms": 100}, "outliers": {}}
    data["devices"] = {"imu0": imu, "usbl0": usbl}
    return data


class Epoch(NamedTuple):
    """One NMEA epoch: what a chart plotter makes of GGA and RMC."""

    t_s: float
    quality: int
    status: str
    mode: str
    lat_deg: float | None
    lon_deg: float | None


def epoch(datagram: bytes) -> Epoch:
    """Read GGA and RMC with somebody else's parser, checksums and all."""
    lines = datagram.decode("ascii").splitlines(keepends=True)
    said = {m.msgID: m for m in map(pynmeagps.NMEAReader.parse, lines)}
    gga, rmc = said["GGA"], said["RMC"]
    t_s = datetime.combine(rmc.date, rmc.time, UTC).timestamp()
    place = (gga.lat, gga.lon) if gga.lat != "" else (None, None)
    return Epoch(t_s, gga.quality, rmc.status, rmc.posMode, *place)


class Rig:
    """Files, addresses and ears of one gateway with its emulator.

    Parameters
    ----------
    scenario
        As in a scenario file. A device with a cable is heard through it.
    """

    def __init__(
        self,
        folder: Path,
        scenario: dict[str, Any] | None = None,
        cables: dict[str, Cable] | None = None,
    ) -> None:
        scenario = scenario or brisk(folder)
        config = twin.gateway_config(make(scenario)) | {"filter": {"max_fix_age_s": 1.5}}
        for name, cable in (cables or {}).items():
            scenario["devices"][name]["port"] = {"type": "udp", "port": cable.port}
            config["devices"][name]["link"] = cable.end.link
        self.endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
        self._nmea_port = free_port(socket.SOCK_DGRAM)
        config["outputs"] = [
            {
                "type": "nmea",
                "link": {"type": "udp", "port": self._nmea_port},
                "sentences": ["GGA", "RMC"],
                "rate_hz": 10,
            },
            {"type": "zenoh", "mode": "peer", "listen": [self.endpoint], "ros": ROS},
        ]
        self.config, self.scenario = config, scenario
        self.config_file, self.scenario_file = folder / "config.yaml", folder / "scenario.yaml"
        self.write({})
        self.scenario_file.write_text(yaml.safe_dump(scenario))
        self._truth_file = folder / "truth.csv"
        self.truth = TruthFile(self._truth_file)
        self._notify_address = str(folder / "notify")
        self._news = asyncio.Event()
        self._stack = ExitStack()
        self.process: asyncio.subprocess.Process
        self.terminal_closes = False
        """Whether it is told to end as a terminal does, all of it at once."""
        self.log: list[str] = []
        self.notices: list[tuple[float, str]] = []
        self.epochs: list[Epoch] = []
        self.navs: list[NavReport] = []
        self.statuses: list[dict[str, Any]] = []
        self.emulated: dict[str, Any] = {}

    def write(self, settings: dict[str, Any]) -> None:
        """Write the configuration with some of its blocks replaced."""
        self.config |= settings
        self.config_file.write_text(yaml.safe_dump(self.config))

    def links(self) -> list[dict[str, Any]]:
        """The gateway's links, device by device."""
        return [device["link"] for device in self.config["devices"].values()]

    async def until(self, what: str, condition: Callable[[], T], within_s: float = WITHIN_S) -> T:
        """Wait until the condition holds, looking whenever the gateway has said something."""
        try:
            async with asyncio.timeout(within_s):
                while not (value := condition()):
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            last = self.epochs[-1:], self.navs[-1:], self.statuses[-1:]
            pytest.fail("\n".join([f"not within {within_s} s: {what}", *self.log, repr(last)]))
        return value

    def error_m(self, there: Epoch | NavReport) -> float | None:
        """Horizontal distance from the truth of the same moment, once that is written down."""
        truth = self.truth.at(there.t_s)
        if truth is None or there.lat_deg is None or there.lon_deg is None:
            return None
        north = (there.lat_deg - truth.lat_deg) * 111_132.0
        east = (there.lon_deg - truth.lon_deg) * 111_320.0
        return math.hypot(north, east * math.cos(math.radians(truth.lat_deg)))

    def is_now(self, quality: int, status: str, mode: str) -> bool:
        """Whether the last word on NMEA claims so much."""
        return bool(self.epochs) and self.epochs[-1][1:4] == (quality, status, mode)

    def is_right(self, within_m: float = 2.0) -> bool:
        """Whether the last word on NMEA is an aided position, and a true one."""
        if not self.is_now(1, "A", "A"):
            return False
        error = self.error_m(self.epochs[-1])
        return error is not None and error < within_m

    def said(self, text: str) -> list[str]:
        """Lines of the log that hold a text."""
        return [line for line in self.log if text in line]

    def device(self, name: str) -> dict[str, Any]:
        """The last status of a device."""
        return self.statuses[-1]["devices"][name] if self.statuses else {}

    def state_file(self) -> dict[str, Any]:
        """The last status of the state file."""
        return (self.statuses[-1]["state_file"] or {}) if self.statuses else {}

    async def kill(self) -> None:
        """Kill the gateway itself; what it has started must end by itself."""
        self.process.kill()
        await self._all_gone(5.0)

    def forget(self) -> None:
        """Forget all that was heard, before another gateway runs."""
        for heard in (self.log, self.notices, self.epochs, self.navs, self.statuses):
            heard.clear()

    def noticed(self, notice: str) -> list[float]:
        """When the service manager was told so (s, monotonic)."""
        return [t for t, text in self.notices if text == notice]

    @asynccontextmanager
    async def gateway(
        self, *options: str, ends: int = 0, **environment: str
    ) -> AsyncIterator[None]:
        """Run ``usblnav run`` while the body does; it must end in time with the given code."""
        with self._ears():
            self.process = await asyncio.create_subprocess_exec(
                *(*USBLNAV, "run", "-c", str(self.config_file), *options),
                stdin=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                env=os.environ | {"NOTIFY_SOCKET": self._notify_address} | environment,
                cwd=ROOT,
                start_new_session=True,
            )
            reading = asyncio.create_task(self._read_log())
            try:
                with self._stack:
                    await self.until("READY", lambda: self.noticed("READY=1"), 120.0)  # compiles
                    yield
                await self._end(ends)
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(self.process.pid, signal.SIGKILL)
                await self.process.wait()
                await reading
        assert not self.said("Traceback"), "\n".join(self.log)

    @asynccontextmanager
    async def emulator(self) -> AsyncIterator[None]:
        """Run ``usblnav emulate`` while the body does."""
        self._truth_file.unlink(missing_ok=True)
        self.truth = TruthFile(self._truth_file)
        arguments = ("-c", str(self.scenario_file), "--truth", str(self._truth_file), "--json")
        process = await asyncio.create_subprocess_exec(
            *(*USBLNAV, "emulate", *arguments),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
            cwd=ROOT,
        )
        try:
            yield
        finally:
            with suppress(ProcessLookupError):
                process.terminate()
            said, _ = await process.communicate()
            assert process.returncode == 0
            self.emulated = msgspec.json.decode(said)

    def hear_zenoh(self) -> None:
        """Hear solutions and status as another program does, as long as the gateway runs."""
        loop = asyncio.get_running_loop()

        def on_nav(_key: str, payload: bytes) -> None:
            self.navs.append(msgspec.json.decode(payload, type=NavReport))
            loop.call_soon_threadsafe(self._news.set)

        def on_status(_key: str, payload: bytes) -> None:
            self.statuses.append(msgspec.json.decode(payload))
            loop.call_soon_threadsafe(self._news.set)

        for topic, take in (("nav", on_nav), ("status", on_status)):
            key = f"usblnav/{self.scenario['vehicle']}/{topic}"
            self._stack.enter_context(open_subscription(at(self.endpoint), key, take))

    def worker(self) -> int:
        """Process id of the filter."""
        return self.named("usblnav-filter")

    def named(self, name: str) -> int:
        """Process id of the one of the gateway's processes that calls itself so."""
        (pid,) = (pid for pid in session(self.process.pid) if comm(pid) == name)
        return pid

    async def _end(self, code: int) -> None:
        """Told to end, everything is gone in time, and nothing left behind."""
        begun = time.monotonic()
        with suppress(ProcessLookupError):
            if self.terminal_closes:
                os.killpg(self.process.pid, signal.SIGHUP)
            else:
                self.process.terminate()
        ended = await asyncio.wait_for(self.process.wait(), 30)
        took_s = time.monotonic() - begun
        assert ended == code, "\n".join([f"exit code {ended}", *self.log])
        assert took_s < END_S, "\n".join([f"the end took {took_s:.1f} s", *self.log])
        await self._all_gone(END_S - took_s)

    async def _all_gone(self, within_s: float) -> None:
        """Wait until nothing is left of what the gateway has started."""
        deadline = time.monotonic() + within_s
        while left := session(self.process.pid):
            assert time.monotonic() < deadline, f"still there: {[comm(pid) for pid in left]}"
            await asyncio.sleep(0.01)

    async def _read_log(self) -> None:
        assert self.process.stderr is not None
        async for line in self.process.stderr:
            self.log.append(line.decode().rstrip())
            self._news.set()

    @contextmanager
    def _ears(self) -> Iterator[None]:
        """Listen as a chart plotter does, and as the service manager."""
        loop = asyncio.get_running_loop()
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plotter,
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager,
        ):
            plotter.bind(("127.0.0.1", self._nmea_port))
            manager.bind(self._notify_address)
            for ear, take in ((plotter, self._take_nmea), (manager, self._take_notice)):
                ear.setblocking(False)
                loop.add_reader(ear, self._hear, ear, take)
            try:
                yield
            finally:
                loop.remove_reader(plotter)
                loop.remove_reader(manager)
                Path(self._notify_address).unlink()

    def _hear(self, ear: socket.socket, take: Callable[[bytes], None]) -> None:
        with suppress(BlockingIOError):
            while True:
                take(ear.recv(65536))
                self._news.set()

    def _take_nmea(self, datagram: bytes) -> None:
        self.epochs.append(epoch(datagram))

    def _take_notice(self, datagram: bytes) -> None:
        self.notices.append((time.monotonic(), datagram.decode()))


def session(leader: int) -> list[int]:
    """Living processes of a session, from /proc; a zombie is none."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(FileNotFoundError, ProcessLookupError):
                state, _, _, of = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
                if int(of) == leader and state != "Z":
                    found.append(int(entry.name))
    return found


def comm(pid: int) -> str:
    """What a process calls itself; nothing if it is gone."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return (Path("/proc") / str(pid) / "comm").read_text().strip()
    return ""
