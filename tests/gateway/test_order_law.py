"""The order law with real bytes: frames through codecs and clocks, in any order of arrival."""

from functools import cache

import numpy as np
import pytest

from drivers.capture.streams import read_streams
from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.fusion import initial
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.ingest import intakes
from gateway.messages import ImuBlock
from gateway.order import Refusal
from gateway.schema import build
from gateway.timeline import Timeline
from tests.gateway.emulated import START, demo_data, make
from tests.gateway.states import same_memory

RATE_HZ = 50.0
SECONDS = 3.0
HISTORY_S = 1.0
AHEAD_S = 0.6
CASES = 500


@pytest.fixture(scope="module")
def heard(tmp_path_factory):
    """Configuration, samples, and the fixes that lie within them: KVH and TrackLink bytes."""
    data = demo_data() | {"duration_s": SECONDS, "seed": 21, "start": START}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    data["devices"]["usbl0"] |= {"period_s": 0.4, "outliers": {}}
    folder = tmp_path_factory.mktemp("law")
    scenario = twin.for_capture(make(data))
    emulate(scenario, pcap=folder / "law.pcap", say=lambda _line: None)
    config = build(Config, twin.gateway_config(scenario), [])
    ways_in = intakes(config)
    links = {name: device.link for name, device in config.devices.items()}
    blocks, fixes = [], []
    for name, chunk, t_ns, _ in read_streams([folder / "law.pcap"], links):
        ways_in[name].feed(chunk, t_ns)
        for m in ways_in[name].flush():
            (blocks if isinstance(m, ImuBlock) else fixes).append(m)
    t_ns = np.concatenate([np.frombuffer(b.t_ns, dtype=np.int64) for b in blocks])
    rows = np.concatenate([np.frombuffer(b.rows).reshape(-1, 8) for b in blocks])
    inside = [f for f in fixes if t_ns[0] < f.t_ns < t_ns[-1] - 300_000_000]
    assert len(inside) >= 5
    return config, t_ns, rows, inside


def begin(config, slice_):
    engine = Filter(initial.model(config), Memory(initial.initial_state(config)))
    return engine, Timeline(engine, RATE_HZ, HISTORY_S, ahead_s=AHEAD_S, slice_=slice_)


def in_order(heard, chosen):
    """The run in which the chosen fixes came before the samples that reach them."""
    config, t_ns, rows, fixes = heard
    engine = Filter(initial.model(config), Memory(initial.initial_state(config)))
    timeline = Timeline(engine, RATE_HZ, HISTORY_S)
    for k in chosen:
        assert timeline.insert(fixes[k], fixes[k].t_ns, repr(fixes[k])) == []
    verdicts = timeline.extend(t_ns, rows)
    assert timeline.counts.late == 0
    return engine.memory, {v.t_ns: v for v in verdicts}


def arrivals(rng, heard):
    """Moments at which fixes come: late, early, too late, too early, some twice."""
    _, t_ns, _, fixes = heard
    offset_s = rng.uniform(-2.0 * AHEAD_S, 1.3 * HISTORY_S, len(fixes))
    offset_s *= rng.choice([0.1, 1.0], len(fixes))
    when = [(f.t_ns + 1e9 * d, k) for k, (f, d) in enumerate(zip(fixes, offset_s, strict=True))]
    when += [(when[k][0] + rng.uniform(0.0, 4e8), k) for k in rng.integers(0, len(fixes), 2)]
    last = float(t_ns[-1]) - 250_000_000
    return sorted((min(t, last), k) for t, k in when)


@pytest.mark.parametrize("slice_", [None, 60])
def test_any_order_of_arrival_gives_the_result_of_the_order_of_time(heard, slice_):
    """At once and in slices: state, covariance, memory and each verdict of what was in time."""
    config, t_ns, rows, fixes = heard
    reference = cache(lambda chosen: in_order(heard, chosen))
    counted = np.zeros(4, dtype=int)
    for seed in range(CASES // 2):
        rng = np.random.default_rng([seed, slice_ or 0])
        coming, block = arrivals(rng, heard), int(rng.integers(3, 13))
        engine, timeline = begin(config, slice_)
        verdicts, taken = [], set()
        for first in range(0, len(t_ns), block):
            while coming and coming[0][0] <= t_ns[first]:
                k = coming.pop(0)[1]
                found = timeline.insert(fixes[k], fixes[k].t_ns, repr(fixes[k]))
                if not isinstance(found, Refusal):
                    taken.add(k)
                    verdicts += found
            verdicts += timeline.extend(t_ns[first : first + block], rows[first : first + block])
        memory, expected = reference(tuple(sorted(taken)))
        same_memory(engine.memory, memory)
        assert sorted(v.t_ns for v in verdicts) == sorted(expected), "one verdict each"
        counts = timeline.counts
        assert len(taken) + counts.too_late + counts.too_early + counts.duplicate == len(fixes) + 2
        counted += [counts.late, counts.too_late, counts.too_early, counts.duplicate]
    assert counted.min() > CASES // 20, counted
