"""What is said of the host's clock: that it was set, that it was never set."""

import logging

import pytest

from gateway.health.doubts import Doubt
from gateway.health.hostclock import HostClock

S = 1_000_000_000
NOVEMBER_2026 = 1_795_377_600 * S


@pytest.fixture
def clock(caplog: pytest.LogCaptureFixture) -> HostClock:
    caplog.set_level(logging.INFO)
    return HostClock()


def said(caplog: pytest.LogCaptureFixture) -> list[str]:
    words = [record.getMessage() for record in caplog.records]
    caplog.clear()
    return words


def test_what_ntp_does_bit_by_bit_is_not_said(
    clock: HostClock, caplog: pytest.LogCaptureFixture
) -> None:
    for n in range(100):
        clock.sampled(n * S, NOVEMBER_2026 + n * 500_000)
    assert said(caplog) == []
    assert clock.doubts == []


def test_every_step_is_said(clock: HostClock, caplog: pytest.LogCaptureFixture) -> None:
    for n, ahead_s in enumerate((0, 0, -3600, -3600, 3, 3)):
        clock.sampled(n * S, NOVEMBER_2026 + ahead_s * S)
    assert said(caplog) == [
        "host: its clock was set back by 1:00:00",
        "host: its clock was set forward by 1:00:03",
    ]
    clock.sampled(10 * S, NOVEMBER_2026 + S // 2)
    assert said(caplog) == ["host: its clock was set back by 2.5 s"]


def test_a_host_that_slept_says_so(clock: HostClock, caplog: pytest.LogCaptureFixture) -> None:
    for n, asleep_s in enumerate((500, 500, 4100, 4100)):
        clock.sampled((n + asleep_s) * S, NOVEMBER_2026, asleep_s * S)
    assert said(caplog) == ["host: it slept for 1:00:00"]


def test_one_that_was_never_set_is_doubted_until_it_is(
    clock: HostClock, caplog: pytest.LogCaptureFixture
) -> None:
    text = "its clock says 1970-01-01: not set yet, and what is sent carries it"
    for n in range(3):
        clock.sampled((100 + n) * S, -40 * S)
        assert clock.doubts == [Doubt("host", text)]
    assert said(caplog) == [f"host: {text}"]
    clock.sampled(104 * S, NOVEMBER_2026)
    assert clock.doubts == []
    assert said(caplog) == ["host: its clock was set forward by 20779 days, 20:00:40"]
