"""Random navigation states, and derivatives by central differences through a boxplus."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from gateway.fusion.errors import FAMILY, ErrorDefinition
from gateway.fusion.memory import Memory
from gateway.fusion.state import ATT, BA, BG, LATENCY, LEVER, N_FULL, POS, VEL, State
from gateway.nav import earth, strapdown
from gateway.nav.lie import log_so3

ORIGIN = earth.lla_to_ecef(np.radians(45.0), np.radians(126.0), -20.0)
NAMES = sorted(FAMILY)

STEPS = np.full(N_FULL, 1e-4)
"""Steps of the differences: far above the rounding of Earth-fixed metres (1 nm)."""
STEPS[ATT], STEPS[VEL], STEPS[POS] = 1e-3, 1.0, 0.1
STEPS[BG], STEPS[BA], STEPS[LEVER], STEPS[LATENCY] = 1e-2, 1e-2, 0.1, 3e-3


def random_state(rng: np.random.Generator, spread_m: float = 300.0) -> State:
    """Any attitude, 10 m/s, hundreds of metres from `ORIGIN`, constants that are not small."""
    C = Rotation.random(rng=rng).as_matrix()
    r = ORIGIN + rng.normal(0.0, spread_m, 3)
    state = State.at(C, rng.normal(0.0, 10.0, 3), r, np.eye(N_FULL))
    state.s_e[:] = rng.normal(0.0, 100.0, 3)
    state.chain[:] = Rotation.random(rng=rng).as_matrix()
    state.x[strapdown.LAST] = (0.01, *rng.normal(0.0, 0.005, 3), *rng.normal(0.0, 0.05, 3))
    sigma = np.repeat([1e-4, 0.01, 0.3, 0.05, 0.02, 1.0, 0.02], [3, 3, 3, 2, 1, 3, 1])
    state.add_constants(rng.normal(0.0, sigma))
    return state


def error_map(definition: ErrorDefinition, state: State) -> np.ndarray:
    """(25, 25) matrix T with additive error = T xi."""
    T = np.eye(N_FULL)
    T[:9, :9] = definition.to_additive(state, ORIGIN)
    return T


def derivative(
    h: Callable[[State], np.ndarray],
    state: State,
    definition: ErrorDefinition,
    steps: np.ndarray = STEPS,
) -> np.ndarray:
    """(m, 25) derivative of `h` by the error of `definition`, fourth-order differences."""
    columns = []
    for i, step in enumerate(steps):
        xi = np.zeros(N_FULL)

        def at(k: float, xi=xi, i=i, step=step) -> np.ndarray:
            xi[i] = k * step
            return np.asarray(h(definition.boxplus(state, xi, ORIGIN)))

        columns.append((8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * step))
    return np.column_stack(columns)


def same_memory(memory: Memory, reference: Memory) -> None:
    """Assert that two filters are in one state, to rounding, and have counted the same."""
    a, b = memory.state, reference.state
    np.testing.assert_allclose(a.r_e, b.r_e, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(a.v_eb_e, b.v_eb_e, rtol=0.0, atol=1e-12)
    assert np.linalg.norm(log_so3(a.C_eb @ b.C_eb.T)) < 1e-12
    np.testing.assert_allclose(a.constants, b.constants, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(a.P, b.P, rtol=1e-9, atol=1e-18)
    assert (memory.used, memory.gated) == (reference.used, reference.gated)
    assert memory.t_used_ns == reference.t_used_ns
