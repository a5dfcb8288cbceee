"""`initial.align`: what it lets go, what it asks for, and what it refuses."""

from pathlib import Path
from typing import Any

import pytest

from gateway.config import load
from tests.gateway.configurations import GONE, edited, faults_of, written

GNSS = {
    "kind": "gnss",
    "codec": "nmea-gnss",
    "link": {"type": "udp", "port": 7003},
    "noise": {"position_m": [2, 2, 4], "velocity_m_s": 0.1},
}
GYRO = "devices.imu0.noise.gyro_bias_deg_h"


@pytest.mark.parametrize("heading", ["gyrocompass", "unknown"])
def test_an_attitude_that_is_found_need_not_be_given(tmp_path: Path, heading: str) -> None:
    path = written(
        tmp_path,
        edited(
            ("initial.attitude_deg", GONE),
            ("initial.sigma.attitude_deg", GONE),
            ("initial.align", {"heading": heading}),
        ),
    )
    first = load(path).initial
    assert first.attitude_deg is None and first.sigma.attitude_deg is None
    assert first.align is not None
    assert (first.align.heading, first.align.level_s, first.align.gyrocompass_s) == (
        heading,
        30,
        300,
    )


def test_a_course_needs_a_receiver_and_no_attitude(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        edited(
            ("initial.attitude_deg", GONE),
            ("initial.sigma.attitude_deg", GONE),
            ("initial.align", {"heading": "gnss_course"}),
            ("devices.gnss0", GNSS),
        ),
    )
    config = load(path)
    assert list(config.gnss) == ["gnss0"]
    assert config.initial.align is not None and config.initial.align.crab_deg == 5.0


def test_of_two_receivers_one_is_too_many(tmp_path: Path) -> None:
    other = GNSS | {"link": {"type": "udp", "port": 7004}}
    path = written(tmp_path, edited(("devices.gnss0", GNSS), ("devices.gnss1", other)))
    assert faults_of(path) == [
        "devices: gnss0, gnss1 are all of kind gnss; only one is available yet"
    ]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            {"codec": "kvh1750"},
            "devices.gnss0.codec: kvh1750 is of kind imu, the device of kind gnss;"
            " one of: nmea-bus, nmea-gnss",
        ),
        (
            {"options": {"checksum": "none"}},
            "devices.gnss0.options.checksum: expected one of forbidden, optional, required,"
            ' got "none"',
        ),
        (
            {"noise": {"position_m": [1, 1, 0], "velocity_m_s": 0.1}},
            "devices.gnss0.noise.position_m[2]: expected a number > 0, got 0",
        ),
    ],
)
def test_faults_of_a_receiver(tmp_path: Path, change: dict[str, Any], expected: str) -> None:
    assert faults_of(written(tmp_path, edited(("devices.gnss0", GNSS | change)))) == [expected]


def test_without_align_there_is_none(tmp_path: Path) -> None:
    assert load(written(tmp_path, edited())).initial.align is None


@pytest.mark.parametrize(
    ("edits", "expected"),
    [
        (
            [("initial.attitude_deg", GONE), ("initial.sigma.attitude_deg", GONE)],
            [
                "initial.attitude_deg: missing; or let align find it",
                "initial.sigma.attitude_deg: missing",
            ],
        ),
        (
            [("initial.attitude_deg", GONE), ("initial.align", {"heading": "config"})],
            ["initial.attitude_deg: missing; or let align find it"],
        ),
        (
            [("initial.align", {"heading": "gnss_course"})],
            ["initial.align.heading: gnss_course needs a device of kind gnss"],
        ),
        (
            [("initial.align", {"headign": "unknown"})],
            ["initial.align.headign: unknown key; did you mean heading?"],
        ),
        (
            [("initial.align", {"level_s": 1})],
            ["initial.align.level_s: expected a number from 5 to 600, got 1"],
        ),
        (
            [("initial.align", {"heading": "gyrocompass"}), (GYRO, 6)],
            [
                "initial.align.heading: gyrocompass needs better gyros than devices.imu0"
                " (noise.gyro_bias_deg_h: 6): where the Earth turns at 12 deg/h about north"
                " the heading would be worse than 10 deg"
            ],
        ),
    ],
)
def test_faults(tmp_path: Path, edits: list[tuple[str, Any]], expected: list[str]) -> None:
    assert faults_of(written(tmp_path, edited(*edits))) == expected


def test_gyros_that_will_do_at_the_equator_will_not_near_a_pole(tmp_path: Path) -> None:
    compass = ("initial.align", {"heading": "gyrocompass"})
    load(written(tmp_path, edited(compass, (GYRO, 2), ("initial.lat_deg", 0))))
    [fault] = faults_of(written(tmp_path, edited(compass, (GYRO, 2), ("initial.lat_deg", -80))))
    assert "2.6 deg/h about north" in fault
