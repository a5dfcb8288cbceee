"""What the gateway says of itself as time goes by, and when the watchdog may be fed."""

from collections.abc import Callable
from typing import get_args

import pytest

from gateway.commands.status import lines
from gateway.config import Config, DeviceKind
from gateway.emulator import twin
from gateway.filter_process.host import FilterHost, most_at_first
from gateway.health import SILENT_S, Health, Line
from gateway.health.lines import FIRST_S
from gateway.health.report import LinkReport, SenderReport
from gateway.health.watch import FLOWING_S, LOSS_OVER_S
from gateway.ingest import intakes
from gateway.messages import Stationary
from gateway.modes import Mode
from gateway.outputs.schema import NavReport, nav_report
from gateway.schema import build
from tests.gateway.emulated import demo_data, make
from tests.gateway.test_outputs_schema import solution


class Setting:
    """A gateway's health beside a clock that the test moves."""

    def __init__(self) -> None:
        config = build(Config, twin.gateway_config(make(demo_data())), [])
        assert config is not None
        self.now = 1000.0
        ways_in = intakes(config)
        self.imu = Line(ways_in["imu0"])
        self.usbl = Line(ways_in["usbl0"])
        self.config, self.host = config, FilterHost(config, 10.0, print)
        self.health = Health("ship", [self.imu, self.usbl], self.host, [], clock=lambda: self.now)

    def later(self, seconds: float) -> None:
        """Let time pass, with a look at it every tenth of a second."""
        end = self.now + seconds
        while self.now < end - 1e-6:
            self.now = min(end, self.now + 0.1)
            self.health.watch()


def nav(mode: Mode) -> NavReport:
    return nav_report(solution(mode=mode), 0)


@pytest.fixture
def setting() -> Setting:
    return Setting()


def test_silence_of_an_open_line_is_said_once_and_its_end_too(
    setting: Setting, said: Callable[[], list[str]]
) -> None:
    setting.imu.opened(setting.now, "udp 127.0.0.1:7001")
    setting.imu.heard(setting.now)
    setting.later(SILENT_S["imu"])
    assert said() == []
    setting.later(30.0)
    assert said() == ["imu0: silent for 1 s"]
    setting.imu.heard(setting.now)
    setting.later(0.5)
    assert said() == ["imu0: speaks"]


def test_a_gateway_that_stood_still_does_not_blame_the_instruments(
    setting: Setting, said: Callable[[], list[str]]
) -> None:
    setting.imu.opened(setting.now, "udp 127.0.0.1:7001")
    setting.later(1.0)
    setting.imu.heard(setting.now)
    setting.now += 12.0  # SIGSTOP, or the machine slept
    setting.health.watch()
    assert said() == ["the gateway stood still for 12.0 s: stopped, or starved"]
    setting.imu.heard(setting.now)
    setting.later(0.9)
    assert said() == []


def test_every_kind_of_device_has_its_patience() -> None:
    assert set(SILENT_S) == set(get_args(DeviceKind))


@pytest.mark.parametrize("kind", ["imu", "usbl"])
def test_a_device_may_take_its_time_for_the_first_word(
    setting: Setting, said: Callable[[], list[str]], kind: str
) -> None:
    line = setting.imu if kind == "imu" else setting.usbl
    line.opened(setting.now, "udp 127.0.0.1:7001")
    patience = max(FIRST_S, SILENT_S[kind])
    setting.later(patience)
    assert said() == []
    setting.later(1.0)
    assert said() == [f"{line.name}: silent for {patience:.0f} s"]


def test_of_a_lost_line_only_the_loss_is_said(
    setting: Setting, said: Callable[[], list[str]]
) -> None:
    setting.imu.opened(setting.now, "udp 127.0.0.1:7001")
    setting.imu.heard(setting.now)
    setting.imu.lost()
    setting.later(100.0)
    assert said() == []
    assert setting.health.report().devices["imu0"].silent_s == 100.0
    setting.imu.opened(setting.now, "udp 127.0.0.1:7001")
    setting.later(SILENT_S["imu"] + 0.2)
    assert said() == ["imu0: silent for 1 s"]


def test_a_change_of_mode_is_said_and_the_end_of_solutions(
    setting: Setting, said: Callable[[], list[str]]
) -> None:
    health = setting.health
    assert health.report().mode == Mode.INVALID
    health.solved(nav(Mode.ALIGNING))
    health.solved(nav(Mode.AIDED))
    setting.later(FLOWING_S)
    health.solved(nav(Mode.AIDED))
    assert said() == ["navigation: aligning (was invalid)", "navigation: aided (was aligning)"]
    setting.later(FLOWING_S)
    assert health.report().mode == Mode.AIDED
    setting.later(60.0)
    assert health.report().mode == Mode.INVALID
    assert health.report().fix_age_s is None
    health.solved(nav(Mode.DEAD_RECKONING))
    assert said() == [
        "navigation: no solution for 3 s",
        "navigation: dead_reckoning (was invalid)",
    ]


def test_the_watchdog_starves_when_inertial_data_lead_to_no_solution(setting: Setting) -> None:
    health, imu = setting.health, setting.imu
    assert health.is_flowing()
    for _ in range(40):
        imu.heard(setting.now)
        health.solved(nav(Mode.AIDED))
        setting.later(0.1)
        assert health.is_flowing()
    for _ in range(40):
        imu.heard(setting.now)
        setting.later(0.1)
    assert not health.is_flowing()
    health.solved(nav(Mode.AIDED))
    assert health.is_flowing()


def test_a_pulled_cable_does_not_starve_the_watchdog(setting: Setting) -> None:
    setting.later(1000.0)
    assert setting.health.is_flowing()  # nothing was ever heard
    setting.imu.heard(setting.now)
    setting.health.solved(nav(Mode.AIDED))
    setting.usbl.heard(setting.now)
    setting.later(FLOWING_S + 0.2)
    assert setting.health.is_flowing()


def test_the_report_has_what_became_of_the_bytes(setting: Setting) -> None:
    setting.imu.intake.feed(b"junk", 0)
    setting.imu.intake.close()
    setting.imu.link.refused = 3
    report = setting.health.report()
    assert report.vehicle == "ship"
    device = report.devices["imu0"]
    assert (device.kind, device.codec, device.bytes) == ("imu", "kvh1750", 4)
    assert (device.rejected_bytes, device.refused_datagrams) == (4, 3)
    assert device.silent_s is None
    assert report.filter.restarts == 0
    assert setting.health.line() == "invalid; no solution yet"


def test_the_report_tells_of_the_line_and_of_those_who_speak_on_it(setting: Setting) -> None:
    imu = setting.imu
    assert setting.health.report().devices["imu0"].link == LinkReport(None, False, 0, 0, 0, {})
    for _ in range(2):
        imu.opened(setting.now, "udp 127.0.0.1:7001")
        imu.lost()
    imu.opened(setting.now, "udp 127.0.0.1:7001")
    imu.link.bytes, imu.link.chunks = 7, 2
    imu.intake.feed(b"junk", 0, "10.0.0.7:4001")
    imu.intake.feed(b"bad", 0, "10.0.0.8:4001")
    imu.intake.close()
    report = setting.health.report()
    senders = {"10.0.0.7:4001": SenderReport(4, 0, 4), "10.0.0.8:4001": SenderReport(3, 0, 3)}
    told = LinkReport("udp 127.0.0.1:7001", True, 3, 7, 2, senders)
    assert report.devices["imu0"].link == told
    shown = [line.split() for line in lines(report)]
    at = shown.index(["imu0", "udp", "127.0.0.1:7001", "yes", "3", "2", "7", "0", "7"])
    assert shown[at + 1 : at + 3] == [
        ["10.0.0.7:4001", "4", "0", "4"],
        ["10.0.0.8:4001", "3", "0", "3"],
    ]
    assert ["usbl0", "-", "no", "0", "0", "0", "0", "0"] in shown


def test_a_queue_that_overflows_is_said_once_and_its_end_too(
    setting: Setting, said: Callable[[], list[str]]
) -> None:
    for _ in range(3):
        setting.imu.link.kernel_dropped += 5
        setting.later(LOSS_OVER_S / 2)
    for n in range(most_at_first(setting.config) + 7):  # there is no worker to take them
        setting.host.send(Stationary(n, "imu0", 0.01))
    setting.later(0.2)
    assert said() == [
        "imu0: the system's buffer is full, data is dropped and counted",
        "filter: the queue is full, data is dropped and counted",
    ]
    setting.later(2 * LOSS_OVER_S)
    assert said() == [
        "imu0: the system's buffer is no longer full; lost: 15",
        "filter: the queue is no longer full; lost: 7",
    ]
    setting.imu.link.kernel_dropped += 1
    setting.later(2 * LOSS_OVER_S)
    assert said() == [
        "imu0: the system's buffer is full, data is dropped and counted",
        "imu0: the system's buffer is no longer full; lost: 1",
    ]


def test_the_report_has_the_latencies_of_all_stages(setting: Setting) -> None:
    passage = setting.health.passage
    passage.decoded("imu0", 1_000, 51_000)
    passage.handed_on("imu0", 51_000, 60_000)
    passage.entered(900, 1_000, 60_000)
    passage.solved(900, 360_000)
    passage.published("udp", 400_000)
    rows = {row.stage: (row.of, row.recent.max_us) for row in setting.health.report().latency}
    assert rows == {
        "decode": ("imu0", 50.0),
        "hand on": ("imu0", 9.0),
        "filter": ("filter", 300.0),
        "publish": ("udp", 40.0),
        "total": ("udp", 399.0),
    }
