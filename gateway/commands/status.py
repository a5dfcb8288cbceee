"""`usblnav status`: what a running gateway says of itself, asked over Zenoh."""

from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence

import msgspec

from gateway.clock import ClockReport
from gateway.commands.asking import whom
from gateway.errors import UsblnavError
from gateway.health import DeviceReport, HealthReport
from gateway.latency import StageReport
from gateway.outputs.sinks import SinkStatus
from gateway.outputs.zenoh import ask

DEVICE = ("device", "codec", "silent s", "bytes", "records", "rejected", "gaps", "lost")
LINK = ("line of", "place", "up", "opened", "chunks", "bytes", "records", "junk bytes")
CLOCK = ("time of", "by its", "state", "drift ppm", "sigma ms", "jitter ms", "resets", "untimed")
OUTPUT = ("output", "up", "sent", "dropped", "clients", "stalled", "cut off", "error")
STAGE = ("last minute, ms", "of", "count", "50 %", "99 %", "99.9 %", "max", "max ever")


def run(arguments: Namespace) -> int:
    """Print the status of every vehicle that answers."""
    place, vehicle = whom(arguments)
    endpoint = place.connect[0]
    answers = ask(place, f"usblnav/{vehicle}/status")
    if not answers:
        raise UsblnavError(f"zenoh {endpoint}: no gateway answers usblnav/{vehicle}/status")
    for payload in answers.values():
        if arguments.json:
            print(payload.decode())
        else:
            for line in lines(_report(payload, endpoint)):
                print(line)
    return 0


def lines(report: HealthReport) -> Iterator[str]:
    """The status as a person reads it."""
    host = report.filter
    age = "no fix yet" if report.fix_age_s is None else f"last fix {report.fix_age_s:.1f} s ago"
    yield f"{report.vehicle}: {report.mode.value}, {age}; up {report.up_s:.0f} s"
    state = f"process {host.pid}, {'ready' if host.ready else 'not ready'}"
    yield f"filter: {state}, {host.restarts} restarts, {host.waiting} waiting, {host.dropped} lost"
    granted = report.realtime
    priority = f"SCHED_FIFO {granted.priority}" if granted.priority else "ordinary"
    memory = "locked" if granted.memory_locked else "not locked"
    wake = "" if granted.wake_us is None else f", cores awake in {granted.wake_us} us"
    yield f"scheduling: {priority}, memory {memory}{wake}"
    if report.totals is not None:
        fixes = report.totals
        yield (
            f"fixes: {fixes.fixes_used} used, {fixes.fixes_gated} refused, {fixes.fixes_late} late,"
            f" {fixes.fixes_too_late} too late, {fixes.fixes_duplicate} duplicate"
        )
    yield ""
    yield from _table(DEVICE, (_device(name, d) for name, d in report.devices.items()))
    yield ""
    yield from _table(LINK, (row for name, d in report.devices.items() for row in _link(name, d)))
    yield ""
    yield from _table(CLOCK, (_clock(name, d.clock) for name, d in report.devices.items()))
    yield ""
    yield from _table(OUTPUT, map(_output, report.outputs))
    yield ""
    yield from _table(STAGE, map(_stage, report.latency))
    yield ""


def _report(payload: bytes, endpoint: str) -> HealthReport:
    try:
        return msgspec.json.decode(payload, type=HealthReport)
    except msgspec.DecodeError as error:
        why = f"its status is of another version ({error}); --json shows it"
        raise UsblnavError(f"zenoh {endpoint}: {why}") from error


def _device(name: str, device: DeviceReport) -> list[str]:
    silent = "-" if device.silent_s is None else f"{device.silent_s:.1f}"
    rejected = sum(device.rejected.values()) + sum(device.ignored.values())
    counts = (device.bytes, device.records, rejected, device.gaps, device.kernel_dropped)
    return [name, device.codec, silent, *map(str, counts)]


def _link(name: str, device: DeviceReport) -> Iterator[list[str]]:
    """The line of a device; below it those who speak on it, where they are several."""
    if device.line != name:
        yield [name, f"with {device.line}", *["-"] * (len(LINK) - 2)]
        return
    link = device.link
    counts = (link.opened, link.chunks, link.bytes, device.records, device.rejected_bytes)
    yield [name, link.place or "-", "yes" if link.up else "no", *map(str, counts)]
    if len(link.senders) > 1:
        for who, sender in link.senders.items():
            told = (sender.bytes, sender.records, sender.rejected_bytes)
            yield ["", f"  {who}", "", "", "", *map(str, told)]


def _clock(name: str, clock: ClockReport) -> list[str]:
    numbers = (clock.drift_ppm, clock.sigma_ms, clock.jitter_ms)
    shown = ["-" if number is None else f"{number:.3f}" for number in numbers]
    return [name, clock.source, clock.state or "-", *shown, str(clock.resets), str(clock.untimed)]


def _output(output: SinkStatus) -> list[str]:
    readers = (output.clients, output.clients_stalled, output.clients_cut_off)
    counts = ["-" if n is None else str(n) for n in (output.sent, output.dropped, *readers)]
    return [output.name, "yes" if output.up else "no", *counts, output.error or "-"]


def _stage(row: StageReport) -> list[str]:
    recent = row.recent
    times = (recent.p50_us, recent.p99_us, recent.p99_9_us, recent.max_us, row.since_start.max_us)
    shown = ["-" if us is None else f"{us / 1e3:.3f}" for us in times]
    return [row.stage, row.of, str(recent.count), *shown]


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Columns as wide as they must be; numbers to the right."""
    table = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        cells = [
            f"{cell:>{width}}" if k > 1 else f"{cell:{width}}"
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield "  ".join(cells).rstrip()
