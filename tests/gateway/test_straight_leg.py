"""What delay costs on a straight leg: 3 m/s, a beacon 1 km away, sentences half a second late."""

from functools import cache

import msgspec
import numpy as np
import pytest

from gateway.estimator import Estimator
from gateway.messages import NavSolution, UsblFix
from gateway.nav import earth
from tests.gateway.emulated import demo_data, make, quiet_usbl, track
from tests.gateway.voyages import T0_NS, Voyage, configuration

SPEED, DISTANCE, LATENCY_S = 3.0, 1000.0, 0.5
SECONDS = 120.0
SETTLED_S = 60.0
SOUND = 1500.0
ALONG = SPEED * (DISTANCE / SOUND + LATENCY_S)
"""Error of a run towards the beacon: the range is old by half the way of the sound, too (m)."""
ACROSS = SPEED * LATENCY_S
"""Error of a run past it (m)."""


@cache
def leg(bearing_deg):
    """A leg to the east, halfway 1 km from a beacon at a bearing."""
    data = demo_data() | {"duration_s": SECONDS, "seed": 8, "sound_speed_m_s": SOUND}
    data["trajectory"] = track("line", course_deg=90.0, speed_m_s=SPEED, ramp_s=0.1, sway={})
    data["devices"]["imu0"]["rate_hz"] = 50.0
    noise = {"bearing_deg": 0.03, "elevation_deg": 0.03, "range_m": 0.1}
    data["devices"]["usbl0"] = quiet_usbl(noise=noise)
    lat, lon = np.radians([data["trajectory"]["lat_deg"], data["trajectory"]["lon_deg"]])
    sigma = {"position_m": [5, 5, 1], "velocity_m_s": 0.1, "attitude_deg": [0.01] * 3}
    data["initial"] = {"sigma": sigma}
    R_M, R_N = earth.radii(lat)
    north, east = (
        DISTANCE * np.cos(np.radians(bearing_deg)),
        DISTANCE * np.sin(np.radians(bearing_deg)),
    )
    at = {
        "lat_deg": float(np.degrees(lat + north / R_M)),
        "lon_deg": float(np.degrees(lon + (east + SPEED * SECONDS / 2) / (R_N * np.cos(lat)))),
        "height_m": -60.0,
    }
    return Voyage(make(data | {"beacons": {"1": at}}))


def errors(bearing_deg, latency_s, ignored=False):
    """(n, 2) north and east (m) once settled; with all delay ignored, what comes is of now."""
    trip = leg(bearing_deg)
    config = configuration(trip.scenario, filter={"innovation_gate": 1.0 - 1e-12})
    if ignored:
        beacons = {
            n: msgspec.structs.replace(b, travel="one_way") for n, b in config.beacons.items()
        }
        config = msgspec.structs.replace(config, beacons=beacons)
    estimator, found = Estimator(config, 2.0), []
    for m in trip.arrivals(latency_s):
        if ignored and isinstance(m, UsblFix):
            m = msgspec.structs.replace(m, t_ns=m.t_ns + round(latency_s * 1e9))
        for nav in estimator.feed(m):
            if isinstance(nav, NavSolution) and (nav.t_ns - T0_NS) * 1e-9 > SETTLED_S:
                truth = trip.truth.geodetic(np.array([(nav.t_ns - T0_NS) * 1e-9]))
                R_M, R_N = earth.radii(nav.lat)
                north = (nav.lat - truth.lat[0]) * R_M
                found.append((north, (nav.lon - truth.lon[0]) * R_N * np.cos(nav.lat)))
    assert estimator.counts().fixes_used > 50
    return np.array(found)


def rms(found):
    return float(np.sqrt(np.mean(np.sum(found**2, axis=1))))


@pytest.mark.parametrize(("bearing_deg", "ignoring_m"), [(90.0, ALONG), (0.0, ACROSS)])
def test_delay_costs_nothing_unless_it_is_ignored(bearing_deg, ignoring_m):
    in_order = rms(errors(bearing_deg, 0.0))
    assert in_order < 0.5
    assert rms(errors(bearing_deg, LATENCY_S)) == pytest.approx(in_order, rel=0.05)
    ignoring = errors(bearing_deg, LATENCY_S, ignored=True)
    assert ignoring.mean(axis=0)[1] == pytest.approx(-ignoring_m, abs=0.1 * ignoring_m)
    assert abs(ignoring.mean(axis=0)[0]) < 0.3
