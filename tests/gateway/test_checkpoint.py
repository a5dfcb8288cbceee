"""A new estimator from a checkpoint says what the old one would have said, bit for bit."""

from functools import cache

import msgspec
import numpy as np
import pytest

from gateway.estimator import Estimator
from gateway.messages import Checkpoint, FilterCounts, ImuBlock, Innovation, SavedState
from gateway.timeline import LOOK_BACK_S
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import Voyage, block, configuration

OUTPUT_HZ = 5.0
HISTORY_S = 2.0
SECONDS = 22.0
SETTLES_S = HISTORY_S + LOOK_BACK_S


@cache
def voyage():
    """Fixes of three beacons on the move; one comes two-way over 400 m."""
    data = demo_data() | {"duration_s": SECONDS, "seed": 5}
    data["devices"]["imu0"]["rate_hz"] = 200.0
    data["devices"]["usbl0"] |= {"period_s": 0.7}
    data["beacons"] = {
        "1": {"lat_deg": 39.8, "lon_deg": 116.2, "height_m": -50.0},
        "2": {"lat_deg": 39.8035, "lon_deg": 116.2, "height_m": -50.0, "turnaround_ms": 30.0},
        "3": {"lat_deg": 39.8, "lon_deg": 116.202, "height_m": -60.0, "travel": "one_way"},
    }
    found = Voyage(make(data))
    choice = {"history_s": HISTORY_S, "adaptive_noise": True, "robust": "huber"}
    return found, configuration(found.scenario, filter=choice)


def arriving(delays, repeated, block_samples):
    """Every fix after its own delay (s, early below zero), some twice, between blocks."""
    trip, _ = voyage()
    fixes = [
        (fix.t_ns + d * 1e9, k) for k, (fix, d) in enumerate(zip(trip.fixes, delays, strict=True))
    ]
    fixes += [(fixes[k][0] + extra * 1e9, k) for k, extra in repeated]
    fixes.sort()
    out = []
    for k in range(0, len(trip.t_ns), block_samples):
        part = slice(k, k + block_samples)
        while fixes and fixes[0][0] <= trip.t_ns[part][0]:
            out.append(trip.fixes[fixes.pop(0)[1]])
        out.append(block(trip.t_ns[part], trip.rows[part]))
    return [through_the_channel(m) for m in out]


def through_the_channel(message):
    return msgspec.msgpack.decode(msgspec.msgpack.encode(message), type=type(message))


def said(estimator, measurements):
    """What is said to each measurement, without what is for the keeper, and that."""
    outputs, keep = [], []
    for m in measurements:
        for output in estimator.feed(m):
            kept = isinstance(output, SavedState | Checkpoint)
            (keep if kept else outputs).append((m, output))
    return outputs, keep


def encoded(outputs):
    return [msgspec.msgpack.encode(output) for _, output in outputs]


N_FIXES = len(voyage()[0].fixes)


@pytest.mark.parametrize("seed", range(8))
def test_the_outputs_go_on_as_if_nothing_had_been(seed):
    """Any order of arrival, any moment of death: late, early, too late, double; in slices too."""
    _, config = voyage()
    rng = np.random.default_rng(seed)
    delays = rng.uniform(-1.0, 1.2 * HISTORY_S, N_FIXES) * rng.choice([0.0, 1.0], N_FIXES)
    repeats = list(zip(rng.integers(0, N_FIXES, 6), rng.uniform(0.0, HISTORY_S, 6), strict=True))
    measurements = arriving(delays, repeats, int(rng.integers(1, 160)))
    old = Estimator(config, OUTPUT_HZ)
    whole, keep = [], []
    for n, m in enumerate(measurements):
        for output in old.feed(m):
            if isinstance(output, Checkpoint):
                keep.append((n, len(whole), output))
            elif not isinstance(output, SavedState):
                whole.append((m, output))
    assert len(keep) >= SECONDS - SETTLES_S - 2.0
    fed, heard, checkpoint = keep[rng.integers(len(keep))]
    checkpoint = through_the_channel(checkpoint)
    again, later = said(
        Estimator(config, OUTPUT_HZ, checkpoint), measurements[checkpoint.received :]
    )
    dropped = heard - checkpoint.said
    assert 0 <= dropped <= len(again)
    assert encoded(again[dropped:]) == encoded(whole[heard:])
    new = {c.t_ns: c for _, c in later if isinstance(c, Checkpoint)}
    for n, _, found in keep:
        if n > fed and found.t_ns > checkpoint.t_ns:
            assert new[found.t_ns] == found


@cache
def ordinary():
    return arriving([0.5] * N_FIXES, [], 40)


def test_a_checkpoint_is_given_each_second_as_soon_as_nothing_can_change_it():
    _, config = voyage()
    _, keep = said(Estimator(config, OUTPUT_HZ), ordinary())
    given = [
        (np.frombuffer(m.t_ns, dtype=np.int64)[-1], o.t_ns)
        for m, o in keep
        if isinstance(o, Checkpoint)
    ]
    ages = np.array([now - then for now, then in given]) * 1e-9
    assert np.diff([then for _, then in given]) == pytest.approx(1e9, abs=3e7)
    assert ages.min() >= SETTLES_S and ages.max() < SETTLES_S + 1.5
    for _, checkpoint in keep:
        if isinstance(checkpoint, Checkpoint):
            assert len(msgspec.msgpack.encode(checkpoint)) < 20_000


def test_a_state_is_given_each_second_and_is_the_newest():
    trip, config = voyage()
    _, keep = said(Estimator(config, OUTPUT_HZ), ordinary())
    states = [o.t_ns for _, o in keep if isinstance(o, SavedState)]
    assert np.diff(states) == pytest.approx(1e9, abs=3e7)
    assert trip.t_ns[-1] - states[-1] < 1.1e9


def test_a_checkpoint_from_before_a_fault_leads_through_it():
    """A sample that is no number, and the reset it led to, come again with the rest."""
    _, config = voyage()
    measurements = list(ordinary())
    blocks = [n for n, m in enumerate(measurements) if isinstance(m, ImuBlock)]
    bad = blocks[round(0.8 * len(blocks))]
    rows = np.frombuffer(measurements[bad].rows).copy()
    rows[-6] = np.nan
    measurements[bad] = ImuBlock(measurements[bad].t_ns, rows.tobytes())
    with np.errstate(invalid="ignore"):
        old = Estimator(config, OUTPUT_HZ)
        whole, keep = said(old, measurements)
        checkpoint = [o for _, o in keep if isinstance(o, Checkpoint)][-1]
        new = Estimator(config, OUTPUT_HZ, checkpoint)
        again, _ = said(new, measurements[checkpoint.received :])
    assert encoded(again[len(again) - 50 :]) == encoded(whole[-50:])
    assert checkpoint.said + len(again) == len(whole)
    assert new.counts() == old.counts()
    assert new.counts().resets == 1


def test_every_fix_is_counted_once():
    """The totals of the new estimator are those of the old one at its end."""
    _, config = voyage()
    late = np.linspace(-0.5, 1.3 * HISTORY_S, N_FIXES)
    measurements = arriving(list(late), [(k, 0.3) for k in range(0, N_FIXES, 7)], 20)
    old = Estimator(config, OUTPUT_HZ)
    outputs, keep = said(old, measurements)
    checkpoint = next(o for _, o in keep if isinstance(o, Checkpoint))
    new = Estimator(config, OUTPUT_HZ, checkpoint)
    said(new, measurements[checkpoint.received :])
    counts = new.counts()
    assert counts == old.counts()
    assert min(counts.fixes_late, counts.fixes_too_late, counts.fixes_duplicate) > 0
    assert len([o for _, o in outputs if isinstance(o, Innovation)]) >= N_FIXES
    assert isinstance([o for _, o in outputs if isinstance(o, FilterCounts)][-1], FilterCounts)
