"""The demo's viewer: hears the gateway over Zenoh and NMEA, and compares it with the truth."""

import asyncio
import math
import socket
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import msgspec

from gateway.demo.stage import Stage
from gateway.emulator.truth import TruthFile
from gateway.errors import UsblnavError
from gateway.nav.attitude import turn
from gateway.nav.earth import north_east
from gateway.outputs.schema import NavReport
from gateway.outputs.zenoh import at, open_subscription

SCORED_S = 30.0
"""The summary's errors are over this last part of the demo."""
FIRST_S = 20.0
"""How long the first solution may take."""


@dataclass(frozen=True)
class Sample:
    """One solution beside the truth of the same moment."""

    nav: NavReport
    north_m: float
    east_m: float
    heading_deg: float

    @property
    def horizontal_m(self) -> float:
        """Length of the horizontal error."""
        return math.hypot(self.north_m, self.east_m)


class Viewer:
    """What another program sees of the gateway."""

    def __init__(self, stage: Stage) -> None:
        self.samples: deque[Sample] = deque()
        self.solutions = 0
        self.sentences = 0
        self.last_sentence = ""
        self._stage = stage
        self._truth = TruthFile(stage.truth)
        self._first = asyncio.Event()

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Hear Zenoh and NMEA while the body runs."""
        loop = asyncio.get_running_loop()

        def on_sample(_key: str, payload: bytes) -> None:
            loop.call_soon_threadsafe(self._on_nav, payload)

        key = f"usblnav/{self._stage.vehicle}/nav"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nmea:
            nmea.bind(("127.0.0.1", self._stage.nmea_port))
            nmea.setblocking(False)
            loop.add_reader(nmea, self._on_nmea, nmea)
            try:
                with open_subscription(at(self._stage.endpoint), key, on_sample):
                    yield
            finally:
                loop.remove_reader(nmea)

    async def first(self) -> None:
        """Wait for the first solution.

        Raises
        ------
        UsblnavError
            If none comes.
        """
        try:
            await asyncio.wait_for(self._first.wait(), FIRST_S)
        except TimeoutError:
            raise UsblnavError(f"no solution on Zenoh within {FIRST_S:.0f} s") from None

    def scored(self) -> list[Sample]:
        """The samples of the last part of the demo."""
        if not self.samples:
            return []
        begin = self.samples[-1].nav.t_s - SCORED_S
        return [sample for sample in self.samples if sample.nav.t_s >= begin]

    def _on_nav(self, payload: bytes) -> None:
        nav = msgspec.json.decode(payload, type=NavReport)
        self.solutions += 1
        self._first.set()
        truth = self._truth.at(nav.t_s)
        if truth is None:
            return
        places = nav.lat_deg, nav.lon_deg, truth.lat_deg, truth.lon_deg
        north, east = map(float, north_east(*map(math.radians, places)))
        self.samples.append(
            Sample(
                nav,
                north,
                east,
                turn(nav.heading_deg - truth.heading_deg, 360.0),
            )
        )
        while self.samples[0].nav.t_s < nav.t_s - 2.0 * SCORED_S:
            self.samples.popleft()

    def _on_nmea(self, nmea: socket.socket) -> None:
        for line in nmea.recv(65536).decode("ascii").splitlines():
            self.sentences += 1
            if "RMC" in line:
                self.last_sentence = line


def rms(values: list[float]) -> float:
    """Root mean square; NaN of nothing."""
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan
