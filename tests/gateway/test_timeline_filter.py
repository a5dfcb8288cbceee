"""The order law with the real filter: its state is that of the run in order of time."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.fusion import initial
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.order import Refusal
from gateway.timeline import Timeline
from tests.gateway.emulated import demo_data, make
from tests.gateway.ledgers import RATE_HZ
from tests.gateway.states import same_memory
from tests.gateway.voyages import Voyage, configuration

SECONDS = 6.0


@cache
def voyage():
    """Six seconds with a fix about every half second from three beacons."""
    data = demo_data() | {"duration_s": SECONDS, "seed": 9}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    data["devices"]["usbl0"] |= {"period_s": 0.45, "outliers": {}}
    data["beacons"] = {
        "1": {"lat_deg": 39.8, "lon_deg": 116.2, "height_m": -50.0},
        "2": {"lat_deg": 39.801, "lon_deg": 116.2, "height_m": -50.0, "turnaround_ms": 30.0},
        "3": {"lat_deg": 39.8, "lon_deg": 116.202, "height_m": -60.0, "travel": "one_way"},
    }
    found = Voyage(make(data))
    found.fixes[:] = [fix for fix in found.fixes if fix.t_ns <= found.t_ns[-1]]
    return found, configuration(found.scenario)


def begin(history_s=10.0):
    _, config = voyage()
    filter_ = Filter(initial.model(config), Memory(initial.initial_state(config)))
    return filter_, Timeline(filter_, RATE_HZ, history_s, slice_=None)


def key(fix):
    return f"{fix.beacon}/{fix.bearing}"


@cache
def in_order():
    """State and verdicts with every fix inserted before the samples reach it."""
    trip, _ = voyage()
    filter_, timeline = begin()
    for fix in trip.fixes:
        assert timeline.insert(fix, fix.t_ns, key(fix)) == []
    verdicts = []
    for k in range(len(trip.t_ns)):
        verdicts += timeline.extend(trip.t_ns[k : k + 1], trip.rows[k : k + 1])
    assert [v.t_ns for v in verdicts] == [f.t_ns for f in trip.fixes]
    assert timeline.counts.late == 0
    return filter_.memory, verdicts


N_FIXES = len(voyage()[0].fixes)
delays = st.lists(st.floats(-2.0, SECONDS), min_size=N_FIXES, max_size=N_FIXES)


@settings(max_examples=30, deadline=None)
@given(delays, st.integers(1, 70), st.lists(st.integers(0, N_FIXES - 1), max_size=4))
def test_any_order_of_arrival_gives_the_state_of_the_order_of_time(delays, block, repeated):
    """Early, late by up to the whole run, twice, between blocks of any length."""
    trip, _ = voyage()
    filter_, timeline = begin()
    arrivals = [
        (f.t_ns + d * 1e9, k) for k, (f, d) in enumerate(zip(trip.fixes, delays, strict=True))
    ]
    arrivals += [(arrivals[k][0] + 1e8, k) for k in repeated]
    arrivals.sort()
    verdicts, refused = [], 0

    def offer():
        nonlocal refused
        fix = trip.fixes[arrivals.pop(0)[1]]
        found = timeline.insert(fix, fix.t_ns, key(fix))
        refused += isinstance(found, Refusal)
        verdicts.extend([] if isinstance(found, Refusal) else found)

    for k in range(0, len(trip.t_ns), block):
        while arrivals and arrivals[0][0] <= trip.t_ns[k]:
            offer()
        verdicts += timeline.extend(trip.t_ns[k : k + block], trip.rows[k : k + block])
    while arrivals:
        offer()
    same_memory(filter_.memory, in_order()[0])
    assert refused == timeline.counts.duplicate == len(repeated)
    assert timeline.counts.too_late == 0
    assert sorted(v.t_ns for v in verdicts) == [f.t_ns for f in trip.fixes], "one verdict each"


def test_a_late_verdict_is_what_it_would_have_been():
    """All fixes after the last sample, newest first: the last one in tells the whole truth."""
    trip, _ = voyage()
    filter_, timeline = begin()
    timeline.extend(trip.t_ns, trip.rows)
    for fix in reversed(trip.fixes):
        (verdict,) = timeline.insert(fix, fix.t_ns, key(fix))
    assert timeline.counts.late == N_FIXES
    same_memory(filter_.memory, in_order()[0])
    assert verdict.nis == pytest.approx(in_order()[1][0].nis, rel=1e-9)


def test_the_track_says_where_the_ping_left():
    trip, _ = voyage()
    filter_, timeline = begin()
    timeline.extend(trip.t_ns, trip.rows)
    start = trip.t_ns[0]
    for t_s in (0.5, 1.234, 5.0):
        found = timeline.at(start + round(t_s * 1e9)) - timeline.at(start)
        moved = filter_.memory.state.r_e - trip.state(SECONDS).r_e  # the initial error
        truth = trip.state(t_s + trip.t_imu[0]).r_e - trip.state(trip.t_imu[0]).r_e
        np.testing.assert_allclose(found[:3], truth, atol=0.3 * t_s + np.linalg.norm(moved) * 0.01)
