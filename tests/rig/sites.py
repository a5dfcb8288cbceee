"""A gateway with its instruments: as processes and cables, or in memory by a clock of its own."""

import math
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import pytest

from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.instruments import emissions
from gateway.emulator.streams import Emission
from gateway.emulator.trajectory import Trajectory
from gateway.estimator import Estimator
from gateway.ingest import Intake, intakes
from gateway.messages import NavSolution, SavedState
from gateway.modes import Mode
from gateway.schema import build
from tests.gateway.emulated import START, make
from tests.integration.cables import Cable
from tests.integration.rig import Rig

T = TypeVar("T")
MAX_FIX_AGE_S = 1.5
RIGHT_M = 2.0
FRESH_S = 0.5
SILENT_S = 1.5


class Site(Protocol):
    """What a test of the rig may do, and what it sees."""

    def gateway(self) -> AbstractAsyncContextManager[None]:
        """The gateway runs while the body does, and goes on from where an earlier one was."""
        ...

    def emulator(self) -> AbstractAsyncContextManager[None]:
        """The instruments have power while the body runs."""
        ...

    def unplug(self, device: str) -> None: ...

    def plug(self, device: str) -> None: ...

    async def until(self, what: str, condition: Callable[[], T], within_s: float = 10.0) -> T: ...

    def is_right(self) -> bool:
        """Whether the last word is an aided position, and a true one."""
        ...

    def is_reckoning(self) -> bool:
        """Whether the last word is a position without fixes."""
        ...

    def is_silent(self) -> bool:
        """Whether no position is claimed."""
        ...

    def counts(self, device: str) -> dict[str, Any]:
        """The device's counts, as in the status."""
        ...


class Live:
    """Processes, cables, NMEA and Zenoh."""

    def __init__(self, folder: Path, scenario: dict[str, Any], cables: dict[str, Cable]) -> None:
        self._cables = cables
        self._rig = Rig(folder, scenario, cables)
        self._rig.write({"state": {"file": str(folder / "state"), "period_s": 0.2}})
        self.until = self._rig.until
        self.counts = self._rig.device

    @asynccontextmanager
    async def gateway(self) -> AsyncIterator[None]:
        self._rig.forget()
        async with self._rig.gateway():
            self._rig.hear_zenoh()
            await self.until("a status", lambda: self._rig.statuses)
            yield

    def emulator(self) -> AbstractAsyncContextManager[None]:
        return self._rig.emulator()

    def unplug(self, device: str) -> None:
        self._cables[device].end.unplug()

    def plug(self, device: str) -> None:
        self._cables[device].end.plug()

    def is_right(self) -> bool:
        return self._rig.is_right(RIGHT_M)

    def is_reckoning(self) -> bool:
        return self._rig.is_now(6, "A", "E")

    def is_silent(self) -> bool:
        return self._rig.is_now(0, "V", "N")


class Memory:
    """Emulator, intakes and estimator in one process, without lines, by the emulator's seconds."""

    def __init__(self, scenario: dict[str, Any]) -> None:
        self._scenario = make(scenario)
        self._trajectory = Trajectory(self._scenario.trajectory, self._scenario.duration_s)
        settings = twin.gateway_config(self._scenario)
        settings |= {"filter": {"max_fix_age_s": MAX_FIX_AGE_S}}
        config = build(Config, settings, [])
        assert config is not None
        self._config = config
        self._plugged = set(config.devices)
        self._now = self._begun = START
        self._emissions: Iterator[Emission] = iter(())
        self._ways_in: dict[str, Intake] = {}
        self._estimator: Estimator | None = None
        self._state: SavedState | None = None
        self._nav: NavSolution | None = None

    @asynccontextmanager
    async def gateway(self) -> AsyncIterator[None]:
        self._ways_in = intakes(self._config)
        self._estimator = Estimator(self._config, 10.0, self._state)
        yield
        self._estimator, self._nav = None, None

    @asynccontextmanager
    async def emulator(self) -> AsyncIterator[None]:
        self._begun = self._now
        self._emissions = emissions(self._scenario, self._trajectory, self._begun, 1.0)
        yield
        self._emissions = iter(())

    def unplug(self, device: str) -> None:
        self._plugged.discard(device)

    def plug(self, device: str) -> None:
        self._plugged.add(device)

    async def until(self, what: str, condition: Callable[[], T], within_s: float = 10.0) -> T:
        end = self._now + within_s
        while not (value := condition()):
            if self._now > end:
                pytest.fail(f"not within {within_s} s: {what}; {self._nav}")
            self._step()
        return value

    def is_right(self) -> bool:
        return self._is_fresh(Mode.AIDED) and self._error_m() < RIGHT_M

    def is_reckoning(self) -> bool:
        return self._is_fresh(Mode.DEAD_RECKONING)

    def is_silent(self) -> bool:
        return self._nav is None or self._now - self._nav.t_ns * 1e-9 > SILENT_S

    def counts(self, device: str) -> dict[str, Any]:
        return asdict(self._ways_in[device].counts)

    def _step(self) -> None:
        """Hand over what is said next; where nobody has power, a moment passes."""
        said = next(self._emissions, None)
        if said is None:
            self._now += 0.1
            return
        self._now = self._begun + said.t
        if not said.data or said.device not in self._plugged or self._estimator is None:
            return
        way_in = self._ways_in[said.device]
        way_in.feed(said.data, round(self._now * 1e9))
        for measurement in way_in.flush():
            for output in self._estimator.feed(measurement):
                if isinstance(output, NavSolution):
                    self._nav = output
                elif isinstance(output, SavedState):
                    self._state = output

    def _is_fresh(self, mode: Mode) -> bool:
        nav = self._nav
        return nav is not None and nav.mode == mode and self._now - nav.t_ns * 1e-9 < FRESH_S

    def _error_m(self) -> float:
        assert self._nav is not None
        nav, t = self._nav, self._nav.t_ns * 1e-9 - self._begun
        truth = self._trajectory.geodetic(np.array([max(t, 0.0)]))
        north = (nav.lat - truth.lat[0]) * 6_370_000.0
        east = (nav.lon - truth.lon[0]) * 6_380_000.0 * math.cos(nav.lat)
        return math.hypot(north, east)
