"""The filter's state: the mean as one vector, the additive covariance, and their names.

The full error state has 25 components; a filter carries those it is asked to estimate. What it does
not estimate stands in the mean at its nominal value and has no column in the covariance.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gateway.nav import strapdown as sd
from gateway.nav.compiled import compiled
from gateway.nav.covariance import N_CORE
from gateway.nav.lie import exp_so3

Array = NDArray[np.float64]
Columns = NDArray[np.int64]

ATT, VEL, POS = slice(0, 3), slice(3, 6), slice(6, 9)
BG, BA = slice(9, 12), slice(12, 15)
THETA, DALPHA, DBETA, DKD = slice(15, 18), 18, 19, 20
LEVER, LATENCY = slice(21, 24), 24
N_STATES = 21
"""The states of seed 000, eq. 7: [phi_e, dv_e, dr_e, db_g, db_a, theta_b, dalpha, dbeta, dKd]."""
N_FULL = 25
"""With the error of the lever arm (b, m) and of the acoustic latency (s)."""

N_MEAN = sd.N_MEAN + N_FULL - N_CORE
"""Length of the mean."""

_THETA = sd.N_MEAN
_ALPHA, _BETA, _KD = _THETA + 3, _THETA + 4, _THETA + 5
_LEVER, _LATENCY = slice(_THETA + 6, _THETA + 9), _THETA + 9
_IN_MEAN = np.concatenate([np.arange(15, 21), np.arange(sd.N_MEAN, N_MEAN)])
"""Where in the mean the full error's components 9..24 stand."""


@compiled
def _is_sound(x: Array, P: Array) -> bool:
    for value in x:
        if not math.isfinite(value):
            return False
    for i in range(P.shape[0]):
        if P[i, i] < 0.0:
            return False
        for j in range(P.shape[1]):
            if not math.isfinite(P[i, j]):
                return False
    return True


@compiled
def add_constants(x: Array, columns: Columns, delta: Array) -> None:
    """Add a correction (n - 9,) to the constants of the mean `x` that `columns` (n,) names."""
    for k in range(len(delta)):
        x[_IN_MEAN[columns[9 + k] - 9]] += delta[k]


@dataclass(slots=True)
class State:
    """Mean and covariance.

    Attributes
    ----------
    x
        (50,) mean: `gateway.nav.strapdown`'s vector, then theta (3), dalpha, dbeta, dKd, lever arm
        (3), latency.
    P
        (n, n) covariance of the additive error, estimate minus truth.
    columns
        (n,) which components of the full error the covariance holds, ascending; 0..14 always.
    """

    x: Array
    P: Array
    columns: Columns

    @classmethod
    def at(
        cls, C_eb: Array, v_eb_e: Array, r_e: Array, P: Array, columns: Columns | None = None
    ) -> Self:
        """Make the state of a known pose with all constants at zero.

        Without `columns` the covariance holds the first components of the full error.
        """
        x = np.zeros(N_MEAN)
        x[sd.C_EB] = x[sd.CHAIN] = C_eb.ravel()
        x[sd.V_EB_E] = v_eb_e
        x[sd.R_E] = r_e
        return cls(x, P.copy(), np.arange(len(P)) if columns is None else columns)

    def copy(self) -> Self:
        """Make a snapshot that further steps leave alone."""
        return type(self)(self.x.copy(), self.P.copy(), self.columns)

    @property
    def C_eb(self) -> Array:
        """(3, 3) view, body to ECEF."""
        return self.x[sd.C_EB].reshape(3, 3)

    @property
    def v_eb_e(self) -> Array:
        """(3,) view, m/s."""
        return self.x[sd.V_EB_E]

    @property
    def r_e(self) -> Array:
        """(3,) view, m."""
        return self.x[sd.R_E]

    @property
    def b_g(self) -> Array:
        """(3,) view: gyro bias, rad/s."""
        return self.x[sd.B_G]

    @property
    def b_a(self) -> Array:
        """(3,) view: accelerometer bias, m/s^2."""
        return self.x[sd.B_A]

    @property
    def chain(self) -> Array:
        """(3, 3) view: attitude propagated without feedback."""
        return self.x[sd.CHAIN].reshape(3, 3)

    @property
    def s_e(self) -> Array:
        """(3,) view: integral of the velocity, m."""
        return self.x[sd.S_E]

    @property
    def theta(self) -> Array:
        """(3,) view: mounting error of the array, rotation vector in body axes (rad)."""
        return self.x[_THETA : _THETA + 3]

    @property
    def C_theta(self) -> Array:
        """(3, 3) Exp(theta): turns the nominally mounted array into the estimated one."""
        return exp_so3(self.theta)

    @property
    def angle_offsets(self) -> Array:
        """(2,) view: offsets of elevation and bearing (rad)."""
        return self.x[_ALPHA : _BETA + 1]

    @property
    def range_scale(self) -> float:
        """Relative error of the range scale: measured = true (1 + dKd)."""
        return float(self.x[_KD])

    @property
    def lever_b(self) -> Array:
        """(3,) view: what the array's lever arm exceeds its nominal value by, body axes (m)."""
        return self.x[_LEVER]

    @property
    def latency_s(self) -> float:
        """What the acoustic latency exceeds its declared value by (s)."""
        return float(self.x[_LATENCY])

    @property
    def constants(self) -> Array:
        """(n - 9,) copy: the estimated constants, from the gyro bias on."""
        estimated: Array = self.x[_IN_MEAN[self.columns[9:] - 9]]
        return estimated

    def add_constants(self, delta: Array) -> None:
        """Add a correction (n - 9,) to the estimated constants."""
        add_constants(self.x, self.columns, delta)

    def is_sound(self) -> bool:
        """Whether every number is finite and no variance negative."""
        return bool(_is_sound(self.x, self.P))
