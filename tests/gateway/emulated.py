"""Scenarios for the emulator's tests, made from the packaged one."""

import copy
from functools import cache
from typing import Any

import yaml

from gateway.emulator import twin
from gateway.emulator.scenario import Scenario
from gateway.schema import build

START = 1_780_000_000.0


def demo_data() -> dict[str, Any]:
    """The packaged scenario as plain data, starting at a fixed time."""
    return copy.deepcopy(_packaged()) | {"start": START}


@cache
def _packaged() -> dict[str, Any]:
    data: dict[str, Any] = yaml.safe_load(twin.DEMO.read_text())
    return data


def make(data: dict[str, Any]) -> Scenario:
    """Build a scenario that must be sound."""
    faults: list[str] = []
    scenario = build(Scenario, data, faults)
    assert scenario is not None, faults
    return scenario


def quiet_usbl(**changes: Any) -> dict[str, Any]:
    """The demo's array without constant errors, outliers and (next to) noise."""
    noise = {"bearing_deg": 1e-12, "elevation_deg": 1e-12, "range_m": 1e-12}
    block = demo_data()["devices"]["usbl0"] | {"noise": noise, "prior": {}, "outliers": {}}
    return block | changes


SWAY = {
    "roll": [{"amplitude": 5.0, "period_s": 6.0}, {"amplitude": 1.0, "period_s": 2.3}],
    "pitch": [{"amplitude": 4.0, "period_s": 6.0, "phase_deg": 90}],
    "yaw": [{"amplitude": 1.0, "period_s": 11.0}],
    "heave": [{"amplitude": 0.5, "period_s": 8.0}],
}
TRACKS: dict[str, dict[str, Any]] = {
    "circle": {"type": "circle", "radius_m": 71.4, "start_bearing_deg": 90, "turn": "port"},
    "line": {"type": "line", "course_deg": 200.0, "ramp_s": 20.0},
    "lawnmower": {"type": "lawnmower", "course_deg": 30.0, "leg_m": 40.0, "spacing_m": 30.0},
    "legs": {
        "type": "legs",
        "course_deg": 45.0,
        "leg_m": 30.0,
        "turn_m": 20.0,
        "turns_deg": [90.0, -60.0],
    },
}
PATHS: dict[str, dict[str, Any]] = TRACKS | {
    "spiral": {
        "type": "spiral",
        "radius_m": 15.0,
        "pitch_m": 10.0,
        "to_height_m": -35.0,
        "pitches": True,
    },
    "transit": {
        "type": "transit",
        "course_deg": 120.0,
        "distance_m": 130.0,
        "ramp_s": 12.0,
        "cruise_height_m": -30.0,
        "dive_m": 50.0,
        "pitches": True,
    },
    "waypoints": {
        "type": "waypoints",
        "from_rest": True,
        "turn_m": 15.0,
        "points": [
            {"lat_deg": -33.0, "lon_deg": -72.0, "height_m": -20.0, "speed_m_s": 3.0},
            {"lat_deg": -32.9995, "lon_deg": -72.0, "height_m": -30.0, "speed_m_s": 2.0},
            {"lat_deg": -32.9993, "lon_deg": -71.9995, "height_m": -25.0, "speed_m_s": 4.0},
            {"lat_deg": -32.9998, "lon_deg": -71.9991, "height_m": -25.0, "speed_m_s": 0.0},
        ],
    },
}
_OWN_PLACE = ("waypoints",)


def track(kind: str, **changes: Any) -> dict[str, Any]:
    """A scenario's trajectory block, swaying."""
    common = {"lat_deg": -33.0, "lon_deg": -72.0, "height_m": -20.0, "speed_m_s": 3.0}
    if kind in _OWN_PLACE:
        common = {}
    return common | {"sway": SWAY} | PATHS[kind] | changes
