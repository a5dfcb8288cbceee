"""What an engineer must know of a gateway's status: alarms, the worst first, each with its remedy.

docs/operations.md says of each what it means and what to do.
"""

from collections.abc import Callable, Iterator
from enum import IntEnum

import msgspec

from gateway.health import SILENT_S, DeviceReport, HealthReport
from gateway.modes import Mode

RECENT_S = 60.0
"""Something that happened once is shown for so long."""
REJECTED_SHARE = 0.01
"""More than this of a device's bytes rejected is worth a word."""
SLOW_MS = 20.0
"""From arrival to output, 99 % of the last minute."""
MANY = 200
"""So many must have left in it: of a few the slowest says nothing."""


class Severity(IntEnum):
    """How bad it is."""

    NOTICE = 0
    """To be known."""
    WARNING = 1
    """Navigation goes on, with less than it could have."""
    ALARM = 2
    """The solution is not to be relied on, or will soon not be."""


class Alarm(msgspec.Struct, frozen=True):
    """One thing that is not as it should be; ``name`` is its heading in docs/operations.md."""

    severity: Severity
    name: str
    of: str
    text: str

    def __str__(self) -> str:
        return f"{self.of}: {self.text}" if self.of else self.text


class Alarms:
    """Finds the alarms of successive reports: some are of what changed."""

    def __init__(self) -> None:
        self._before: HealthReport | None = None
        self._events: list[tuple[float, Alarm]] = []

    def take(self, report: HealthReport) -> list[Alarm]:
        """Alarms of the newest report, the worst first."""
        before, self._before = self._before, report
        if before is not None and before.up_s <= report.up_s:
            self._events += [(report.t_s, alarm) for alarm in _changes(before, report)]
        begin_s = report.t_s - RECENT_S
        self._events = [event for event in self._events if event[0] >= begin_s]
        found = list(of_report(report))
        known = {(alarm.name, alarm.of) for alarm in found}
        for _, alarm in reversed(self._events):
            if (alarm.name, alarm.of) not in known:
                known.add((alarm.name, alarm.of))
                found.append(alarm)
        return sorted(found, key=lambda alarm: -alarm.severity)


def of_report(report: HealthReport) -> Iterator[Alarm]:
    """Alarms that one report tells by itself."""
    yield from _of_solution(report)
    for name, device in report.devices.items():
        yield from _of_device(name, device)
    for doubt in report.doubts:
        is_imu = doubt.of in report.devices and report.devices[doubt.of].kind == "imu"
        severity = Severity.ALARM if is_imu else Severity.WARNING
        yield Alarm(severity, "doubtful", doubt.of, doubt.text)
    for output in report.outputs:
        if not output.up:
            yield Alarm(Severity.WARNING, "output down", output.name, output.error or "is down")
    if report.state_file is not None and report.state_file.failed:
        said = f"{report.state_file.failed} writes failed"
        yield Alarm(Severity.WARNING, "state file", report.state_file.file, said)


def _of_solution(report: HealthReport) -> Iterator[Alarm]:
    age_s = report.fix_age_s
    match report.mode:
        case Mode.FAULT:
            yield Alarm(Severity.ALARM, "filter fault", "", "the filter failed and begins again")
        case Mode.INVALID if not report.filter.ready:
            yield Alarm(Severity.ALARM, "no filter", "", "the filter process is not running")
        case Mode.INVALID:
            yield Alarm(Severity.ALARM, "no solution", "", "no solution")
        case Mode.ALIGNING:
            yield Alarm(Severity.WARNING, "aligning", "", "aligning: no claim on the position")
        case Mode.DEAD_RECKONING:
            since = "no fix yet" if age_s is None else f"last fix {age_s:.0f} s ago"
            yield Alarm(Severity.WARNING, "dead reckoning", "", f"dead reckoning, {since}")
        case _:
            pass
    for row in report.latency:
        slow_us = row.recent.p99_us if row.recent.count >= MANY else None
        if row.stage == "total" and slow_us is not None and slow_us > SLOW_MS * 1e3:
            said = f"1 % of solutions leave {slow_us / 1e3:.0f} ms after their data or later"
            yield Alarm(Severity.NOTICE, "slow", row.of, said)


def _of_device(name: str, device: DeviceReport) -> Iterator[Alarm]:
    silence = Severity.ALARM if device.kind == "imu" else Severity.WARNING
    if not device.link.up:
        where = device.link.place or "its line"
        yield Alarm(silence, "line down", name, f"{where} is not open")
    elif device.silent_s is None:
        yield Alarm(silence, "silent", name, "has not spoken yet")
    elif device.silent_s > SILENT_S[device.kind]:
        yield Alarm(silence, "silent", name, f"silent for {device.silent_s:.0f} s")
    if device.rejected_bytes > REJECTED_SHARE * device.bytes:
        share = 100.0 * device.rejected_bytes / device.bytes
        reasons = ", ".join(sorted(device.rejected))
        yield Alarm(Severity.WARNING, "rejected bytes", name, f"{share:.1f} % rejected ({reasons})")


_Count = Callable[[HealthReport], int]

_OF_FILTER: tuple[tuple[_Count, Severity, str, str], ...] = (
    (lambda r: r.filter.restarts, Severity.WARNING, "filter restarted", "filter process restarted"),
    (lambda r: r.filter.dropped, Severity.ALARM, "inputs dropped", "inputs dropped on the way"),
)


def _changes(before: HealthReport, now: HealthReport) -> Iterator[Alarm]:
    """What happened between two reports of one run."""
    for count, severity, name, text in _OF_FILTER:
        if (more := count(now) - count(before)) > 0:
            yield Alarm(severity, name, "", f"{more} {text}" if more > 1 else text)
    for name, device in now.devices.items():
        if (earlier := before.devices.get(name)) is not None:
            yield from _changes_of_device(name, earlier, device)
    outputs = {output.name: output for output in before.outputs}
    for output in now.outputs:
        earlier_output = outputs.get(output.name)
        if earlier_output is not None and output.up and output.dropped > earlier_output.dropped:
            yield Alarm(Severity.NOTICE, "output drops", output.name, "does not keep up")
    yield from _refusals(before, now)


def _changes_of_device(name: str, before: DeviceReport, now: DeviceReport) -> Iterator[Alarm]:
    if (lost := now.missing - before.missing) > 0:
        yield Alarm(Severity.NOTICE, "frames missing", name, f"{lost} frames missing")
    if (lost := now.kernel_dropped - before.kernel_dropped) > 0:
        yield Alarm(Severity.ALARM, "system dropped", name, f"the system dropped {lost} datagrams")
    if now.clock.resets > before.clock.resets:
        yield Alarm(Severity.NOTICE, "clock reset", name, "its clock or counter began anew")


def _refusals(before: HealthReport, now: HealthReport) -> Iterator[Alarm]:
    """Fixes that the gate refused, where none was used meanwhile."""
    if before.totals is None or now.totals is None:
        return
    gated = now.totals.fixes_gated - before.totals.fixes_gated
    if gated > 0 and now.totals.fixes_used == before.totals.fixes_used:
        yield Alarm(Severity.NOTICE, "fixes refused", "", "a fix was refused in the last minute")
