"""What a late fix holds up: the longest step of the timeline, in slices and all at once."""

import time
from statistics import median

import msgspec
import numpy as np

from gateway.config import Config, load
from gateway.fusion import initial
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.warmup import warm_up
from gateway.messages import Fix, UsblFix
from gateway.timeline import SLICE, Timeline
from tests.bench.replayed import Row, Source
from tests.bench.steps import arrivals, samples

RUNS = 7
SECONDS = 16
RATE_HZ = 200
CASES = ((1, 0.5), (1, 2.5), (1, 9.9), (5, 2.5), (5, 9.9))
"""Parts into which each sample is cut, and how late the fix is (s)."""


def measure(source: Source) -> list[Row]:
    """Microseconds of the longest of all steps until the verdict is there."""
    warm_up()
    config = load(source.config)
    heard = arrivals(source, config, int(1.1 * SECONDS * RATE_HZ))
    fix = next(m for m in heard if isinstance(m, UsblFix))
    (block,) = samples(heard, len(heard))
    t_ns = np.frombuffer(block.t_ns, dtype=np.int64)
    rows = np.frombuffer(block.rows).reshape(-1, 8)
    found: list[Row] = []
    for parts, late_s in CASES:
        inputs = _cut(t_ns, rows, parts)
        name = f"late fix, {late_s} s at {parts * RATE_HZ} Hz, longest step"
        for how, slice_ in (("in slices", SLICE), ("all at once", None)):
            took = median(_longest_s(config, inputs, fix, late_s, slice_) for _ in range(RUNS))
            found.append((f"{name} {how}", took * 1e6, "us"))
    return found


def _cut(t_ns: np.ndarray, rows: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """The same motion by an IMU that is faster by a whole factor."""
    dt_ns = np.rint(rows[:, :1] * 1e9).astype(np.int64)
    ends = t_ns[:, None] - dt_ns + dt_ns * np.arange(1, parts + 1) // parts
    return ends.ravel(), np.repeat(rows / parts, parts, axis=0)


def _longest_s(
    config: Config,
    inputs: tuple[np.ndarray, np.ndarray],
    fix: Fix,
    late_s: float,
    slice_: int | None,
) -> float:
    """Processor time of the longest step from the fix to its verdict, sample by sample."""
    t_ns, rows = inputs
    timeline = Timeline(
        Filter(initial.model(config), Memory(initial.initial_state(config))),
        len(t_ns) / SECONDS,
        config.filter.history_s,
        slice_=slice_,
    )
    k = len(t_ns) - 300
    timeline.extend(t_ns[:k], rows[:k])
    late = msgspec.structs.replace(fix, t_ns=int(t_ns[k - 1]) - round(late_s * 1e9))
    steps, verdicts = [time.process_time()], timeline.insert(late, late.t_ns, repr(late))
    steps.append(time.process_time())
    while not verdicts:
        verdicts = timeline.extend(t_ns[k : k + 1], rows[k : k + 1])
        steps.append(time.process_time())
        verdicts += timeline.catch_up()
        steps.append(time.process_time())
        k += 1
    return float(np.diff(steps).max())
