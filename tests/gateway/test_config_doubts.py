"""Slips of the pen that are possible values: named, not refused."""

from typing import Any

import pytest

from gateway.config import Config, doubts
from gateway.schema import build
from tests.gateway.configurations import edited


def doubted(*edits: tuple[str, Any]) -> list[str]:
    """What is doubted of the good configuration, changed."""
    faults: list[str] = []
    config = build(Config, edited(*edits), faults)
    assert config is not None, faults
    return list(doubts(config))


@pytest.mark.parametrize(
    ("path", "value", "doubt"),
    [
        ("devices.usbl0.lever_arm_m", [500, 0, 800], ": 943 m from the IMU; it is in metres"),
        (
            "devices.usbl0.clock",
            {"latency_ms": 0.5},
            ".latency_ms: 0.5 ms is sooner than a reply's pulse has passed; it is in milliseconds",
        ),
        (
            "beacons.1.turnaround_ms",
            0.05,
            ": 0.05 ms is very prompt; it is in milliseconds",
        ),
        (
            "devices.usbl0.prior",
            {"range_scale": 0.2},
            ".range_scale: 0.2 is 20 % of the sound speed; 0.002 is 3 m/s",
        ),
        (
            "devices.imu0.noise.gyro_bias_deg_h",
            9000,
            ": 9000 is of no IMU; they have 1e-05 to 2000",
        ),
        (
            "devices.imu0.noise.accel_bias_ug",
            0.001,
            ": 0.001 is of no IMU; they have 0.1 to 100000",
        ),
        (
            "beacons.1.height_m",
            50,
            ": 50 m above where the vehicle begins; heights under water are negative",
        ),
    ],
)
def test_a_slip_is_named_with_its_path(path: str, value: Any, doubt: str) -> None:
    assert doubted((path, value)) == [path + doubt]


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "way"),
    [(39.8, -116.2, 9691), (-39.8, 116.2, 8851), (-39.8, -63.8, 20015)],
)
def test_a_beacon_on_the_other_side_of_the_earth(
    lat_deg: float, lon_deg: float, way: float
) -> None:
    said = doubted(("beacons.1.lat_deg", lat_deg), ("beacons.1.lon_deg", lon_deg))
    assert said == [
        f"beacons.1: {way} km from initial; exchanged latitude and longitude, or a wrong sign?"
    ]


@pytest.mark.parametrize(
    "edit",
    [
        ("devices.usbl0.lever_arm_m", [60, -8, 9]),
        ("devices.usbl0.clock", {"latency_ms": 0.5, "source": "device"}),
        ("devices.imu0.noise.gyro_bias_deg_h", 0),
        ("beacons.1.lon_deg", 115.3),
        ("beacons.1.height_m", 10),
    ],
)
def test_what_may_well_be_meant_is_not_doubted(edit: tuple[str, Any]) -> None:
    assert doubted(edit) == []


@pytest.mark.parametrize("error", ["additive", "left_invariant"])
def test_one_beacon_tells_no_heading(error: str) -> None:
    poor = ("initial.sigma.attitude_deg", [0.5, 0.5, 2.0])
    choice = ("filter", {"error": error})
    assert doubted(poor, choice) == [
        f"filter.error: {error} claims a heading that one beacon does not tell;"
        " right_invariant does not"
    ]
    known = ("initial.sigma.attitude_deg", [0.5, 0.5, 0.2])
    assert doubted(poor) == doubted(known, choice) == []
    second = {"lat_deg": 39.8, "lon_deg": 116.201, "height_m": -60.0}
    assert doubted(poor, choice, ("beacons.2", second)) == []


def test_round_the_date_line_it_is_not_far() -> None:
    near = (("initial.lon_deg", 179.999), ("beacons.1.lon_deg", -179.999))
    assert doubted(*near) == []


def test_an_array_that_looks_up_may_have_its_beacon_above() -> None:
    assert doubted(("beacons.1.height_m", 50), ("devices.usbl0.looks", "up")) == []
