"""Tracks: the truth within their sigmas, in any order of arrival, through outliers and silence."""

import msgspec
import numpy as np
import pytest

from gateway.config import Target
from gateway.messages import TargetSighting
from gateway.nav import earth
from gateway.targets import KEPT_S, LOCK_OUT, Motion, Targets, Track, TrackedPlace

LAT, LON, H = np.radians(60.0), np.radians(5.0), -80.0
MOTION = Motion(0.05, 30.0)
SD = np.array([1.0, 1.5, 0.7])
EVERY_NS = 2_000_000_000
NONE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def at(n_m: np.ndarray) -> tuple[float, float, float]:
    r_e = earth.lla_to_ecef(LAT, LON, H) + earth.C_en(LAT, LON) @ n_m
    lat, lon, h = earth.ecef_to_lla(r_e)
    return float(lat), float(lon), float(h)


def sighting(t_ns: int, n_m: np.ndarray, sd: np.ndarray = SD) -> TargetSighting:
    nn, ee, dd = (sd**2).tolist()
    return TargetSighting(t_ns, "usbl0", "2", *at(n_m), (nn, ee, dd, 0.0, 0.0, 0.0), NONE)


def voyage(seed: int, count: int = 60) -> tuple[np.ndarray, np.ndarray, list[TargetSighting]]:
    """True places and velocities of something that drifts as the model says, and its sightings."""
    rng = np.random.default_rng(seed)
    dt, q = EVERY_NS * 1e-9, MOTION.acceleration**2
    chol = np.linalg.cholesky(q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]]))
    p, v = np.zeros(3), rng.normal(0.0, 1.5, 3)
    places, speeds = [], []
    for _ in range(count):
        noise = chol @ rng.normal(size=(2, 3))
        p, v = p + dt * v + noise[0], v + noise[1]
        places.append(p)
        speeds.append(v)
    told = [
        sighting(k * EVERY_NS, place + rng.normal(0.0, SD)) for k, place in enumerate(places, 1)
    ]
    return np.array(places), np.array(speeds), told


def error(found: TrackedPlace, place: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(6,) in north, east, down."""
    r_e = earth.lla_to_ecef(found.lat, found.lon, found.h)
    off = earth.C_en(LAT, LON).T @ (r_e - earth.lla_to_ecef(LAT, LON, H)) - place
    return np.concatenate([off, np.array(found.v_n) - speed])


def test_it_is_as_sure_as_it_says() -> None:
    """NEES of 40 runs at their ends: 6 within the 95 % bounds of a mean of 40."""
    nees = []
    for seed in range(40):
        places, speeds, told = voyage(seed)
        track = Track(MOTION)
        for one in told:
            assert track.take(one)
        found = track.at(told[-1].t_ns)
        assert found is not None
        e = error(found, places[-1], speeds[-1])
        nees.append(e @ np.linalg.solve(found.P, e))
    assert 4.98 < np.mean(nees) < 7.12  # chi-squared of 240 degrees of freedom over 40


def test_the_order_of_arrival_does_not_matter() -> None:
    _, _, told = voyage(3, count=25)
    rng = np.random.default_rng(1)
    in_order, shuffled = Track(MOTION), Track(MOTION)
    for one in told:
        in_order.take(one)
    # The first one tells where the axes are; within its patience the rest may come in any order.
    for k in [0, *(1 + rng.permutation(len(told) - 1)).tolist()]:
        assert shuffled.take(told[k])
    end = told[-1].t_ns
    a, b = in_order.at(end), shuffled.at(end)
    assert a is not None
    assert b is not None
    np.testing.assert_allclose(a.P, b.P, rtol=1e-12)
    assert (a.lat, a.lon, a.h) == pytest.approx((b.lat, b.lon, b.h), abs=1e-12)


def test_what_comes_after_the_patience_is_not_worked_in() -> None:
    _, _, told = voyage(4, count=60)
    track = Track(MOTION)
    for one in told[:1] + told[2:]:
        track.take(one)
    assert told[-1].t_ns - told[1].t_ns > KEPT_S * 1e9
    assert not track.take(told[1])


def test_an_outlier_is_refused_and_several_that_agree_are_right() -> None:
    places, speeds, told = voyage(5)
    track = Track(MOTION)
    for one in told[:40]:
        track.take(one)
    far = places[40] + np.array([300.0, 0.0, 0.0])
    track.take(sighting(41 * EVERY_NS, far))
    found = track.at(41 * EVERY_NS)
    assert found is not None
    assert np.linalg.norm(error(found, places[40], speeds[40])[:3]) < 10.0
    for k in range(42, 42 + LOCK_OUT):
        track.take(sighting(k * EVERY_NS, far))
    found = track.at((41 + LOCK_OUT) * EVERY_NS)
    assert found is not None
    assert np.linalg.norm(error(found, far, np.zeros(3))[:3]) < 10.0


def test_silence_grows_its_uncertainty_until_it_is_lost() -> None:
    _, _, told = voyage(6, count=20)
    track = Track(MOTION)
    assert track.at(0) is None
    for one in told:
        track.take(one)
    end = told[-1].t_ns
    sd = []
    for later_s in (0, 5, 10, 20):
        found = track.at(end + later_s * 1_000_000_000)
        assert found is not None
        assert found.age_s == pytest.approx(later_s)
        sd.append(float(np.sqrt(found.P[0, 0])))
    assert sd == sorted(sd)


def test_all_are_told_once_a_second_from_their_first_sighting_on() -> None:
    targets = Targets({"2": Target(name="rov"), "7": Target(name="sledge", max_age_s=5.0)})
    assert targets.due(EVERY_NS) == []
    targets.take(msgspec.structs.replace(sighting(EVERY_NS, np.zeros(3)), beacon="7"))
    assert targets.due(EVERY_NS + 5_000_000) == []
    (one,) = targets.due(EVERY_NS + 1_000_000_000)
    assert (one.number, one.block.name, one.is_lost) == (2, "sledge", False)
    assert targets.due(EVERY_NS + 1_900_000_000) == []
    (one,) = targets.due(EVERY_NS + 5_100_000_000)
    assert one.is_lost


def test_a_sighting_after_it_was_lost_begins_it_anew() -> None:
    _, _, told = voyage(7, count=20)
    track = Track(MOTION)
    for one in told:
        track.take(one)
    far = np.array([5000.0, -2000.0, 40.0])
    t_ns = told[-1].t_ns + 40_000_000_000
    track.take(sighting(t_ns, far))
    found = track.at(t_ns)
    assert found is not None
    assert np.linalg.norm(error(found, far, np.zeros(3))) < 1e-3


def test_what_all_sightings_share_is_not_averaged_away() -> None:
    """Sightings that are all as far off as we are: the track stays so, and says so."""
    shared = np.array([2.0, -1.0, 0.5])
    quiet = Motion(0.002, 30.0)
    track, unaware = Track(quiet), Track(quiet)
    for k in range(1, 61):
        one = sighting(k * EVERY_NS, shared, np.full(3, 0.5))
        track.take(msgspec.structs.replace(one, own_cov=(4.0, 1.0, 0.25, 0.0, 0.0, 0.0)))
        unaware.take(one)
    found, claimed = track.at(60 * EVERY_NS), unaware.at(60 * EVERY_NS)
    assert found is not None
    assert claimed is not None
    np.testing.assert_allclose(error(found, np.zeros(3), np.zeros(3))[:3], shared, atol=1e-3)
    np.testing.assert_allclose(found.P[:3, :3] - claimed.P[:3, :3], np.diag([4.0, 1.0, 0.25]))
    assert claimed.P[0, 0] < 0.1


def test_a_ship_that_finds_its_place_does_not_see_its_targets_run() -> None:
    """NEES of 100 runs after the second and third sighting: 6 at most, by the 97.5 % of a mean."""
    lost, found = 5.0, 0.3
    nees = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        places, speeds, told = voyage(seed, count=3)
        own = rng.normal(0.0, found, 3)
        was = own + rng.normal(0.0, np.sqrt(lost**2 - found**2), 3)
        track = Track(MOTION)
        for k, (one, place, speed) in enumerate(zip(told, places, speeds, strict=True)):
            off, sd = (own, found) if k else (was, lost)
            seen = place + rng.normal(0.0, SD) + off
            cov = (sd**2, sd**2, sd**2, 0.0, 0.0, 0.0)
            track.take(msgspec.structs.replace(sighting(one.t_ns, seen), own_cov=cov))
            claimed = track.at(one.t_ns)
            assert claimed is not None
            e = error(claimed, place, speed)
            nees.append(e @ np.linalg.solve(claimed.P, e))
    assert np.reshape(nees, (100, 3)).mean(axis=0).max() < 6.7  # chi-squared of 600 over 100
