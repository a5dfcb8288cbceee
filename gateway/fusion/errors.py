"""The family of error definitions: each a `boxplus`, a `boxminus` and a map to the additive error.

error = estimate [-] truth:

=================  ===============================================================================
additive           ``C^ = Exp(phi) C``, ``v^ = v + dv``, ``r^ = r + dr``
left_invariant     ``X^ = X Exp(xi)``:  ``C^ = C Exp(phi)``, ``C^T (v^ - v) = J(phi) dv``
right_invariant    ``X^ = Exp(xi) X``:  ``C^ = Exp(phi) C``, ``v^ - Exp(phi) v = J(phi) dv``
=================  ===============================================================================

with r relative to a fixed local origin, so that the lever of phi stays short.

The filter keeps its covariance for the additive error and propagates it there; by the chain rule
that is the same as propagating it in any other coordinates of the family. What tells the
definitions apart is the update: the correction is applied by the definition's own boxplus, and the
covariance is *carried* with the mean, ``P <- X P X^T`` with ``X = T(after) T(before)^-1``, because
it is the definition's error, not the additive one, that stays the same.  # (M.20)-(M.24)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.state import ATT, POS, VEL, State
from gateway.nav.compiled import compiled
from gateway.nav.lie import exp_so3, left_jacobian, log_so3, orthonormal, skew

Array = NDArray[np.float64]

ADDITIVE, LEFT, RIGHT = 0, 1, 2


@compiled
def to_additive(kind: int, x: Array, origin_e: Array) -> Array:
    """(9, 9) matrix T with ``xi_additive = T xi`` to first order.  # (M.21)"""
    T = np.eye(9)
    if kind == LEFT:
        for b in range(3):
            for i in range(3):
                for j in range(3):
                    T[3 * b + i, 3 * b + j] = x[3 * i + j]
    elif kind == RIGHT:
        T[3:6, 0:3] = -skew(x[9:12])
        T[6:9, 0:3] = -skew(x[12:15] - origin_e)
    return T


@compiled
def from_additive(kind: int, x: Array, origin_e: Array) -> Array:
    """(9, 9) inverse of `to_additive`."""
    T = to_additive(kind, x, origin_e)
    if kind == LEFT:
        return T.T.copy()
    if kind == RIGHT:
        T[3:9, 0:3] *= -1.0
    return T


@compiled
def retract(kind: int, x: Array, xi: Array, origin_e: Array) -> None:
    """Pose of the mean `x` <- pose [+] xi, in place; `xi` (9,).  # (M.20), (M.22)"""
    C = x[0:9].copy().reshape(3, 3)
    E, J = exp_so3(xi[0:3]), left_jacobian(xi[0:3])
    v, r = x[9:12], x[12:15]
    if kind == ADDITIVE:
        v += xi[3:6]
        r += xi[6:9]
    elif kind == LEFT:
        CJ = C @ J
        v += CJ @ np.ascontiguousarray(xi[3:6])
        r += CJ @ np.ascontiguousarray(xi[6:9])
    else:
        v[:] = E @ v.copy() + J @ np.ascontiguousarray(xi[3:6])
        r[:] = origin_e + E @ (r - origin_e) + J @ np.ascontiguousarray(xi[6:9])
    turned = C @ E if kind == LEFT else E @ C
    x[0:9] = orthonormal(turned).ravel()


@dataclass(frozen=True)
class ErrorDefinition:
    """One way to write the error of attitude, velocity and position; constants are additive in all.

    ``kind`` selects the branch of the compiled functions of this module.
    """

    name: str
    kind: int

    def to_additive(self, state: State, origin_e: Array) -> Array:
        """(9, 9) matrix T with ``xi_additive = T xi`` to first order."""
        return to_additive(self.kind, state.x, origin_e)

    def boxplus(self, x: State, xi: Array, origin_e: Array) -> State:
        """x [+] xi as a new state; `xi` (n,)."""
        y = x.copy()
        retract(self.kind, y.x, xi[:9], origin_e)
        y.add_constants(xi[9:])
        return y

    def boxminus(self, y: State, x: State, origin_e: Array) -> Array:
        """Give the (n,) error ``xi`` with ``x [+] xi == y``."""
        return np.concatenate([self._difference(y, x, origin_e), y.constants - x.constants])

    def _difference(self, y: State, x: State, origin_e: Array) -> Array:
        xi = np.empty(9)
        E = x.C_eb.T @ y.C_eb if self.kind == LEFT else y.C_eb @ x.C_eb.T
        xi[ATT] = log_so3(E)
        dv, dr = y.v_eb_e - x.v_eb_e, y.r_e - x.r_e
        if self.kind == LEFT:
            into_b: Array = np.linalg.inv(left_jacobian(xi[ATT])) @ x.C_eb.T
            dv, dr = into_b @ dv, into_b @ dr
        elif self.kind == RIGHT:
            back = np.linalg.inv(left_jacobian(xi[ATT]))
            dv = back @ (y.v_eb_e - E @ x.v_eb_e)
            dr = back @ ((y.r_e - origin_e) - E @ (x.r_e - origin_e))
        xi[VEL], xi[POS] = dv, dr
        return xi


FAMILY = {
    definition.name: definition
    for definition in (
        ErrorDefinition("additive", ADDITIVE),
        ErrorDefinition("left_invariant", LEFT),
        ErrorDefinition("right_invariant", RIGHT),
    )
}
