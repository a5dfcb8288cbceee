"""One filter over one run: the solution against the truth, second by second."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gateway.config import Config
from gateway.fusion import initial
from gateway.fusion.errors import ErrorDefinition
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.recording import RecordingFilter
from gateway.fusion.smoother import between, smooth
from gateway.fusion.state import N_FULL, State
from gateway.messages import Fix, Innovation, Verdict
from gateway.order import Refusal
from gateway.studies.errors import Measured
from gateway.studies.voyage import EPOCH_S, Voyage
from gateway.timeline import Timeline

Array = NDArray[np.float64]
Engine = TypeVar("Engine", bound=Filter)

Choices = Mapping[str, str | float]
"""Keys of the configuration's filter block with other values."""

NEES_EVERY = 10
"""Epochs from one NEES to the next."""

NORTH, EAST, DOWN, HEADING = 0, 1, 2, 8
"""Columns of the errors of a passage; 3..5 are the velocity, 6..8 the attitude."""


@dataclass(frozen=True)
class Passage:
    """Errors (estimate minus truth) of one filter in one run.

    Attributes
    ----------
    error_n, sigma_n
        (m, 9) position (m), velocity (m/s) and attitude (rotation vector, rad) in NED axes at the
        epochs, and the filter's own standard deviation of each.
    nees
        (q,) normalised error squared of all ``n_states``, in the filter's own error definition.
    nis, dof
        (k,) normalised innovation squared of every fix, and how many rows it had.
    """

    error_n: Array
    sigma_n: Array
    nees: Array
    n_states: int
    nis: Array
    dof: Array


def configured(config: Config, first: Measured, **choices: str | float) -> Filter:
    """The filter of a configuration with some of its choices replaced, at a run's first state."""
    return _engine(Filter, config, first, choices)


def _engine(kind: type[Engine], config: Config, first: Measured, choices: Choices) -> Engine:
    chosen = msgspec.structs.replace(
        config, filter=msgspec.structs.replace(config.filter, **choices), initial=first.initial
    )
    return kind(initial.model(chosen), Memory(initial.initial_state(chosen)))


def sail(voyage: Voyage, measured: Measured, engine: Filter, aided: bool = True) -> Passage:
    """Drive a filter over a run through the gateway's own timeline.

    Parameters
    ----------
    aided
        Whether the filter gets the fixes.
    """
    rate_hz = voyage.imu[1].rate_hz
    timeline = Timeline(engine, rate_hz, voyage.config.filter.history_s, EPOCH_S, slice_=None)
    told = _by_epoch(measured) if aided else {}
    step = round(EPOCH_S * rate_hz)
    m = len(voyage.truth.t_s)
    means = np.empty((m, len(engine.memory.state.x)))
    variances = np.empty((m, 9, 9))
    nees: list[float] = []
    verdicts: list[Verdict] = []
    for k in range(m):
        for fix in told.get(k, ()):
            taken = timeline.insert(fix, fix.t_ns, repr(fix))
            assert not isinstance(taken, Refusal), f"{fix}: {taken}"
            verdicts += taken
        state = engine.memory.state
        means[k], variances[k] = state.x, state.P[:9, :9]
        if k % NEES_EVERY == 0:
            nees.append(
                normalised_error(
                    voyage, measured, state, engine.model.error, engine.origin_e, epoch=k
                )
            )
        part = slice(k * step, (k + 1) * step)
        verdicts += timeline.extend(voyage.t_ns[part], measured.rows[part])
    seen = [v for v in verdicts if isinstance(v, Innovation) and np.isfinite(v.nis)]
    error_n, sigma_n = _in_ned(voyage, means, variances)
    return Passage(
        error_n=error_n,
        sigma_n=sigma_n,
        nees=np.array(nees),
        n_states=len(engine.memory.state.columns),
        nis=np.array([v.nis for v in seen]),
        dof=np.array([float(len(v.components)) for v in seen]),
    )


def _by_epoch(measured: Measured) -> dict[int, list[Fix]]:
    """The fixes by the epoch before which a filter is told them."""
    if measured.told_ns is None:
        return {0: list(measured.fixes)}
    told: dict[int, list[Fix]] = defaultdict(list)
    epochs = np.ceil(1e-9 * measured.told_ns / EPOCH_S).astype(int).tolist()
    for epoch, fix in zip(epochs, measured.fixes, strict=True):
        told[epoch].append(fix)
    return told


def smoothed(voyage: Voyage, measured: Measured, **choices: str | float) -> Passage:
    """The same run looked back upon: every fix in its order, then the fixed-interval smoother."""
    engine = _engine(RecordingFilter, voyage.config, measured, choices)
    forward = sail(voyage, replace(measured, told_ns=None), engine)
    engine.close()
    step = round(EPOCH_S * voyage.imu[1].rate_hz)
    epochs = range(len(forward.error_n))
    states = between(engine, smooth(engine), [k * step for k in epochs])
    error_n, sigma_n = _in_ned(
        voyage, np.array([s.x for s in states]), np.array([s.P[:9, :9] for s in states])
    )
    nees = [
        normalised_error(voyage, measured, states[k], engine.model.error, engine.origin_e, epoch=k)
        for k in epochs[::NEES_EVERY]
    ]
    return replace(forward, error_n=error_n, sigma_n=sigma_n, nees=np.array(nees))


def normalised_error(
    voyage: Voyage,
    measured: Measured,
    state: State,
    error: ErrorDefinition,
    origin_e: Array,
    *,
    epoch: int,
) -> float:
    """NEES: xi^T P^-1 xi in the coordinates of the filter's error definition."""
    if not state.is_sound():
        return float("inf")
    xi = error.boxminus(state, true_state(voyage, measured, epoch, state), origin_e)
    T = np.eye(len(xi))
    T[:9, :9] = error.to_additive(state, origin_e)
    xi_additive = T @ xi
    return float(xi_additive @ np.linalg.solve(state.P, xi_additive))


def true_state(voyage: Voyage, measured: Measured, epoch: int, like: State) -> State:
    """The true pose and constants at an epoch, with the columns of another state."""
    truth = voyage.truth
    true = State.at(
        truth.C_eb[epoch], truth.v_eb_e[epoch], truth.r_e[epoch], np.zeros((N_FULL, N_FULL))
    )
    true.add_constants(measured.constants)
    return State(true.x, like.P, like.columns)


def _in_ned(voyage: Voyage, means: Array, variances: Array) -> tuple[Array, Array]:
    """Additive errors of the pose and their standard deviations, (m, 9) each."""
    truth = voyage.truth
    C_ne = np.swapaxes(truth.C_en, -1, -2)
    C_hat = means[:, :9].reshape(-1, 3, 3)
    turned = np.einsum("mij,mkj->mik", C_hat, truth.C_eb)
    phi = _rotation_vectors(turned)
    parts = (means[:, 12:15] - truth.r_e, means[:, 9:12] - truth.v_eb_e, phi)
    error = np.hstack([np.einsum("mij,mj->mi", C_ne, part) for part in parts])
    blocks = (slice(6, 9), slice(3, 6), slice(0, 3))
    variance = np.hstack(
        [np.einsum("mij,mjk,mik->mi", C_ne, variances[:, b, b], C_ne) for b in blocks]
    )
    return error, np.sqrt(np.maximum(variance, 0.0))


def _rotation_vectors(C: Array) -> Array:
    """(m, 3) of (m, 3, 3) rotations; a state that is no number has infinite ones."""
    phi = np.full((len(C), 3), np.inf)
    sound = np.isfinite(C).all(axis=(1, 2))
    phi[sound] = Rotation.from_matrix(C[sound]).as_rotvec()
    return phi
