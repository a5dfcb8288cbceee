"""Plays a scenario: in real time onto its ports, or as fast as possible into a capture file."""

import gc
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gateway.emulator.instruments import emissions
from gateway.emulator.ledger import Sent
from gateway.emulator.pcap import PcapWriter
from gateway.emulator.ports import Plug, describe
from gateway.emulator.scenario import AnyPort, Scenario, UdpPort
from gateway.emulator.streams import Emission
from gateway.emulator.trajectory import Trajectory
from gateway.emulator.truth import TruthWriter
from gateway.emulator.twin import for_capture
from gateway.errors import ConfigError, UsblnavError

_LIVE_BLOCK_S = 0.1
"""Short, so that computing a block fits between two frames."""
_CAPTURE_BLOCK_S = 5.0
_LEAD_S = 0.2
_NAP_S = 0.1
"""Longest sleep without a look at ``stop``."""
_SOURCE_PORT = 49152

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Report:
    """What a run did.

    ``start_unix_s``: Unix time of t = 0. ``lateness_ms``: median, 99th percentile and maximum of
    how much later than due frames left (live runs).
    """

    start_unix_s: float
    devices: dict[str, Sent]
    lateness_ms: tuple[float, float, float] | None = None


def emulate(
    scenario: Scenario,
    *,
    speed: float = 1.0,
    pcap: Path | None = None,
    truth: Path | None = None,
    stop: threading.Event | None = None,
    say: Say | None = None,
) -> Report:
    """Play a scenario to its end or until ``stop`` is set.

    Parameters
    ----------
    speed
        Times real time. Stamps and truth keep the scenario's own pace from the start on.
    pcap
        Capture file to write instead of playing live; see `gateway.emulator.twin.for_capture`.
    truth
        CSV file for the true motion; while playing it always reaches beyond the present.
    say
        Takes one line for each port; standard error by default.

    Raises
    ------
    UsblnavError
        If a port or file cannot be opened or written.
    """
    say = say or _to_stderr
    stop = stop or threading.Event()
    run = _Run(scenario, speed, truth, stop, say)
    try:
        return run.live() if pcap is None else run.capture(pcap)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        raise UsblnavError(f"{where}{error.strerror or error}") from error


@dataclass(slots=True)
class _Run:
    scenario: Scenario
    speed: float
    truth: Path | None
    stop: threading.Event
    say: Say
    sent: dict[str, Sent] = field(default_factory=dict)

    def live(self) -> Report:
        """Open every port, then send each frame when its time has come."""
        with ExitStack() as stack:
            lines: dict[AnyPort, Plug] = {}
            ports: dict[str, Plug] = {}
            for name, model in self.scenario.devices.items():
                if model.port not in lines:
                    lines[model.port] = Plug(model.port)
                    stack.callback(lines[model.port].pull)
                ports[name] = lines[model.port]
                self.say(f"{name}: {model.codec} to {ports[name].where}")
            start_unix, start = self._start()
            emissions = self._emissions(self.scenario, start_unix, _LIVE_BLOCK_S, stack)
            lateness = self._play(emissions, ports, start)
        return Report(start_unix, self.sent, lateness)

    def capture(self, path: Path) -> Report:
        """Write every frame with the time it would have left."""
        scenario = for_capture(self.scenario)
        to: dict[str, tuple[str, int]] = {}
        lines: dict[AnyPort, int] = {}
        for name, model in scenario.devices.items():
            assert isinstance(model.port, UdpPort)
            to[name] = _ipv4(name, model.port)
            lines.setdefault(model.port, _SOURCE_PORT + len(lines))
            self.say(f"{name}: {model.codec} to {describe(model.port)} in {path}")
        source = {name: lines[model.port] for name, model in scenario.devices.items()}
        start_unix = time.time() if scenario.start == "now" else float(scenario.start)
        start_ns = round(start_unix * 1e9)
        with ExitStack() as stack:
            writer = stack.enter_context(PcapWriter(path))
            for e in self._emissions(scenario, start_unix, _CAPTURE_BLOCK_S, stack):
                if self.stop.is_set():
                    break
                if e.data:
                    writer.write(
                        start_ns + round(e.t * 1e9), source[e.device], to[e.device], e.data
                    )
                self.sent[e.device].note(e)
        return Report(start_unix, self.sent)

    def _start(self) -> tuple[float, float]:
        """Unix and monotonic time of t = 0."""
        now_unix, now = time.time(), time.monotonic()
        lead = _LEAD_S
        if self.scenario.start != "now":
            lead = self.scenario.start - now_unix
            if lead < 0.0:
                self.say(f"start: {self.scenario.start} is over; begins now")
                lead = _LEAD_S
        self.say(f"start: {now_unix + lead:.3f}")
        return now_unix + lead, now + lead

    def _emissions(
        self, scenario: Scenario, start_unix: float, block_s: float, stack: ExitStack
    ) -> Iterator[Emission]:
        """All devices' bytes in the order of time; the truth file is kept ahead of them."""
        trajectory = Trajectory(scenario.trajectory, scenario.duration_s)
        self.sent.update((name, Sent()) for name in scenario.devices)
        writers = [
            TruthWriter(stack.enter_context(path.open("w", encoding="ascii")), way, start_unix)
            for path, way in self._truths(scenario, trajectory)
        ]
        for writer in writers:
            writer.write_until(0.0)
        for emission in emissions(scenario, trajectory, start_unix, block_s):
            for writer in writers:
                writer.write_until(emission.t)
            yield emission

    def _truths(
        self, scenario: Scenario, trajectory: Trajectory
    ) -> Iterator[tuple[Path, Trajectory]]:
        """The vehicle's file, and beside it one of each beacon that moves."""
        if self.truth is None:
            return
        yield self.truth, trajectory
        for mobile in scenario.mobile.values():
            name = f"{self.truth.stem}-{mobile.name}{self.truth.suffix}"
            way = Trajectory(mobile.trajectory, scenario.duration_s)
            yield self.truth.with_name(name), way

    def _play(
        self, emissions: Iterator[Emission], ports: dict[str, Plug], start: float
    ) -> tuple[float, float, float]:
        late: list[float] = []
        gc.freeze()
        try:
            for e in emissions:
                due = start + e.t / self.speed
                if not _sleep_until(due, self.stop):
                    break
                self._pass_on(e, ports[e.device])
                late.append(time.monotonic() - due)
                self.sent[e.device].note(e)
        finally:
            gc.unfreeze()
        p50, p99, most = np.percentile(late or [0.0], [50, 99, 100]) * 1e3
        return float(p50), float(p99), float(most)

    def _pass_on(self, e: Emission, port: Plug) -> None:
        if e.fate == "unplugged":
            port.pull()
            self.say(f"{e.device}: unplugged")
        elif e.fate == "plugged":
            port.put_in()
            self.say(f"{e.device}: back, to {port.where}")
        elif e.data:
            before = port.dropped_bytes
            port.send(e.data)
            self.sent[e.device].dropped_bytes += port.dropped_bytes - before


def _sleep_until(due: float, stop: threading.Event) -> bool:
    """Sleep to an absolute monotonic time; False when told to stop."""
    # Event.wait would deadlock with a signal handler that sets the event.
    while (left := due - time.monotonic()) > 0.0:
        if stop.is_set():
            return False
        time.sleep(min(left, _NAP_S))
    return not stop.is_set()


def _ipv4(name: str, port: UdpPort) -> tuple[str, int]:
    try:
        socket.inet_aton(port.host)
    except OSError:
        fault = f'devices.{name}.port.host: a capture needs an IPv4 address, got "{port.host}"'
        raise ConfigError(fault) from None
    return port.host, port.port


def _to_stderr(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
