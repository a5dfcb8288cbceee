"""The family of error definitions: each a `boxplus`, a `boxminus` and a map to the additive error.

The filter stores its covariance for the additive error and propagates it there; the chain rule
makes that the same as propagating in any other coordinates of the family (the map is taken at the
propagated mean before and after). What tells the definitions apart is the update: covariance and
measurement matrix are mapped, the correction is applied by `boxplus`, and the covariance is mapped
back at the *corrected* mean.  # (M.20)-(M.24)

error = estimate [-] truth:

=================  ===============================================================================
additive           ``C^ = Exp(phi) C``, ``v^ = v + dv``, ``r^ = r + dr``
left_invariant     ``X^ = X Exp(xi)``:  ``C^ = C Exp(phi)``, ``C^T (v^ - v) = J(phi) dv``
right_invariant    ``X^ = Exp(xi) X``:  ``C^ = Exp(phi) C``, ``v^ - Exp(phi) v = J(phi) dv``
=================  ===============================================================================

with r relative to a fixed local origin, so that the lever of phi stays short.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.state import ATT, N_STATES, POS, VEL, State
from gateway.nav.lie import exp_so3, left_jacobian, log_so3, orthonormal, skew

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ErrorDefinition:
    """One way to write the error of attitude, velocity and position; constants are additive in all.

    Attributes
    ----------
    to_additive
        ``(state, origin_e) -> (9, 9)`` matrix T with ``xi_additive = T xi`` to first order.
    retract
        ``(state, xi, origin_e)``: pose <- pose [+] xi in place, `xi` (9,).
    difference
        ``(y, x, origin_e) -> (9,)``: y [-] x, the inverse of `retract`.
    """

    name: str
    to_additive: Callable[[State, Array], Array]
    retract: Callable[[State, Array, Array], None]
    difference: Callable[[State, State, Array], Array]

    def boxplus(self, x: State, xi: Array, origin_e: Array) -> State:
        """x [+] xi as a new state; `xi` (21,)."""
        y = x.copy()
        self.retract(y, xi[:9], origin_e)
        y.x[0:9] = orthonormal(y.C_eb).ravel()
        y.add_constants(xi[9:])
        return y

    def boxminus(self, y: State, x: State, origin_e: Array) -> Array:
        """Give the (21,) error ``xi`` with ``x [+] xi == y``."""
        xi = np.empty(N_STATES)
        xi[:9] = self.difference(y, x, origin_e)
        xi[9:] = y.constants - x.constants
        return xi


def _additive_map(state: State, origin_e: Array) -> Array:
    return np.eye(9)


def _additive_retract(state: State, xi: Array, origin_e: Array) -> None:
    state.C_eb[:] = exp_so3(xi[ATT]) @ state.C_eb
    state.v_eb_e[:] += xi[VEL]
    state.r_e[:] += xi[POS]


def _additive_difference(y: State, x: State, origin_e: Array) -> Array:
    return np.concatenate([log_so3(y.C_eb @ x.C_eb.T), y.v_eb_e - x.v_eb_e, y.r_e - x.r_e])


def _left_map(state: State, origin_e: Array) -> Array:
    return np.asarray(np.kron(np.eye(3), state.C_eb))


def _left_retract(state: State, xi: Array, origin_e: Array) -> None:
    CJ = state.C_eb @ left_jacobian(xi[ATT])
    state.v_eb_e[:] += CJ @ xi[VEL]
    state.r_e[:] += CJ @ xi[POS]
    state.C_eb[:] = state.C_eb @ exp_so3(xi[ATT])


def _left_difference(y: State, x: State, origin_e: Array) -> Array:
    phi = log_so3(x.C_eb.T @ y.C_eb)
    back = np.linalg.inv(left_jacobian(phi)) @ x.C_eb.T
    return np.concatenate([phi, back @ (y.v_eb_e - x.v_eb_e), back @ (y.r_e - x.r_e)])


def _right_map(state: State, origin_e: Array) -> Array:
    T = np.eye(9)
    T[VEL, ATT] = -skew(state.v_eb_e)
    T[POS, ATT] = -skew(state.r_e - origin_e)
    return T


def _right_retract(state: State, xi: Array, origin_e: Array) -> None:
    E, J = exp_so3(xi[ATT]), left_jacobian(xi[ATT])
    state.v_eb_e[:] = E @ state.v_eb_e + J @ xi[VEL]
    state.r_e[:] = origin_e + E @ (state.r_e - origin_e) + J @ xi[POS]
    state.C_eb[:] = E @ state.C_eb


def _right_difference(y: State, x: State, origin_e: Array) -> Array:
    E = y.C_eb @ x.C_eb.T
    phi = log_so3(E)
    back = np.linalg.inv(left_jacobian(phi))
    dv = back @ (y.v_eb_e - E @ x.v_eb_e)
    dr = back @ ((y.r_e - origin_e) - E @ (x.r_e - origin_e))
    return np.concatenate([phi, dv, dr])


FAMILY = {
    definition.name: definition
    for definition in (
        ErrorDefinition("additive", _additive_map, _additive_retract, _additive_difference),
        ErrorDefinition("left_invariant", _left_map, _left_retract, _left_difference),
        ErrorDefinition("right_invariant", _right_map, _right_retract, _right_difference),
    )
}
