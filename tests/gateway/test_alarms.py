"""Alarms: what is said of a report, and of what changed between two."""

from typing import Any

import msgspec
import pytest

from gateway.health import SILENT_S, HealthReport
from gateway.latency import Spread, StageReport
from gateway.modes import Mode
from gateway.monitor.alarms import RECENT_S, Alarm, Alarms, Severity, of_report
from tests.gateway.reports import REPORT, device, later

replace = msgspec.structs.replace


def names(alarms: list[Alarm]) -> list[str]:
    return [alarm.name for alarm in alarms]


def found(**changes: Any) -> list[Alarm]:
    return list(of_report(replace(REPORT, **changes)))


def test_a_gateway_that_fares_well_raises_none() -> None:
    assert Alarms().take(REPORT) == []


@pytest.mark.parametrize(
    ("mode", "name", "severity"),
    [
        (Mode.FAULT, "filter fault", Severity.ALARM),
        (Mode.INVALID, "no solution", Severity.ALARM),
        (Mode.ALIGNING, "aligning", Severity.WARNING),
        (Mode.DEAD_RECKONING, "dead reckoning", Severity.WARNING),
    ],
)
def test_a_mode_that_is_not_aided_is_said(mode: Mode, name: str, severity: Severity) -> None:
    (alarm,) = found(mode=mode, fix_age_s=75.0)
    assert (alarm.name, alarm.severity) == (name, severity)


def test_a_filter_that_is_not_there_is_why_there_is_no_solution() -> None:
    assert names(found(mode=Mode.INVALID, filter=replace(REPORT.filter, ready=False))) == [
        "no filter"
    ]


@pytest.mark.parametrize(
    ("kind", "severity"), [("imu", Severity.ALARM), ("usbl", Severity.WARNING)]
)
def test_a_silent_device(kind: Any, severity: Severity) -> None:
    silent = device(kind=kind, silent_s=SILENT_S[kind] + 0.5)
    (alarm,) = found(devices={"it": silent})
    assert (alarm.name, alarm.of, alarm.severity) == ("silent", "it", severity)
    assert found(devices={"it": device(kind=kind, silent_s=SILENT_S[kind] - 0.5)}) == []
    (alarm,) = found(devices={"it": device(kind=kind, silent_s=None)})
    assert str(alarm) == "it: has not spoken yet"


def test_a_line_that_is_down_is_said_and_not_that_it_is_silent() -> None:
    down = device(silent_s=90.0, link=replace(device().link, up=False, place="serial /dev/x"))
    (alarm,) = found(devices={"it": down})
    assert str(alarm) == "it: serial /dev/x is not open"


def test_many_rejected_bytes_are_said_with_their_reasons() -> None:
    bad = device(bytes=1000, rejected_bytes=200, rejected={"checksum": 9, "length": 1})
    (alarm,) = found(devices={"it": bad})
    assert str(alarm) == "it: 20.0 % rejected (checksum, length)"


def test_an_output_that_is_down_and_a_state_file_that_cannot_be_written() -> None:
    down = replace(REPORT.outputs[0], up=False, error="nobody answers")
    state = replace(REPORT.state_file, failed=3)
    said = found(outputs=[down], state_file=state)
    assert names(said) == ["output down", "state file"]
    assert str(said[0]) == "zenoh peer: nobody answers"


def test_slowness_is_of_many_solutions() -> None:
    def row(count: int) -> list[StageReport]:
        spread = Spread(count, 900.0, 31_000.0, 40_000.0, 50_000.0)
        return [StageReport("total", "zenoh peer", spread, spread)]

    assert names(found(latency=row(1000))) == ["slow"]
    assert found(latency=row(20)) == []


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"filter": {"restarts": 1}}, "filter restarted"),
        ({"filter": {"dropped": 40}}, "inputs dropped"),
        ({"devices": {"missing": 7}}, "frames missing"),
        ({"devices": {"kernel_dropped": 7}}, "system dropped"),
        ({"outputs": {"dropped": 7}}, "output drops"),
        ({"totals": {"fixes_gated": 7}}, "fixes refused"),
    ],
)
def test_what_happened_is_said_for_a_minute(changes: dict[str, Any], name: str) -> None:
    alarms = Alarms()
    assert alarms.take(REPORT) == []
    happened = later(REPORT, 1.0, changes)
    assert names(alarms.take(happened)) == [name]
    assert names(alarms.take(later(happened, RECENT_S - 2.0))) == [name]
    assert alarms.take(later(happened, RECENT_S + 2.0)) == []


def test_a_gateway_that_was_started_again_has_lost_nothing() -> None:
    alarms = Alarms()
    alarms.take(later(REPORT, 1000.0, {"filter": {"restarts": 3}}))
    assert alarms.take(later(REPORT, 1001.0, {"filter": {"restarts": 5}}, up_s=1.0)) == []


def test_the_worst_is_first() -> None:
    report: HealthReport = replace(
        later(REPORT, 1.0, {"totals": {"fixes_gated": 3}}), mode=Mode.FAULT
    )
    alarms = Alarms()
    alarms.take(REPORT)
    assert names(alarms.take(report)) == ["filter fault", "fixes refused"]
