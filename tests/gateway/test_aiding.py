"""Depth, Doppler log, compass and long baseline, from their bytes to what the filter knows."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.stats import chi2

from drivers.records import DepthRecord, DvlRecord, HeadingRecord, LblRecord, LblReply, Record
from gateway.config import Config, wire_format
from gateway.emulator import twin
from gateway.estimator import Estimator
from gateway.ingest import intakes
from gateway.messages import FilterOutput, ImuBlock, Innovation, Measurement, NavSolution
from gateway.modes import Mode
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler
from tests.gateway.emulated import demo_data, make, track
from tests.gateway.voyages import T0_NS, Voyage, configuration

DURATION_S = 40.0
LATENCY_NS = 150_000_000
"""From the moment a measurement is true to the first byte, where the bytes do not tell."""
LEVER = np.array([1.5, -0.5, 0.75])
MOUNTING = np.array([1.0, -2.0, 45.0])
C_BS = C_from_euler(*np.radians(MOUNTING))
SURFACE_M = -9.5
SOUND_M_S = 1480.0
CORNERS = {
    name: {
        "lat_deg": -33.0 + north,
        "lon_deg": -72.0 + east,
        "height_m": -90.0,
        "turnaround_ms": ms,
    }
    for name, north, east, ms in (
        ("A", 3e-3, 1e-3, 0.0),
        ("B", -2e-3, 3e-3, 50.0),
        ("C", -3e-3, -2e-3, 120.0),
        ("D", 1e-3, -3e-3, 20.0),
    )
}


Spoken = tuple[float, Record]
"""When the first byte leaves the device (s), and what it says."""


@pytest.fixture(scope="module")
def voyage() -> Voyage:
    """A swaying line at 3 m/s with the demo's IMU."""
    data = demo_data() | {"trajectory": track("line"), "duration_s": DURATION_S}
    data["devices"]["imu0"]["rate_hz"] = 100.0
    return Voyage(make(data))


def place(voyage: Voyage, t: float, lever: np.ndarray = LEVER) -> np.ndarray:
    pose = voyage.truth.pose(np.array([t]))
    return pose.r_e[0] + pose.C_eb[0] @ lever


def C_eb(voyage: Voyage, t: float) -> np.ndarray:
    return voyage.truth.pose(np.array([t])).C_eb[0]


@dataclass(frozen=True)
class Case:
    """A device's block, what it says, and the error that must then be small, by how much."""

    block: dict[str, Any]
    says: Callable[[Voyage, np.random.Generator], Iterator[Spoken]]
    better: tuple[str, float]


def depths(voyage: Voyage, rng: np.random.Generator) -> Iterator[Spoken]:
    for t in np.arange(0.25, DURATION_S, 0.25):
        h = float(earth.ecef_to_lla(place(voyage, t))[2])
        depth_m = SURFACE_M - h + 0.1 * rng.normal()
        yield t + LATENCY_NS * 1e-9, DepthRecord(t_rx_ns=0, depth_m=depth_m)


def tracks(voyage: Voyage, rng: np.random.Generator) -> Iterator[Spoken]:
    """Bottom velocities: 0.2 s from ping to speech, told by the log as the age of what it says."""
    eps = 1e-3
    for t in np.arange(0.2, DURATION_S - 0.1, 0.2):
        v_e = (place(voyage, t + eps) - place(voyage, t - eps)) / (2.0 * eps)
        v_s = C_BS.T @ C_eb(voyage, t).T @ v_e + np.array([0.02, 0.02, 0.01]) * rng.normal(size=3)
        yield (
            t + 0.2,
            DvlRecord(
                t_rx_ns=0,
                velocity_m_s=tuple(v_s.tolist()),
                age_s=0.2,
                t_device_s=1.7e9 + t,
                altitude_m=35.0,
                sd_m_s=(0.005, 0.005, 0.005),
            ),
        )


def headings(voyage: Voyage, rng: np.random.Generator) -> Iterator[Spoken]:
    for t in np.arange(0.2, DURATION_S, 0.2):
        lat, lon, _ = earth.ecef_to_lla(place(voyage, t))
        north, east, _ = earth.C_en(lat, lon).T @ C_eb(voyage, t) @ C_BS[:, 0]
        heading_deg = (np.degrees(np.arctan2(east, north)) + 0.3 * rng.normal()) % 360.0
        yield t + LATENCY_NS * 1e-9, HeadingRecord(t_rx_ns=0, heading_deg=float(heading_deg))


def replies(voyage: Voyage, rng: np.random.Generator, silent: str = "") -> Iterator[Spoken]:
    """A ping each 3 s; a transponder that does not answer makes the modem wait for 3 s."""
    for n, t in enumerate(np.arange(0.5, DURATION_S - 4.0, 3.0)):
        heard, last = [], 0.0
        for name, corner in CORNERS.items():
            there = earth.lla_to_ecef(
                np.radians(corner["lat_deg"]), np.radians(corner["lon_deg"]), corner["height_m"]
            )
            down_s = np.linalg.norm(place(voyage, t) - there) / SOUND_M_S
            turn_s, wait_s = corner["turnaround_ms"] * 1e-3, 0.0
            for _ in range(4):
                way_s = np.linalg.norm(place(voyage, t + wait_s) - there) / SOUND_M_S
                wait_s = down_s + turn_s + way_s
            one_way_s = 0.5 * (wait_s - turn_s) + 0.3 / SOUND_M_S * rng.normal()
            if not (name == silent and n % 2):
                heard.append(LblReply(beacon=name, one_way_s=float(one_way_s)))
                last = max(last, wait_s)
        spoken = t + LATENCY_NS * 1e-9 + (last if len(heard) == len(CORNERS) else 3.0)
        yield spoken, LblRecord(t_rx_ns=0, replies=tuple(heard), t_ping_s=43_200.0 + t)


def with_a_silent_one(voyage: Voyage, rng: np.random.Generator) -> Iterator[Spoken]:
    return replies(voyage, rng, silent="C")


WHERE = {"lever_arm_m": LEVER.tolist(), "clock": {"latency_ms": LATENCY_NS * 1e-6}}
DEPTH = WHERE | {"kind": "depth", "noise": {"depth_m": 0.1}, "surface_height_m": SURFACE_M}
DVL = WHERE | {"kind": "dvl", "noise": {"velocity_m_s": [0.02, 0.02, 0.01]}, "clock": {}}
DVL |= {"mounting_deg": MOUNTING.tolist()}
HEADING = {"kind": "heading", "noise": {"heading_deg": 0.3}, "mounting_deg": MOUNTING.tolist()}
HEADING |= {"clock": WHERE["clock"]}
LBL = WHERE | {"kind": "lbl", "codec": "micromodem", "noise": {"range_m": 0.3}}
OWN_CLOCK = LBL | {"clock": {"source": "device", "latency_ms": LATENCY_NS * 1e-6}}
ON_DEPTH = {"measures": "depth"}
FATHOMS = {"unit": "bar", "latitude_deg": -33.0}

CASES = {
    "nmea-depth": Case(DEPTH | {"options": ON_DEPTH}, depths, ("height", 0.1)),
    "paroscientific": Case(DEPTH | {"options": FATHOMS}, depths, ("height", 0.1)),
    "pd0": Case(DVL, tracks, ("velocity", 0.12)),
    "nortek-dvl": Case(DVL, tracks, ("velocity", 0.12)),
    "waterlinked-dvl": Case(DVL, tracks, ("velocity", 0.12)),
    "pd6": Case(DVL | {"clock": {"latency_ms": 200.0}}, tracks, ("velocity", 0.12)),
    "nmea-heading": Case(HEADING, headings, ("heading", 0.4)),
    "micromodem": Case(LBL, replies, ("position", 2.0)),
    "micromodem by its clock": Case(OWN_CLOCK, with_a_silent_one, ("position", 2.0)),
}


def set_out(voyage: Voyage, case: Case | None, codec: str = "") -> Config:
    """IMU and one device; the first position, velocity, height and heading are wrong."""
    first = voyage.truth.geodetic(np.zeros(1))
    heading_deg = float(np.degrees(first.heading[0]))
    devices = {"imu0": twin.gateway_config(voyage.scenario)["devices"]["imu0"]}
    if case is not None:
        devices["aid0"] = {"codec": codec, "link": {"type": "udp", "port": 7005}} | case.block
    initial = {
        "lat_deg": float(np.degrees(first.lat[0])) + 1e-4,
        "lon_deg": float(np.degrees(first.lon[0])) - 1e-4,
        "height_m": float(first.h[0]) + 3.0,
        "velocity_ned_m_s": (first.v_eb_n[0] + [0.3, -0.3, 0.1]).tolist(),
        "attitude_deg": [*np.degrees([first.roll[0], first.pitch[0]]), heading_deg + 4.0],
        "sigma": {"position_m": [12, 12, 3], "velocity_m_s": 0.3, "attitude_deg": [0.1, 0.1, 4.0]},
    }
    return configuration(
        voyage.scenario,
        devices=devices,
        beacons=CORNERS,
        initial=initial,
        sound_speed_m_s=SOUND_M_S,
    )


def arrivals(voyage: Voyage, config: Config, case: Case) -> Iterator[Measurement]:
    """Samples, and what the device's intake makes of its bytes when they come."""
    device = config.devices["aid0"]
    codec, options = wire_format(device)
    waiting = sorted(case.says(voyage, np.random.default_rng(1)), key=itemgetter(0))
    intake = intakes(config)["aid0"]
    for samples in voyage.arrivals(1e9, 0.02):
        yield samples
        now_ns = int(np.frombuffer(samples.t_ns, dtype=np.int64)[-1])
        while waiting and T0_NS + round(waiting[0][0] * 1e9) <= now_ns:
            spoken, record = waiting.pop(0)
            intake.feed(codec.encode(record, options), T0_NS + round(spoken * 1e9))
            yield from intake.flush()
    assert not intake.counts.rejected and not intake.counts.ignored
    assert intake.counts.records > 10


def errors(voyage: Voyage, last: NavSolution) -> dict[str, float]:
    """Of the last solution against the truth: m, m/s, degrees."""
    truth = voyage.truth.geodetic(np.array([(last.t_ns - T0_NS) * 1e-9]))
    true_e = earth.lla_to_ecef(truth.lat[0], truth.lon[0], truth.h[0])
    turned = np.degrees(last.heading - truth.heading[0])
    return {
        "height": abs(last.h - truth.h[0]),
        "position": float(np.linalg.norm(earth.lla_to_ecef(last.lat, last.lon, last.h) - true_e)),
        "velocity": float(np.linalg.norm(np.array(last.v_eb_n) - truth.v_eb_n[0])),
        "heading": abs((turned + 180.0) % 360.0 - 180.0),
    }


def fed(config: Config, measurements: Iterable[Measurement]) -> list[FilterOutput]:
    estimator = Estimator(config, 1.0)
    return [output for measurement in measurements for output in estimator.feed(measurement)]


def last_solution(outputs: list[FilterOutput]) -> NavSolution:
    return [output for output in outputs if isinstance(output, NavSolution)][-1]


@pytest.fixture(scope="module")
def unaided(voyage: Voyage) -> dict[str, float]:
    outputs = fed(set_out(voyage, None), voyage.arrivals(1e9))
    return errors(voyage, last_solution(outputs))


@pytest.mark.parametrize("name", CASES)
def test_what_it_says_is_what_the_filter_learns(
    voyage: Voyage, unaided: dict[str, float], name: str
) -> None:
    case = CASES[name]
    config = set_out(voyage, case, name.split()[0])
    outputs = fed(config, arrivals(voyage, config, case))
    component, within = case.better
    assert errors(voyage, last_solution(outputs))[component] < within < unaided[component] / 4
    verdicts = [v for v in outputs if isinstance(v, Innovation) and v.device == "aid0"]
    assert {v.reason for v in verdicts} <= {"", "gate"}
    assert sum(v.accepted for v in verdicts) > 0.98 * len(verdicts)
    settled = [v for v in verdicts if v.t_ns > T0_NS + 10e9]
    rows = sum(len(v.components) for v in settled)
    assert chi2.ppf(1e-4, rows) < sum(v.nis for v in settled) < chi2.ppf(1 - 1e-4, rows)


def modes_of(outputs: list[FilterOutput]) -> list[Mode]:
    """The modes that were, in their order."""
    return list(dict.fromkeys(o.mode for o in outputs if isinstance(o, NavSolution)))


def test_a_log_alone_reckons_from_the_initial_place(voyage: Voyage) -> None:
    case = CASES["pd6"]
    config = set_out(voyage, case, "pd6")
    outputs = fed(config, arrivals(voyage, config, case))
    assert modes_of(outputs) == [Mode.ALIGNING, Mode.DEAD_RECKONING]
    assert last_solution(outputs).fix_age_s is None


def test_nothing_is_reckoned_on_an_unknown_heading(voyage: Voyage) -> None:
    case = CASES["pd6"]
    config = set_out(voyage, case, "pd6")
    sigma = msgspec.structs.replace(config.initial.sigma, attitude_deg=(0.1, 0.1, 40.0))
    initial = msgspec.structs.replace(config.initial, sigma=sigma)
    config = msgspec.structs.replace(config, initial=initial)
    early = (m for m in arrivals(voyage, config, case) if _t_ns(m) < T0_NS + 5e9)
    assert modes_of(fed(config, early)) == [Mode.ALIGNING]


def _t_ns(measurement: Measurement) -> int:
    return measurement.t_last_ns if isinstance(measurement, ImuBlock) else measurement.t_ns
