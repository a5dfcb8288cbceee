"""How far a fix inside the gate is believed to have come by the direct path."""

import math

import numpy as np
import scipy.special
from numpy.typing import NDArray

from gateway.fusion.errors import ErrorDefinition
from gateway.fusion.state import State

Array = NDArray[np.float64]

CERTAIN = 0.99
"""From here on a fix is taken for what it says: two clean ones of three are, and cost nothing."""
WIDE = 30.0
"""Times the volume of the noise alone: a gate from here on lets all its share of echoes in."""


def passing(echoes: float, S: Array, R: Array) -> float:
    """Share of echoes among what passes a gate of innovation covariance S (m, m).  # (M.183)

    The fewer the narrower it is: little more than the noise R (m, m) where fixes come often, and
    echoes lie anywhere.
    """
    volume = math.sqrt(float(np.linalg.det(S) / np.linalg.det(R)))
    return echoes * min(1.0, volume / WIDE)


def directness(nis: float, rows: int, gate: float, echoes: float) -> float:
    """Probability that a fix of `rows` rows is no echo, by its normalised square.  # (M.183)

    Parameters
    ----------
    gate
        Probability inside the chi-squared gate.
    echoes
        Share of echoes among what passes it, which may lie anywhere in it.
    """
    edge = float(scipy.special.chdtri(rows, 1.0 - gate))
    half = 0.5 * rows
    clutter: float = echoes / (1.0 - echoes) * math.gamma(half + 1.0) * (2.0 / edge) ** half
    direct = math.exp(-0.5 * nis)
    return direct / (direct + clutter)


def mixed(
    prior: State, used: State, share: float, error: ErrorDefinition, origin_e: Array
) -> State:
    """Mean and covariance of what is so with probability `share`, else of the prior.  # (M.184)"""
    xi = error.boxminus(used, prior, origin_e)
    state = error.boxplus(prior, share * xi, origin_e)
    P = share * _own(used, error, origin_e) + (1.0 - share) * _own(prior, error, origin_e)
    P += share * (1.0 - share) * np.outer(xi, xi)
    T = _map(state, error, origin_e)
    P = T @ P @ T.T
    state.P[:] = 0.5 * (P + P.T)
    return state


def _own(state: State, error: ErrorDefinition, origin_e: Array) -> Array:
    """Covariance of the definition's own error."""
    T = np.linalg.inv(_map(state, error, origin_e))
    P: Array = T @ state.P @ T.T
    return P


def _map(state: State, error: ErrorDefinition, origin_e: Array) -> Array:
    """(n, n) matrix from the definition's error to the additive one."""
    T = np.eye(len(state.P))
    T[:9, :9] = error.to_additive(state, origin_e)
    return T
