"""The figures of a soak as a person reads them."""

import math
from collections.abc import Iterator
from statistics import median

from tests.soak.figures import Figures, Run


def lines(figures: Figures) -> Iterator[str]:
    """The table."""
    yield f"soak of {figures.seconds / 60.0:.1f} min"
    if not figures.runs:
        return
    p50, p99, most = figures.emulated["lateness_ms"]
    yield f"emulator: frames late by {p50:.2f} ms (median), {p99:.2f} (99 %), {most:.1f} (worst)"
    yield from _bytes(figures)
    yield from _events(figures)
    yield from _solutions(figures)
    yield from _memory(figures)
    yield from _latency(figures)


def _bytes(figures: Figures) -> Iterator[str]:
    for name, carried in figures.carried.items():
        sent = figures.emulated["devices"][name]
        yield ""
        yield (
            f"{name}: {sent['frames']} frames whole, {sent['repeated']} repeated,"
            f" {sent['damaged']} damaged, {sent['dropped']} dropped,"
            f" {sent['junk_bytes']} bytes of junk; {sent['frames'] / figures.seconds:.1f} frames/s"
        )
        yield (
            f"  bytes: {sent['bytes']} sent, {carried.cut} cut, {carried.untaken} taken by nobody,"
            f" {figures.heard(name)} heard, {figures.unexplained(name) + figures.unsent(name)}"
            f" unexplained"
        )
        rejected = sum(
            n for run in figures.runs for n in run.status["devices"][name]["rejected"].values()
        )
        yield (
            f"  gateway: {figures.device(name, 'records')} decoded, {rejected} rejected"
            f" ({figures.device(name, 'rejected_bytes')} bytes),"
            f" {figures.device(name, 'kernel_dropped')} dropped by the kernel,"
            f" {figures.device(name, 'gaps')} gaps ({figures.device(name, 'missing')} missing)"
        )


def _events(figures: Figures) -> Iterator[str]:
    yield ""
    for what in dict.fromkeys(event.what for event in figures.events):
        back = [event.back_s for event in figures.events if event.what == what]
        took = [back_s for back_s in back if back_s is not None]
        told = "never true again"
        if took:
            told = f"true again after {median(took):.1f} s (median), {max(took):.1f} (worst)"
        never = f", never {len(back) - len(took)} times" if took and len(took) < len(back) else ""
        yield f"{what}: {len(back)} times, {told}{never}"
    restarts = sum(run.status["filter"]["restarts"] for run in figures.runs)
    yield f"restarts: {len(figures.runs) - 1} of the gateway, {restarts} of the filter"


def _solutions(figures: Figures) -> Iterator[str]:
    errors = figures.errors
    modes = ", ".join(f"{n} {mode}" for mode, n in errors.modes.most_common())
    yield ""
    rate = errors.solutions / figures.seconds
    yield f"solutions: {errors.solutions}, {rate:.2f} a second: {modes}"
    if errors.judged:
        rms = math.sqrt(errors.squares_m2 / errors.judged)
        yield f"horizontal error: {rms:.2f} m RMS, {errors.worst_m:.2f} worst"
        worst = ", ".join(f"{name} {ratio:.2f}" for name, ratio in errors.worst.items())
        share = 100.0 * errors.beyond_3 / errors.judged
        yield f"worst error over its sigma: {worst}; any beyond 3: {share:.2f} % of solutions"


def _memory(figures: Figures) -> Iterator[str]:
    yield ""
    for n, run in enumerate(figures.runs, 1):
        first, last = run.memory[0][1], run.memory[-1][1]
        slope = run.slope_mb_h()
        told = "too short for a slope" if slope is None else f"{slope:+.1f} MB/h"
        yield f"memory of run {n}: {first:.0f} MB at first, {last:.0f} at the end, {told}"


def _latency(figures: Figures) -> Iterator[str]:
    yield ""
    for n, run in enumerate(figures.runs, 1):
        yield from (f"latency of run {n}, arrival to {text}" for text in _totals(run))


def _totals(run: Run) -> Iterator[str]:
    for row in run.status["latency"]:
        if row["stage"] == "total":
            spread = row["since_start"]
            p50, p99, most = (spread[key] / 1e3 for key in ("p50_us", "p99_us", "max_us"))
            yield f"{row['of']}: {p50:.2f} ms (median), {p99:.2f} (99 %), {most:.1f} (worst)"
