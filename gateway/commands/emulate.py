"""`usblnav emulate`: a scenario as real frames."""

import signal
import threading
from argparse import Namespace
from pathlib import Path
from types import FrameType

import msgspec
import yaml

from gateway.emulator import player, twin
from gateway.emulator.scenario import Scenario
from gateway.errors import ConfigError, UsblnavError


def run(arguments: Namespace) -> int:
    """Play the scenario to its end, or until SIGINT or SIGTERM."""
    path = arguments.config or twin.DEMO
    scenario = twin.load(path)
    if arguments.duration is not None:
        scenario = msgspec.structs.replace(scenario, duration_s=arguments.duration)
    if arguments.pcap is not None and arguments.speed != 1.0:
        raise ConfigError("--speed: a capture is written as fast as the machine can")
    if arguments.gateway_config is not None:
        _write_config(scenario, arguments.gateway_config, arguments.pcap is not None)
    stop = threading.Event()

    def end(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    report = player.emulate(
        scenario,
        speed=arguments.speed,
        pcap=arguments.pcap,
        truth=arguments.truth,
        stop=stop,
    )
    if arguments.json:
        print(msgspec.json.encode(report).decode())
    else:
        print(*_lines(report), sep="\n")
    return 0


def _write_config(scenario: Scenario, path: Path, of_capture: bool) -> None:
    config = twin.gateway_config(twin.for_capture(scenario) if of_capture else scenario)
    try:
        path.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise UsblnavError(f"{path}: cannot write: {error.strerror}") from error


def _lines(report: player.Report) -> list[str]:
    lines = []
    for name, sent in report.devices.items():
        said = [
            f"{count} {what}"
            for count, what in (
                (sent.damaged, "frames damaged"),
                (sent.dropped, "frames lost on the way"),
                (sent.repeated, "frames repeated"),
                (sent.junk_bytes, "bytes of junk"),
                (sent.dropped_bytes, "bytes taken by nobody"),
                (sent.unsayable, "that the format cannot say"),
            )
            if count
        ]
        lines.append(", ".join([f"{name}: {sent.frames} frames", f"{sent.bytes} bytes", *said]))
    if report.lateness_ms is not None:
        p50, p99, most = report.lateness_ms
        lines.append(f"frames late by {p50:.2f} ms (median), {p99:.2f} (99 %), {most:.2f} (worst)")
    return lines
