"""GNSS at the surface, from sentences to solutions: the heading by the course, and the fixes."""

import itertools
import math
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest
from scipy.stats import chi2

from drivers import registry
from drivers.records import GnssRecord
from gateway.config import Config
from gateway.ingest import Intake
from gateway.messages import ImuBlock, Innovation, Measurement
from gateway.modes import Mode
from gateway.nav import earth
from tests.gateway.test_estimator_start import (
    MOORED,
    MOWING,
    aligning,
    heading_error_deg,
    joined,
    run,
    said,
    scenario,
    seconds,
    solutions,
)
from tests.gateway.voyages import T0_NS, Voyage, configuration

MAST = (1.0, -0.5, -8.0)
SD_POSITION, SD_VELOCITY = 1.0, 0.05
GNSS = {
    "kind": "gnss",
    "codec": "nmea-gnss",
    "link": {"type": "udp", "port": 7003},
    "clock": {"latency_ms": 120},
    "lever_arm_m": list(MAST),
    "noise": {"position_m": [SD_POSITION] * 3, "velocity_m_s": SD_VELOCITY},
}
CODEC = registry.lookup("nmea-gnss")


def surfaced(voyage: Voyage, level_s: float = 15.0, crab_deg: float = 1.0) -> Config:
    """IMU and receiver alone; the direction in which the vehicle moves is not known."""
    first = aligning(voyage, heading="gnss_course", level_s=level_s, crab_deg=crab_deg).initial
    speed = max(0.3, voyage.scenario.trajectory.speed_m_s)
    block = {
        "lat_deg": first.lat_deg,
        "lon_deg": first.lon_deg,
        "height_m": first.height_m,
        "align": {"heading": "gnss_course", "level_s": level_s, "crab_deg": crab_deg},
        "sigma": {"position_m": [5, 5, 5], "velocity_m_s": speed},
    }
    whole = configuration(voyage.scenario)
    imu = {"imu0": _plain(whole.devices["imu0"])}
    return configuration(voyage.scenario, devices=imu | {"gnss0": GNSS}, beacons={}, initial=block)


def _plain(device) -> dict:
    return msgspec.to_builtins(device)


def sentences(voyage: Voyage, seed: int) -> Iterator[tuple[float, bytes]]:
    """Second of each epoch, and the GGA and RMC of a receiver with white noise."""
    rng = np.random.default_rng(seed)
    for t in np.arange(0.5, voyage.scenario.duration_s, 1.0):
        lat, lon, h = earth.ecef_to_lla(_antenna(voyage, t) + SD_POSITION * rng.normal(size=3))
        v_e = (_antenna(voyage, t + 1e-3) - _antenna(voyage, t - 1e-3)) / 2e-3
        v_n = earth.C_en(lat, lon).T @ v_e + SD_VELOCITY * rng.normal(size=3)
        common = {"t_rx_ns": 0, "valid": True, "t_device_s": 43200.0 + float(t)}
        common |= {"lat_deg": math.degrees(lat), "lon_deg": math.degrees(lon)}
        place = GnssRecord(
            sentence="GGA", height_m=float(h), geoid_m=-9.5, quality=1, satellites=9, **common
        )
        course_deg = math.degrees(math.atan2(v_n[1], v_n[0])) % 360.0
        way = GnssRecord(
            sentence="RMC",
            speed_m_s=float(np.hypot(v_n[0], v_n[1])),
            course_deg=course_deg,
            mode="A",
            **common,
        )
        yield float(t), b"".join(CODEC.encode(r, CODEC.options()) for r in (place, way))


def _antenna(voyage: Voyage, t: float) -> np.ndarray:
    pose = voyage.truth.pose(np.array([t]))
    return pose.r_e[0] + pose.C_eb[0] @ np.array(MAST)


def arrivals(voyage: Voyage, config: Config, seed: int = 0) -> Iterator[Measurement]:
    """Samples, and what the receiver's intake makes of its bytes 120 ms after their epoch."""
    intake, waiting = Intake({"gnss0": config.devices["gnss0"]}), list(sentences(voyage, seed))
    for samples in voyage.arrivals(1e9, 0.02):
        yield samples
        assert isinstance(samples, ImuBlock)
        now_ns = int(np.frombuffer(samples.t_ns, dtype=np.int64)[-1])
        while waiting and T0_NS + round(waiting[0][0] * 1e9) + 120_000_000 <= now_ns:
            t, data = waiting.pop(0)
            intake.feed(data, T0_NS + round(t * 1e9) + 120_000_000)
            yield from intake.flush()
    assert not intake.counts.rejected and not intake.counts.ignored


def voyage_on(course_deg: float, seed: int, duration_s: float, track=MOWING) -> Voyage:
    return Voyage(scenario(track | {"course_deg": course_deg}, seed, duration_s))


def verdicts(outputs) -> list[Innovation]:
    """On the windows of the start."""
    return [o for o in outputs if isinstance(o, Innovation) and o.device == "imu0"]


@pytest.mark.parametrize("course_deg", [10.0, 140.0, 265.0])
def test_the_heading_is_found_and_kept(course_deg):
    voyage = voyage_on(course_deg, 3, 40.0)
    config = surfaced(voyage)
    outputs, estimator = run(config, list(arrivals(voyage, config)))
    [verdict] = verdicts(outputs)
    assert (verdict.accepted, verdict.reason) == (True, "")
    found = next(s for s in solutions(outputs) if seconds(s) > 16.0)
    sd_deg = math.degrees(found.sd_attitude[2])
    assert abs(heading_error_deg(voyage, found)) < 3.0 * sd_deg < 5.0
    last = solutions(outputs)[-1]
    assert last.mode is Mode.AIDED
    truth = voyage.truth.geodetic(np.array([seconds(last)]))
    error = earth.lla_to_ecef(last.lat, last.lon, last.h) - earth.lla_to_ecef(
        truth.lat[0], truth.lon[0], truth.h[0]
    )
    assert np.linalg.norm(error) < 3.0
    counts = estimator.counts()
    assert counts.fixes_used >= 78  # of 40 epochs
    assert counts.fixes_too_late == counts.fixes_duplicate == 0


def test_the_sigma_of_the_course_is_honest():
    """Normalised squares over eight courses, against the heading at the window's beginning."""
    squares = []
    for seed in range(8):
        voyage = voyage_on(45.0 * seed, 20 + seed, 17.0)
        config = surfaced(voyage, crab_deg=0.5)
        [verdict] = verdicts(run(config, list(arrivals(voyage, config, seed)))[0])
        heading = next(c for c in verdict.components if c.name == "heading_deg")
        true = math.degrees(voyage.truth.geodetic(np.zeros(1)).heading[0])
        error = (heading.value - true + 180.0) % 360.0 - 180.0
        assert heading.sigma < 4.0
        squares.append((error / heading.sigma) ** 2)
    assert sum(squares) < chi2.ppf(0.99, len(squares))


def test_a_mast_that_swings_is_taken_into_account():
    """8 m above the IMU the antenna moves with the roll; as if it did not, the fixes disagree."""
    voyage = voyage_on(75.0, 5, 40.0)
    config = surfaced(voyage)
    measurements = list(arrivals(voyage, config))
    short = configuration(
        voyage.scenario,
        devices={"imu0": _plain(config.devices["imu0"]), "gnss0": GNSS | {"lever_arm_m": [0] * 3}},
        beacons={},
        initial=_plain(config.initial),
    )
    assert mean_nis(run(config, measurements)[0]) < 2.0 < mean_nis(run(short, measurements)[0])


def mean_nis(outputs) -> float:
    """Mean square a row of the receiver's fixes."""
    fixes = [o for o in outputs if isinstance(o, Innovation) and o.device == "gnss0"]
    return sum(o.nis for o in fixes) / sum(len(o.components) for o in fixes)


def test_a_moored_vehicle_has_no_course():
    voyage = voyage_on(75.0, 6, 20.0, MOORED)
    config = surfaced(voyage, level_s=8.0)
    outputs, _ = run(config, list(arrivals(voyage, config)))
    assert [v.reason for v in verdicts(outputs)] == ["too_slow", "too_slow"]
    assert {s.mode for s in solutions(outputs)} == {Mode.ALIGNING}


def test_a_receiver_that_is_silent_gives_no_course():
    voyage = voyage_on(75.0, 6, 10.0)
    config = surfaced(voyage, level_s=8.0)
    outputs, _ = run(config, list(itertools.islice(voyage.arrivals(1e9, 0.02), 480)))
    assert [v.reason for v in verdicts(outputs)] == ["no_course"]


def test_what_comes_out_does_not_depend_on_batches():
    voyage = voyage_on(200.0, 7, 20.0)
    config = surfaced(voyage, level_s=8.0)
    fine = list(arrivals(voyage, config))
    whole = said(run(config, fine, 3.0)[0])
    for block_s in (0.1, 1.7):
        assert said(run(config, list(joined(fine, block_s)), 3.0)[0]) == whole
