"""The hot loop against a plain C version of the same step (`step.c`), in the same run.

``python -m tests.bench.against_c`` prints the table; the ratio is the median of neighbouring pairs,
for a shared machine changes its speed within seconds.
"""

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np

from gateway.fusion import kalman, usbl
from gateway.fusion.errors import FAMILY
from gateway.fusion.ranging import Past
from gateway.fusion.state import N_STATES, State
from gateway.nav import strapdown
from tests.gateway.states import ORIGIN
from tests.gateway.voyages import perfect_rows, trajectory, true_state

SAMPLES = 1000
PAIRS = 100
CALLS = 2000
Q = np.array([1e-8, 1e-6, 1e-10, 1e-8])

Run = Callable[[State, np.ndarray, np.ndarray], None]
"""Carries a state over rows (k, 8) and writes the track (k, 12)."""


def compiler() -> str | None:
    """The C compiler of this machine."""
    return shutil.which("cc") or shutil.which("gcc")


def in_c() -> Run:
    """Build `step.c` and give its `run`."""
    source = Path(__file__).with_name("step.c")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "step.so"
        command = [compiler() or "cc", "-std=c11", "-O3", f"-DN={N_STATES}", "-shared", "-fPIC"]
        subprocess.run([*command, "-o", library, source, "-lm"], check=True)
        function = ctypes.CDLL(str(library)).run
    pointer = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    function.argtypes = [pointer, pointer, pointer, ctypes.c_long, pointer, pointer]
    function.restype = None

    def run(state: State, rows: np.ndarray, track: np.ndarray) -> None:
        function(state.x, state.P, rows, len(rows), Q, track)

    return run


def in_python(state: State, rows: np.ndarray, track: np.ndarray) -> None:
    """The strapdown itself."""
    strapdown.run(state.x, state.P, rows, Q, track)


def voyage() -> tuple[State, np.ndarray]:
    """A state of 21 components with every correlation, and samples of a turning vessel."""
    truth = trajectory("circle", 20.0)
    state = true_state(truth, 0.0)
    sigma = np.repeat([1e-3, 0.1, 5.0, 1e-5, 5e-3, 0.01, 0.02], 3)
    L = np.random.default_rng(1).normal(0.0, 1.0, (N_STATES, N_STATES)) * sigma[:, None]
    state.P[:] = L @ L.T
    return state, perfect_rows(truth, SAMPLES / 100.0, 100.0)


def disagreement(one: Run, other: Run) -> tuple[float, float]:
    """Largest relative difference of mean (by the norm of its parts) and covariance (by sigmas)."""
    start, rows = voyage()
    a, b = start.copy(), start.copy()
    one(a, rows, np.empty((len(rows), 12)))
    other(b, rows, np.empty((len(rows), 12)))
    assert np.linalg.norm(a.r_e - start.r_e) > 1.0
    parts = (strapdown.C_EB, strapdown.V_EB_E, strapdown.R_E, strapdown.S_E, strapdown.CHAIN)
    norm = np.linalg.norm
    mean = max(float(norm(a.x[part] - b.x[part]) / norm(b.x[part])) for part in parts)
    sigma = np.sqrt(b.P.diagonal())
    return mean, float(np.abs((a.P - b.P) / np.outer(sigma, sigma)).max())


def batches() -> tuple[float, float, float]:
    """Nanoseconds a sample in C and here, and the median of the ratios of neighbouring runs."""
    start, rows = voyage()
    track = np.empty((len(rows), 12))

    def took(run: Run) -> float:
        state = start.copy()
        begun = time.perf_counter_ns()
        run(state, rows, track)
        return (time.perf_counter_ns() - begun) / len(rows)

    c = in_c()
    took(c), took(in_python)
    pairs = [(took(c), took(in_python)) for _ in range(PAIRS)]
    return (
        median(a for a, _ in pairs),
        median(b for _, b in pairs),
        median(b / a for a, b in pairs),
    )


def one_at_a_time() -> float:
    """Nanoseconds of a call with one sample."""
    state, rows = voyage()
    return _median_ns(lambda k: strapdown.advance(state.x, state.P, rows[k % SAMPLES], 0.0, 1.0, Q))


def update_of_three_rows() -> tuple[float, float]:
    """Nanoseconds to linearise a fix, and to use it in the right-invariant filter."""
    start, _ = voyage()
    geometry = usbl.ArrayGeometry(np.array([1.0, 0.0, 2.0]), np.eye(3))
    ping = Past(start.s_e - 0.1, start.chain.copy(), 0.1)
    sight = usbl.Sighting(np.array([0.1, 0.2, 100.0]), np.ones(3), start.r_e + 60.0, ping)
    z = usbl.linearise(start, geometry, sight)
    assert z is not None
    right = FAMILY["right_invariant"]
    states = [start.copy() for _ in range(CALLS)]
    return (
        _median_ns(lambda _: usbl.linearise(start, geometry, sight)),
        _median_ns(lambda k: kalman.update(states[k], z, right, ORIGIN)),
    )


def _median_ns(call: Callable[[int], object]) -> float:
    """Median time of a call, the first left out."""
    took = []
    for k in range(CALLS):
        begun = time.perf_counter_ns()
        call(k)
        took.append(time.perf_counter_ns() - begun)
    return float(median(took[1:]))


def measure() -> list[tuple[str, float, str]]:
    """Rows of the table."""
    mean, covariance = disagreement(in_c(), in_python)
    assert mean < 1e-9
    assert covariance < 1e-9
    c, here, ratio = batches()
    linearise, update = update_of_three_rows()
    return [
        ("step of 21 states with covariance, in batches", here, "ns"),
        ("the same step in C, -O3", c, "ns"),
        ("step over C, median of pairs", ratio, "x"),
        ("step, one sample a call", one_at_a_time() * 1e-3, "us"),
        ("fix linearised", linearise * 1e-3, "us"),
        ("update of three rows", update * 1e-3, "us"),
    ]


if __name__ == "__main__":
    for name, value, unit in measure():
        print(f"{name:48}  {value:9.2f} {unit}")
