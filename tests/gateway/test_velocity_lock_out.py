"""A Doppler log alone: a wrong attitude lets it in again, a wrong log stays out."""

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from gateway.fusion import initial
from gateway.fusion.doubt import VELOCITY_LOCK_OUT_S
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.saved import memory_of, saved
from gateway.fusion.state import POS, State
from gateway.messages import BottomVelocity, Depth, Fix, HeadingFix
from gateway.nav import earth
from gateway.nav.lie import exp_so3
from gateway.timeline import Timeline
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import T0_NS, Voyage, configuration

DURATION_S = 90.0
RATE_HZ = 50.0
FISH_FROM_S = 20.0


@cache
def voyage() -> Voyage:
    data = demo_data() | {"duration_s": DURATION_S, "seed": 4}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    return Voyage(make(data))


def aiding(trip: Voyage, fish_s: float) -> Iterator[Fix]:
    """A log five times a second, wrong by 1 m/s while it hears fish; depth and compass."""
    rng = np.random.default_rng(1)
    times = np.arange(0.5, DURATION_S - 0.1, 0.2)
    pose, there = trip.truth.pose(times), trip.truth.geodetic(times)
    for k, t in enumerate(times):
        t_ns = T0_NS + round(t * 1e9)
        v_e = earth.C_en(there.lat[k], there.lon[k]) @ there.v_eb_n[k]
        v_b = pose.C_eb[k].T @ v_e + 0.02 * rng.standard_normal(3)
        v_b[1] += FISH_FROM_S < t < FISH_FROM_S + fish_s
        yield BottomVelocity(t_ns, "dvl0", tuple(v_b.tolist()), (0.02, 0.02, 0.02))
        h, heading = there.h[k] + 0.1 * rng.normal(), there.heading[k] + 0.02 * rng.normal()
        yield Depth(t_ns + 1, "depth0", float(h), 0.1)
        if k % 5 == 0:
            yield HeadingFix(t_ns + 2, "compass0", float(heading), 0.02)


def followed(off_deg: float, fish_s: float = 0.0) -> tuple[Filter, list[float], float]:
    """The filter at the end, when the log was refused (s), and how far off the end is (m)."""
    trip = voyage()
    config = configuration(trip.scenario)
    fresh = initial.initial_state(config)
    state = State(trip.state(0.0).x, fresh.P, fresh.columns)
    state.P[:9, :9] = np.diag(np.repeat([np.radians(0.3), 0.2, 5.0], 3) ** 2)
    state.C_eb[:] = state.C_eb @ exp_so3(np.radians([off_deg, 0.0, 0.0]))
    engine = Filter(initial.model(config), Memory(state))
    timeline = Timeline(engine, RATE_HZ, 10.0, slice_=None)
    for fix in aiding(trip, fish_s):
        timeline.insert(fix, fix.t_ns, repr(fix))
    verdicts = timeline.extend(trip.t_ns, trip.rows)
    refused = [v.t_ns for v in verdicts if v.device == "dvl0" and not v.accepted]
    error = engine.memory.state.r_e - trip.state(DURATION_S).r_e
    return engine, [(t - T0_NS) * 1e-9 for t in refused], float(np.linalg.norm(error))


def test_a_wrong_attitude_does_not_lock_a_log_out_for_good() -> None:
    engine, refused_s, error_m = followed(off_deg=-3.0)
    assert refused_s[-1] - refused_s[0] > VELOCITY_LOCK_OUT_S
    assert refused_s[-1] < DURATION_S - 10.0
    assert error_m < 10.0
    assert error_m < 3.0 * np.sqrt(np.trace(engine.memory.state.P[POS, POS]))


@pytest.mark.parametrize("fish_s", [20.0, 60.0])
def test_a_wrong_log_is_not_believed(fish_s: float) -> None:
    engine, refused_s, error_m = followed(off_deg=0.2, fish_s=fish_s)
    assert sum(FISH_FROM_S < t < FISH_FROM_S + fish_s for t in refused_s) > 4.9 * fish_s
    assert refused_s[-1] < FISH_FROM_S + fish_s + 1.0
    assert error_m < 1.0
    assert engine.memory.velocity_refused == {}


def test_what_is_counted_outlives_the_process() -> None:
    engine, _, _ = followed(off_deg=0.2)
    engine.memory.velocity_refused["dvl0"] = (T0_NS, 0.5, 1)
    again = memory_of(saved(engine.memory, T0_NS))
    assert again.velocity_refused == {"dvl0": (T0_NS, 0.5, 1)}
    assert engine.save().velocity_refused is not engine.memory.velocity_refused
