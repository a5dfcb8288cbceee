"""Compiling is told of once and only when it happens; the hot loop allocates nothing per sample.

Each in an interpreter of its own: with an empty cache, and with numba's statistics of allocations.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TELL = """
import numpy as np
from gateway.nav.compiled import told_of_compiling
from gateway.nav.lie import exp_so3, skew
with told_of_compiling(lambda: print("compiling")):
    exp_so3(np.ones(3)), skew(np.ones(3))
print("done")
"""

COUNT = """
import numpy as np
from numba.core.runtime import rtsys
from gateway.nav import strapdown

x, P, q = np.zeros(strapdown.N_MEAN), np.eye(21), np.ones(4)
x[[0, 4, 8, 24, 28, 32]], x[12] = 1.0, 6.4e6

def run(samples):
    rows, track = np.full((samples, 8), 0.001), np.empty((samples, 12))
    strapdown.run(x, P, rows, q, track)

def allocations(samples):
    before = rtsys.get_allocation_stats().alloc
    run(samples)
    return rtsys.get_allocation_stats().alloc - before

run(1)  # compiles
print(allocations(1), allocations(10), allocations(1000))
"""


def answers(program: str, **environment: str) -> list[str]:
    """What a program prints, in words."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | environment,
        check=True,
        capture_output=True,
        text=True,
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.fixture(autouse=True)
def _only_compiled() -> None:
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        pytest.skip("nothing is compiled with NUMBA_DISABLE_JIT=1")


def test_compiling_is_told_once_and_a_cache_is_silent(tmp_path: Path) -> None:
    cold = answers(TELL, NUMBA_CACHE_DIR=str(tmp_path))
    warm = answers(TELL, NUMBA_CACHE_DIR=str(tmp_path))
    assert cold == ["compiling", "done"]
    assert warm == ["done"]


def test_allocations_do_not_grow_with_the_samples() -> None:
    one, ten, thousand = map(int, answers(COUNT, NUMBA_NRT_STATS="1"))
    assert 0 < one == ten == thousand
