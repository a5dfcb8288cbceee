"""The filter's state: the mean as one vector, the additive covariance, and their names."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gateway.nav import strapdown as sd
from gateway.nav.lie import exp_so3

Array = NDArray[np.float64]

ATT, VEL, POS = slice(0, 3), slice(3, 6), slice(6, 9)
BG, BA = slice(9, 12), slice(12, 15)
THETA, DALPHA, DBETA, DKD = slice(15, 18), 18, 19, 20
N_STATES = 21
"""Error states: [phi_e, dv_e, dr_e, db_g, db_a, theta_b, dalpha, dbeta, dKd] (seed 000, eq. 7)."""

_N_CONSTANTS = N_STATES - sd.N_CORE


@dataclass(slots=True)
class State:
    """Mean and covariance.

    Attributes
    ----------
    x
        (46,) mean: `gateway.nav.strapdown`'s vector, then theta (3), dalpha, dbeta, dKd.
    P
        (21, 21) covariance of the additive error, estimate minus truth.
    """

    x: Array
    P: Array

    @classmethod
    def at(cls, C_eb: Array, v_eb_e: Array, r_e: Array, P: Array) -> Self:
        """Make the state of a known pose with all constants at zero."""
        x = np.zeros(sd.N_MEAN + _N_CONSTANTS)
        x[sd.C_EB] = x[sd.CHAIN] = C_eb.ravel()
        x[sd.V_EB_E] = v_eb_e
        x[sd.R_E] = r_e
        return cls(x, P.copy())

    def copy(self) -> Self:
        """Make a snapshot that further steps leave alone."""
        return type(self)(self.x.copy(), self.P.copy())

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
    def chain(self) -> Array:
        """(3, 3) view: attitude propagated without feedback."""
        return self.x[sd.CHAIN].reshape(3, 3)

    @property
    def s_e(self) -> Array:
        """(3,) view: integral of the velocity, m."""
        return self.x[sd.S_E]

    @property
    def constants(self) -> Array:
        """(12,) copy: gyro and accelerometer bias, theta, dalpha, dbeta, dKd."""
        return np.concatenate([self.x[15:21], self.x[sd.N_MEAN :]])

    @property
    def theta(self) -> Array:
        """(3,) view: mounting error of the array, rotation vector in body axes (rad)."""
        return self.x[sd.N_MEAN : sd.N_MEAN + 3]

    @property
    def C_theta(self) -> Array:
        """(3, 3) Exp(theta): turns the nominally mounted array into the estimated one."""
        return exp_so3(self.theta)

    @property
    def angle_offsets(self) -> Array:
        """(2,) view: offsets of elevation and bearing (rad)."""
        return self.x[sd.N_MEAN + 3 : sd.N_MEAN + 5]

    @property
    def range_scale(self) -> float:
        """Relative error of the range scale: measured = true (1 + dKd)."""
        return float(self.x[sd.N_MEAN + 5])

    def add_constants(self, delta: Array) -> None:
        """Add a correction (12,) to biases and acoustic constants, in the order of `constants`."""
        self.x[15:21] += delta[:6]
        self.x[sd.N_MEAN :] += delta[6:]

    def is_sound(self) -> bool:
        """Whether every number is finite and no variance negative."""
        return bool(
            np.isfinite(self.x).all()
            and np.isfinite(self.P).all()
            and (self.P.diagonal() >= 0).all()
        )
