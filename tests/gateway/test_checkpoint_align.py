"""A process killed while the attitude is being found: the next one finds the same, however long."""

import itertools

import msgspec
import numpy as np
import pytest

from gateway.estimator import Estimator
from gateway.filter_process.host import most_kept
from gateway.fusion import start
from gateway.messages import Checkpoint, ImuBlock, Innovation, SavedState
from gateway.timeline import LOOK_BACK_S
from tests.gateway.test_estimator_start import MOORED, MOWING, TURNING, aligning, scenario
from tests.gateway.voyages import T0_NS, Voyage

HZ = 50.0
OUTPUT_HZ = 5.0


def arriving(voyage, silence_s=None, deaf_s=0.0):
    """Blocks of one to nine samples and fixes 0.5 s late; some of either are missing."""
    rng = np.random.default_rng(3)
    blocks, held = [], []
    for m in voyage.arrivals(0.5, 1.0 / HZ):
        if not isinstance(m, ImuBlock):
            if m.t_ns < T0_NS + deaf_s * 1e9:
                continue
        elif silence_s is not None:
            t_s = (m.t_last_ns - T0_NS) * 1e-9
            if silence_s[0] < t_s < silence_s[1]:
                held.append(m)
                continue
            if held:
                m, held = standing_in(m, len(held)), []
        blocks.append(m)
    n = 0
    while n < len(blocks):
        size = int(rng.integers(1, 10))
        for is_block, group in itertools.groupby(
            blocks[n : n + size], lambda m: isinstance(m, ImuBlock)
        ):
            if is_block:
                group = list(group)
                yield ImuBlock(b"".join(m.t_ns for m in group), b"".join(m.rows for m in group))
            else:
                yield from group
        n += size


def standing_in(block, missing):
    """The first sample after a silence, as ingest makes it."""
    row = np.frombuffer(block.rows).reshape(-1, 8)[-1].copy()
    row[:7] *= missing + 1
    row[7] = row[0] * missing / (missing + 1)
    return ImuBlock(block.t_ns[-8:], row.tobytes())


def config_of(voyage, history_s=2.0, **align):
    config = aligning(voyage, **align)
    block = msgspec.structs.replace(config.filter, history_s=history_s, max_gap_s=5.0)
    return msgspec.structs.replace(config, filter=block)


CASES = {
    "one long window": (MOORED, 45.0, {"level_s": 30.0}, {}),
    "refused in turns": (TURNING, 35.0, {"level_s": 7.3}, {}),
    "no fix for long": (MOWING, 40.0, {"level_s": 5.0, "heading": "unknown"}, {"deaf_s": 17.0}),
    "again after a silence": (MOORED, 50.0, {"level_s": 10.0}, {"silence_s": (14.0, 26.0)}),
}


WINDOWS = {
    "one long window": [True],
    "refused in turns": [False] * 4,
    "no fix for long": [False] * 3 + [True],
    "again after a silence": [True, True],
}


@pytest.mark.parametrize("case", CASES)
def test_whenever_it_dies_the_next_one_says_the_same(case):
    track, seconds, align, missing = CASES[case]
    voyage = Voyage(scenario(track, 4, seconds, HZ))
    config, measurements = config_of(voyage, **align), list(arriving(voyage, **missing))
    old, whole, checkpoints = Estimator(config, OUTPUT_HZ), [], []
    for n, m in enumerate(measurements):
        for output in old.feed(m):
            if isinstance(output, Checkpoint):
                checkpoints.append((n, len(whole), output))
            elif not isinstance(output, SavedState):
                whole.append(output)
    during = [c for c in checkpoints if c[2].aligning is not None]
    assert during
    assert any(c.aligning.again for _, _, c in during) == ("silence_s" in missing)
    windows = [o.accepted for o in whole if isinstance(o, Innovation) and o.device == "imu0"]
    assert windows == WINDOWS[case]
    chosen = np.random.default_rng(1).choice(len(checkpoints), 3)
    for k in {0, len(during) - 1, *chosen.tolist()}:
        _, heard, found = checkpoints[k]
        told = msgspec.msgpack.decode(msgspec.msgpack.encode(found), type=Checkpoint)
        new = Estimator(config, OUTPUT_HZ, told)
        again = [o for m in measurements[told.received :] for o in new.feed(m)]
        again = [o for o in again if not isinstance(o, SavedState | Checkpoint)]
        assert encoded(again) == encoded(whole[told.said :])
        assert told.said <= heard
        assert new.counts() == old.counts()


def encoded(outputs):
    return [msgspec.msgpack.encode(output) for output in outputs]


def test_what_is_kept_since_a_checkpoint_is_a_window_and_a_history():
    """However many windows are refused: so the host never has to forget."""
    voyage = Voyage(scenario(TURNING, 4, 90.0, HZ))
    config = config_of(voyage, level_s=7.3)
    measurements = list(voyage.arrivals(0.5, 1.0 / HZ))
    estimator, received, most = Estimator(config, OUTPUT_HZ), 0, 0
    for n, m in enumerate(measurements):
        for output in estimator.feed(m):
            if isinstance(output, Checkpoint):
                received = output.received
        most = max(most, n + 1 - received)
    seconds = 7.3 + config.filter.history_s + LOOK_BACK_S + 3.0
    assert most < 1.1 * seconds * HZ
    assert most < most_kept(config)
    assert len(measurements) > 4 * most


def test_one_that_is_too_much_to_be_told_is_not(monkeypatch):
    monkeypatch.setattr(start, "MOST_SAMPLES", 3 * round(HZ))
    voyage = Voyage(scenario(MOORED, 4, 20.0, HZ))
    estimator = Estimator(config_of(voyage, level_s=15.0), OUTPUT_HZ)
    outputs = [o for m in voyage.arrivals(0.5, 1.0 / HZ) for o in estimator.feed(m)]
    told = [o.aligning for o in outputs if isinstance(o, Checkpoint)]
    assert [len(a.samples.t_ns) // 8 for a in told] == [1, *(round(k * HZ) for k in (1, 2, 3))]
