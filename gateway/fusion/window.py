"""The samples of a while in axes that do not turn, in which sway and gravity come apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.nav.compiled import compiled
from gateway.nav.lie import exp_so3, skew

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Window:
    """The samples of a window in inertially fixed axes, about its middle.

    Attributes
    ----------
    tau
        (n + 1,) time from the middle sample, s.
    u
        (n + 1, 3) integral of specific force, in the body axes of the beginning, m/s.
    D_mid
        (3, 3) body axes of the middle sample in those of the beginning.
    turn
        (3,) mean rate, in the body axes of the beginning, rad/s.
    blind
        Sum of the cubes of the gaps over three, s^3.
    """

    tau: Array
    u: Array
    D_mid: Array
    turn: Array
    blind: float

    @property
    def span(self) -> float:
        """Length, s."""
        return float(self.tau[-1] - self.tau[0])

    def parabola(self, u: Array) -> tuple[Array, Array, Array]:
        """Slope and curvature at the middle, and what is left over.  # (M.121)"""
        x = self.tau / self.span
        basis = np.column_stack([np.ones_like(x), x, 0.5 * x * x])
        coefficients = np.linalg.lstsq(basis, u)[0]
        rest = u - basis @ coefficients
        return coefficients[1] / self.span, coefficients[2] / self.span**2, rest

    def displacement(self, rest: Array) -> Array:
        """(n + 1, 3) integral of `rest` about its mean, m."""
        step = 0.5 * np.diff(self.tau)[:, None] * (rest[1:] + rest[:-1])
        s = np.vstack([np.zeros((1, 3)), np.cumsum(step, axis=0)])
        return np.asarray(s - s.mean(axis=0))


class Sway:
    """What is left of the motion: rms of velocity (3,), and of horizontal displacement an axis."""

    def __init__(self, window: Window, rest: Array, C_ni: Array) -> None:
        self.velocity: Array = np.sqrt(np.mean((rest @ C_ni.T) ** 2, axis=0))
        s = window.displacement(rest) @ C_ni.T
        self.displacement = float(np.sqrt(np.mean(s[:, :2] ** 2)))


def carried(rows: Array) -> Window:
    """Samples in the axes of the window's beginning.  # (M.120)

    Parameters
    ----------
    rows
        (n, 8) samples, see `gateway.messages.ImuBlock`.
    """
    u, D, turned = np.zeros((len(rows) + 1, 3)), np.zeros((len(rows), 3, 3)), np.zeros(3)
    _carry_along(rows, u, D, turned)
    t = np.concatenate([[0.0], np.cumsum(rows[:, 0])])
    middle = int(np.argmin(np.abs(t[1:] - 0.5 * t[-1])))
    blind = float(np.sum((rows[:, 0] * (rows[:, 7] > 0.0)) ** 3)) / 3.0
    return Window(t - t[middle + 1], u, D[middle].copy(), turned / t[-1], blind)


def attitudes(rows: Array) -> Array:
    """(n, 3, 3) inertial attitude after each sample in the axes of the window's beginning."""
    u, D = np.zeros((len(rows) + 1, 3)), np.zeros((len(rows), 3, 3))
    _carry_along(rows, u, D, np.zeros(3))
    return D


@compiled
def _carry_along(rows: Array, u: Array, D: Array, turned: Array) -> None:
    """Fill velocity `u` (n + 1, 3), attitude `D` (n, 3, 3) and rotation `turned` (3,).

    With `skew`, for numba takes 5 s to compile `np.cross`.
    """
    C = np.eye(3)
    dth0, dvl0 = np.zeros(3), np.zeros(3)
    for k in range(rows.shape[0]):
        dth, dvl = rows[k, 1:4].copy(), rows[k, 4:7].copy()
        phi = dth + skew(dth0) @ dth / 12.0
        dv = dvl + 0.5 * skew(dth) @ dvl
        dv += (skew(dth0) @ dvl + skew(dvl0) @ dth) / 12.0
        u[k + 1] = u[k] + C @ dv
        turned += C @ phi
        C = C @ exp_so3(phi)
        D[k] = C
        dth0, dvl0 = dth, dvl
