"""The monitor's screen: what it says, that it fits, and where the picture puts things."""

import io
from typing import Any

import msgspec
import pytest
from rich.console import Console

from gateway.modes import Mode
from gateway.monitor.heard import SILENT_S, Heard
from gateway.monitor.picture import draw
from gateway.monitor.screen import SMALLEST, screen
from tests.gateway.reports import INNOVATION, NAV, REPORT, TARGET, device, later

replace = msgspec.structs.replace


class Time:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def heard(*messages: tuple[str, Any], time: Time | None = None) -> Heard:
    found = Heard("auv1", time or Time())
    for topic, message in messages:
        found.take(topic, msgspec.json.encode(message))
    return found


def shown(found: Heard, width: int, height: int, beside: tuple[str, ...] = ()) -> list[str]:
    console = Console(width=width, height=height, file=io.StringIO(), highlight=False)
    console.print(screen(found, width, height, beside))
    assert isinstance(console.file, io.StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


def test_it_says_what_was_heard() -> None:
    records = {"devices": {"records": 20_200}}
    found = heard(
        ("nav", NAV),
        ("innovation", INNOVATION),
        ("status", REPORT),
        ("status", later(REPORT, 1.0, records)),
    )
    lines = shown(found, *SMALLEST)
    assert lines[0] == "auv1   AIDED   2026-11-22 12:20:00 UTC   up 1 min 41 s"
    assert lines[1].split(maxsplit=1)[1] == "33°30.0000'S  71°15.0000'W  height -123.45 m"
    text = "\n".join(lines)
    assert "0.42 x 0.28 m along 30 deg, down 0.20 m" in text
    assert "1.41 m/s, course 315.0" in text
    assert "imu0    kvh1750           200.0" in text
    assert "usbl0 1  used  NIS 5.2  elevation +2.0σ  bearing -1.0σ  range +0.5σ" in text


def test_it_fits_the_smallest_terminal_however_much_there_is() -> None:
    devices = {f"device{k}": device() for k in range(30)}
    full = replace(REPORT, devices=devices, outputs=REPORT.outputs * 3, mode=Mode.DEAD_RECKONING)
    many = [("innovation", INNOVATION)] * 30
    found = heard(("nav", NAV), *many, ("status", full))
    lines = shown(found, *SMALLEST, ("auv2", "auv3"))
    assert len(lines) <= SMALLEST[1]
    assert max(map(len, lines)) <= SMALLEST[0]
    assert "also auv2, auv3" in lines[0]
    assert any(line.startswith("and 2") and line.endswith("more") for line in lines)
    assert "dead reckoning, last fix 1 s ago" in lines


@pytest.mark.parametrize("size", [(80, 24), (100, 30), (112, 24), (200, 60)])
def test_every_size_is_kept(size: tuple[int, int]) -> None:
    found = heard(("nav", NAV), ("innovation", INNOVATION), ("status", REPORT))
    lines = shown(found, *size)
    assert len(lines) <= size[1]
    assert max(map(len, lines)) <= size[0]


def target(**changes: Any) -> tuple[str, Any]:
    found = replace(TARGET, **changes)
    return f"target/{found.name}", found


def test_each_target_has_a_line() -> None:
    away = {"range_m": 123.45, "bearing_deg": 7.25, "height_m": NAV.height_m - 80.0}
    lost = target(name="sledge", number=1, state="lost", age_s=44.0)
    found = heard(target(**away), ("nav", NAV), lost, target(**away, age_s=2.0))
    lines = [line.split() for line in shown(found, *SMALLEST)]
    at = next(k for k, line in enumerate(lines) if line[:1] == ["target"])
    assert lines[at + 1][:2] == ["sledge", "lost"]
    assert lines[at + 2] == ["rov", "tracked", "123.5", "007.2", "80.0", "2.0", "2"]
    assert found.unread == 0


def test_many_targets_leave_room_for_the_rest() -> None:
    many = [target(name=f"rov{k}", number=k) for k in range(9)]
    full = replace(REPORT, devices={f"device{k}": device() for k in range(9)})
    found = heard(("nav", NAV), *many, *[("innovation", INNOVATION)] * 9, ("status", full))
    lines = shown(found, *SMALLEST)
    assert len(lines) <= SMALLEST[1]
    assert max(map(len, lines)) <= SMALLEST[0]
    assert "and 6 more" in lines
    assert any(line.startswith("output") for line in lines)


def test_a_solution_that_is_over_does_not_stand_there_as_valid() -> None:
    over = later(REPORT, 20.0, mode=Mode.INVALID)
    head = shown(heard(("nav", NAV), ("status", over)), 80, 24)[0]
    assert head.startswith("auv1   INVALID   last solution   2026-")


def test_a_gateway_that_falls_silent_is_said_first() -> None:
    time = Time()
    found = heard(("nav", NAV), ("status", REPORT), time=time)
    assert not found.alarms()
    time.now += SILENT_S + 4.0
    assert [alarm.name for alarm in found.alarms()] == ["gateway silent"]
    assert "nothing heard for 7 s" in shown(found, *SMALLEST)


def test_a_message_of_another_version_is_counted() -> None:
    found = Heard("auv1", Time())
    found.take("status", b'{"vehicle": 3}')
    found.take("nav", b"not even JSON")
    assert found.unread == 2
    assert [alarm.name for alarm in found.alarms()] == ["other version"]


def test_the_picture_has_north_up_and_the_vehicle_where_it_is() -> None:
    way = [replace(NAV, t_s=NAV.t_s + k, lat_deg=-33.5 + 1e-5 * k) for k in range(60)]
    *rows, scale = draw(way, 30, 16)
    (mark,) = [k for k, row in enumerate(rows) if "+" in row]
    begun = max(k for k, row in enumerate(rows) if row.strip(chr(0x2800)))
    assert mark < 3
    assert begun == 14
    assert scale.endswith("m, north up")
    east = [replace(NAV, lon_deg=-71.25 + 1e-5 * k) for k in range(60)]
    (row,) = [row for row in draw(east, 30, 16) if "+" in row]
    assert row.index("+") > 25


def test_targets_stand_in_the_picture_where_they_are_seen() -> None:
    north = replace(TARGET, name="rov", bearing_deg=0.0, range_m=100.0)
    east = replace(TARGET, name="sledge", bearing_deg=90.0, range_m=100.0)
    gone = replace(TARGET, name="buoy", bearing_deg=180.0, range_m=900.0, state="lost")
    *rows, _ = draw([NAV], 30, 16, [north, east, gone])
    at = {
        mark: (k, row.index(mark)) for k, row in enumerate(rows) for mark in "+rsb" if mark in row
    }
    assert set(at) == {"+", "r", "s"}
    assert at["r"][1] == at["+"][1]
    assert at["s"][0] == at["+"][0]
    assert at["r"][0] < at["+"][0]
    assert at["s"][1] > at["+"][1]


def test_rates_are_those_of_the_last_ten_seconds() -> None:
    found, now = heard(("status", REPORT)), REPORT
    assert found.records_hz("imu0") is None
    rates = []
    for k in range(30):  # one every other second, then none
        records = now.devices["imu0"].records + (k % 2 if k < 15 else 0)
        now = later(now, 1.0, {"devices": {"records": records}})
        found.take("status", msgspec.json.encode(now))
        rates.append(found.records_hz("imu0"))
    assert rates[10:15] == pytest.approx([0.5] * 5)
    assert rates[24:] == [0.0] * 6
    found.take("status", msgspec.json.encode(replace(now, up_s=1.0)))
    assert found.records_hz("imu0") is None


def test_one_place_alone_can_be_drawn() -> None:
    nowhere = replace(NAV, ellipse_major_m=float("nan"), ellipse_minor_m=float("nan"))
    assert len(draw([nowhere], 20, 10)) == 10
