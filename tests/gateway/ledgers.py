"""Timelines over an engine whose arithmetic is exact."""

import numpy as np

from gateway.timeline import Timeline

RATE_HZ = 100.0
STEP_NS = 10_000_000
T0 = 1_000_000_000_000


class Ledger:
    """Adds up time in shares and notes when each measurement was applied."""

    def __init__(self):
        self.sum = 0.0
        self.seen = []

    def advance(self, rows, track):
        for row, mark in zip(rows, track, strict=True):
            self.sum += row[1]
            mark[:] = self.sum

    def advance_part(self, row, begin, end):
        assert 0.0 <= begin < end <= 1.0
        self.sum += (end - begin) * row[1]

    def mark(self, track):
        track[:] = self.sum

    def apply(self, measurement, track):
        self.seen.append((measurement, round(self.sum, 6)))
        return measurement

    def save(self):
        return self.sum, list(self.seen)

    def restore(self, saved):
        self.sum, self.seen = saved[0], list(saved[1])


def samples(first, n):
    """Rows whose second column counts one a sample."""
    t_ns = T0 + (np.arange(first, first + n) + 1) * STEP_NS
    rows = np.zeros((n, 8))
    rows[:, 0], rows[:, 1] = 0.01, 1.0
    return t_ns, rows


def at(samples_from_start):
    return T0 + round(samples_from_start * STEP_NS)


def ledger(history_s=2.0, slice_=None, **options):
    engine = Ledger()
    return engine, Timeline(engine, RATE_HZ, history_s, slice_=slice_, **options)
