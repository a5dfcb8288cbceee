"""What happens in a soak: damaged bytes all along, and now and then something worse."""

import asyncio
import math
import os
import random
import signal
import time
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from gateway.modes import Mode
from tests.integration.cables import Cable, PtyEnd, UdpEnd
from tests.integration.rig import Rig, brisk, session
from tests.soak.figures import Event, Figures, Run, memory_mb

FAULTS: list[dict[str, Any]] = [
    {"fault": "flip", "device": "imu0", "per_hour": 120, "bits": 3},
    {"fault": "truncate", "device": "imu0", "per_hour": 60},
    {"fault": "junk", "device": "imu0", "per_hour": 60},
    {"fault": "duplicate", "device": "imu0", "per_hour": 60},
    {"fault": "drop", "device": "imu0", "per_hour": 120},
    {"fault": "burst", "device": "imu0", "per_hour": 60, "for_s": 0.2},
    {"fault": "power_cycle", "device": "imu0", "per_hour": 10, "for_s": 0.8},
    {"fault": "clock_drift", "device": "imu0", "at_s": 0, "ppm": 30},
    {"fault": "delay", "device": "imu0", "per_hour": 20, "for_s": 3, "delay_ms": 300},
    {"fault": "flip", "device": "usbl0", "per_hour": 60},
    {"fault": "truncate", "device": "usbl0", "per_hour": 30},
    {"fault": "junk", "device": "usbl0", "per_hour": 60},
]
"""Not fixes that come late: their sentence is timed by its arrival, and no filter can know."""
OUTLIERS = {"probability": 0.02, "extra_range_m": 30, "angle_deg": 20}
LONGEST_CALM_S = 45.0
BACK_WITHIN_S = 40.0
SAMPLE_S = 1.0
TRUE_M = 2.0


class Soak:
    """A gateway, its instruments and a hand that pulls and kills, by a seed."""

    def __init__(self, folder: Path, minutes: float, seed: int) -> None:
        self._chance = random.Random(seed)
        self._folder, self._seconds = folder, 60.0 * minutes
        scenario = brisk(folder)
        scenario |= {"duration_s": self._seconds + 600.0, "seed": seed, "faults": FAULTS}
        scenario["devices"]["usbl0"]["outliers"] = OUTLIERS
        self._scenario = scenario
        self.figures = Figures()

    async def run(self) -> None:
        """Two runs of the gateway; the second begins where the first was."""
        with (
            Cable(UdpEnd()) as imu,
            Cable(PtyEnd(self._folder / "usbl0")) as usbl,
        ):
            self._cables = {"imu0": imu, "usbl0": usbl}
            usbl.end.plug()
            self._rig = Rig(self._folder, self._scenario, self._cables)
            self._rig.write({"state": {"file": str(self._folder / "state")}})
            begun = time.monotonic()
            async with AsyncExitStack() as power:
                # The first state of the configuration is the vehicle's when the emulator begins.
                await self._watched(self._gateway(begun + 0.5 * self._seconds, power))
                if self.figures.runs:
                    await self._watched(self._gateway(begun + self._seconds))
            self.figures.seconds = time.monotonic() - begun
            self.figures.runs = [run for run in self.figures.runs if run.status]
            self.figures.carried = {name: cable.counts for name, cable in self._cables.items()}
            self.figures.emulated = self._rig.emulated

    async def _watched(self, run: Awaitable[None]) -> None:
        """What breaks a run is a finding: the figures are wanted all the same."""
        try:
            await run
        except (AssertionError, pytest.fail.Exception) as failure:
            self.figures.broken.append(str(failure).splitlines()[0])
            print(failure)

    async def _gateway(self, until: float, power: AsyncExitStack | None = None) -> None:
        """One run of the gateway; the cables are cut while it is not there to hear.

        The first one is given the instruments' power, to put it on.
        """
        rig, run = self._rig, Run()
        self._cut(*self._cables)
        rig.forget()
        async with rig.gateway():
            rig.hear_zenoh()
            self._before = {name: cable.counts.arrived for name, cable in self._cables.items()}
            await self._up(*self._cables)
            self._uncut(*self._cables)
            self.figures.runs.append(run)
            if power is not None:
                await power.enter_async_context(rig.emulator())
            await self._recover("gateway started")
            ways = (self._array_pulled, self._imu_silent, self._filter_killed)
            bag: list[Callable[[], Awaitable[None]]] = []
            calm_s = min(LONGEST_CALM_S, self._seconds / 16.0)
            while time.monotonic() + calm_s < until:
                await self._calm(calm_s)
                bag = bag or self._chance.sample(ways, len(ways))
                await bag.pop()()
            await self._calm(max(until - time.monotonic(), 0.0))
            self._cut(*self._cables)
            await self._settled(*self._cables)
            self._sample()

    async def _array_pulled(self) -> None:
        self._cut("usbl0")
        await self._settled("usbl0")
        self._cables["usbl0"].end.unplug()
        await self._calm(self._chance.uniform(1.0, 8.0))
        self._cables["usbl0"].end.plug()
        await self._up("usbl0")
        self._uncut("usbl0")
        await self._recover("array pulled")

    async def _imu_silent(self) -> None:
        self._cut("imu0")
        await self._calm(self._chance.uniform(1.0, 4.0))
        self._uncut("imu0")
        await self._recover("IMU silent")

    async def _filter_killed(self) -> None:
        os.kill(self._rig.worker(), signal.SIGKILL)
        await self._recover("filter killed")

    async def _recover(self, what: str) -> None:
        """Note how long it takes until a position is true again."""
        self._sample()
        begun, begun_unix = time.monotonic(), time.time()
        back_s: float | None = None
        try:
            await self._rig.until("a true position", self._is_true, BACK_WITHIN_S)
            back_s = time.monotonic() - begun
        except pytest.fail.Exception:
            errors = [self._rig.error_m(nav) for nav in self._rig.navs[-1:]]
            print(f"{what}: {errors} m, {self._rig.navs[-1:]}", *self._rig.log[-10:], sep="\n  ")
        self.figures.events.append(Event(what, begun_unix, back_s))

    def _is_true(self) -> bool:
        """Whether the last word is an aided position, true to 2 m or by what it says of itself."""
        if not self._rig.navs or self._rig.navs[-1].mode != Mode.AIDED:
            return False
        nav = self._rig.navs[-1]
        error_m, sigma_m = self._rig.error_m(nav), math.hypot(nav.sd_n_m, nav.sd_e_m)
        return error_m is not None and error_m < max(TRUE_M, 3.0 * sigma_m)

    async def _calm(self, seconds: float) -> None:
        """Nothing happens but faults of the bytes; what the gateway says is judged."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            await asyncio.sleep(min(left, SAMPLE_S))
            self._sample()

    def _sample(self) -> None:
        rig, run = self._rig, self.figures.runs[-1]
        run.memory.append((time.monotonic(), memory_mb(session(rig.process.pid))))
        for nav in rig.navs:
            self.figures.errors.take(nav, rig.truth)
        rig.navs.clear()
        run.status = rig.statuses[-1] if rig.statuses else run.status
        del rig.epochs[:-1], rig.statuses[:-1], rig.notices[:-1]

    async def _up(self, *names: str) -> None:
        """Wait until the gateway has the lines open."""

        def are_up() -> bool:
            return all(self._rig.device(name).get("link", {}).get("up") for name in names)

        self._rig.statuses.clear()
        await self._rig.until("the lines", are_up)

    async def _settled(self, *names: str) -> None:
        """Wait until the gateway has heard what its cables brought; books that differ stay so."""

        def is_all_heard() -> bool:
            return all(
                self._rig.device(name)["link"]["bytes"]
                == self._cables[name].counts.arrived - self._before[name]
                for name in names
            )

        self._rig.statuses.clear()
        await self._rig.until("a status", lambda: self._rig.statuses)
        try:
            await self._rig.until("all bytes", is_all_heard, 5.0)
        except pytest.fail.Exception:
            print(f"{', '.join(names)}: not all bytes were heard")

    def _cut(self, *names: str) -> None:
        for name in names:
            self._cables[name].cut = True

    def _uncut(self, *names: str) -> None:
        for name in names:
            self._cables[name].cut = False
