"""Fixed-interval smoother: Rauch-Tung-Striebel over a recorded forward pass, in the filter's error.

The recursion of Rauch, Tung and Striebel (AIAA J. 3(8), 1965) on the error state. The forward
filter feeds its corrections back, so that its mean jumps; therefore what is smoothed is not an
error estimate but the error of the stored means, ``xi = predicted [-] smoothed``, in the
definition in which the filter updates. For the invariant ones that is the smoother of van der
Laan, Cohen, Arsenault and Forbes (IEEE RA-L 5(4), 2020).  # (M.100)-(M.107)
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from gateway.fusion.errors import FAMILY, ErrorDefinition, from_additive
from gateway.fusion.recording import Knot, RecordingFilter
from gateway.fusion.state import State
from gateway.nav import strapdown
from gateway.nav.covariance import N_CORE

Array = NDArray[np.float64]

ROUNDING = 1e-12
"""Added to the diagonal of a correlation matrix that rounding has made indefinite."""
NOWHERE = np.zeros(3)
"""The additive error asks for no origin."""


def smooth(
    recording: RecordingFilter, tell: Callable[[float], object] = lambda _share: None
) -> list[State]:
    """Smoothed state at each knot of a forward pass that lost its soundness nowhere.

    Parameters
    ----------
    recording
        The forward pass.
    tell
        Is told which share of the knots is done.
    """
    knots, error, origin_e = recording.knots, recording.model.error, recording.origin_e
    last = knots[-1].after
    states = [last]
    T_inv = _inverse_map(error, last, origin_e)
    S = T_inv @ last.P @ T_inv.T
    for k in range(len(knots) - 2, -1, -1):
        state, S = _step(knots[k].after, knots[k + 1], states[-1], S, error, origin_e)
        states.append(state)
        tell(len(states) / len(knots))
    return states[::-1]


def between(recording: RecordingFilter, states: Sequence[State], at: Sequence[int]) -> list[State]:
    """Smoothed states after whole numbers of samples, between the knots too.

    From a knot the strapdown goes on with the smoothed mean; what is missing at the next one is
    process noise that the smoother knows, and is dealt out evenly on the way.  # (M.107)

    Parameters
    ----------
    recording
        The forward pass.
    states
        Its smoothed knots.
    at
        Samples consumed, ascending, none beyond the last knot.
    """
    rows, knots = recording.rows, recording.knots
    found: list[State] = []
    for k, state in enumerate(states):
        here = knots[k].position
        found += [state] * (bisect_right(at, here) - len(found))
        if k + 1 == len(states):
            break
        there = knots[k + 1].position
        inside = at[len(found) : bisect_left(at, there)]
        if inside:
            carried = _carry(state, rows, here, [*inside, there])
            found += _interpolate(state, states[k + 1], carried)
    return found


def _step(
    post: State, following: Knot, smoothed: State, S: Array, error: ErrorDefinition, origin_e: Array
) -> tuple[State, Array]:
    """One step back: state and covariance (in the error's own coordinates) at ``post``."""
    prior = following.before
    to_k, to_p = _inverse_map(error, post, origin_e), _inverse_map(error, prior, origin_e)
    T_k = np.eye(len(post.P))
    T_k[:9, :9] = error.to_additive(post, origin_e)
    Phi = to_p @ following.Phi @ T_k  # (M.101)
    P_k, P_p = to_k @ post.P @ to_k.T, to_p @ prior.P @ to_p.T
    G = _gain(P_k, Phi, P_p)
    xi = error.boxminus(prior, smoothed, origin_e)  # (M.103)
    state = error.boxplus(post, -(G @ xi), origin_e)  # (M.104)
    A = np.eye(len(G)) - G @ Phi
    Q = P_p - Phi @ P_k @ Phi.T
    S = A @ P_k @ A.T + G @ (S + Q) @ G.T  # (M.105)
    S = 0.5 * (S + S.T)
    T = np.eye(len(G))
    T[:9, :9] = error.to_additive(state, origin_e)
    state.P = T @ S @ T.T
    return state, S


def _gain(P: Array, Phi: Array, P_p: Array) -> Array:
    """G = P Phi^T P_p^-1, by Cholesky of the correlations: the states' scales differ by 10^8.

    # (M.102)
    """
    sd = np.sqrt(P_p.diagonal())
    sd[sd == 0.0] = 1.0  # a state known for certain has no row but its zeros
    R = P_p / np.outer(sd, sd)
    np.fill_diagonal(R, 1.0)
    try:
        factor = scipy.linalg.cho_factor(R, lower=True)
    except np.linalg.LinAlgError:
        factor = scipy.linalg.cho_factor(R + ROUNDING * np.eye(len(R)), lower=True)
    G: Array = scipy.linalg.cho_solve(factor, (Phi @ P) / sd[:, None]).T / sd
    return G


def _inverse_map(error: ErrorDefinition, state: State, origin_e: Array) -> Array:
    """(n, n) matrix that takes the additive error to the definition's."""
    T = np.eye(len(state.P))
    T[:9, :9] = from_additive(error.kind, state.x, origin_e)
    return T


def _carry(
    state: State, rows: Array, begin: float, stops: Sequence[float]
) -> list[tuple[Array, float]]:
    """Mean at each of the stops, carried from `begin`, and the seconds to it."""
    x, P, q = state.x.copy(), np.zeros((N_CORE, N_CORE)), np.zeros(4)
    track = np.empty((len(rows[int(begin) : int(stops[-1]) + 1]), 12))
    found, here, elapsed_s = [], begin, 0.0
    for stop in stops:
        while here < stop:
            k, share = int(here), here % 1.0
            if share == 0.0 and stop >= k + 1:
                whole = rows[k : int(stop)]
                strapdown.run(x, P, whole, q, track[: len(whole)])
                elapsed_s += float(whole[:, 0].sum())
                here = float(int(stop))
            else:
                end = min(1.0, stop - k)
                strapdown.advance(x, P, rows[k], share, end, q)
                elapsed_s += (end - share) * float(rows[k, 0])
                here = k + end
        found.append((x.copy(), elapsed_s))
    return found


def _interpolate(one: State, other: State, carried: list[tuple[Array, float]]) -> list[State]:
    """States between two knots from the means carried to them and, the last, to the other knot."""
    additive = FAMILY["additive"]
    *inside, (x_end, span_s) = carried
    missing = additive.boxminus(other, State(x_end, other.P, other.columns), NOWHERE)
    found = []
    for x, elapsed_s in inside:
        f = elapsed_s / span_s
        P = (1.0 - f) * one.P + f * other.P
        found.append(additive.boxplus(State(x, P, one.columns), f * missing, NOWHERE))
    return found
