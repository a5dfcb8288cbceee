"""What is left of a state after a time in which nothing was seen of the vehicle."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.fusion.state import ATT, BA, BG, POS, VEL
from gateway.messages import SavedState
from gateway.nav import strapdown as sd
from gateway.nav import transition
from gateway.nav.earth import C_en, ecef_to_lla

Array = NDArray[np.float64]

TURN = math.radians(10.0) ** 2
"""Density of an unseen turn (rad^2/s): 10 deg in a second, right about in three minutes."""
WANDER_S = 2.0 / TURN
"""Time in which such turns make a velocity forgotten (s)."""
WANDER_M_S = 1.0
"""What an unseen velocity then is, in each component; or as it was if faster."""
ANY_HEADING = math.pi**2 / 3.0
"""Variance of a heading that may be any (rad^2)."""
SWAY, SWAY_S = math.radians(5.0) ** 2, 3.0
"""Variance of an unseen level (rad^2), and the time in which a known one is forgotten (s)."""

LONG_ABSENCE_S = 10.0
"""Absence after which the attitude is better found anew; after less, the fixes mend it sooner."""


def inflate(saved: SavedState, away_s: float, q: Array) -> SavedState:
    """The state as it is worth `away_s` later.  # (M.135)-(M.138)

    The vehicle may have moved and turned unseen; what it had learnt of its instruments stays. No
    fix counts as used since, so that nothing is claimed before the next one.

    Parameters
    ----------
    saved
        Its times go on by `away_s`. A clock that began anew (another boot) is the caller's to set.
    q
        (4,) noise densities of the IMU, see `gateway.nav.covariance.predict`.
    """
    x = np.frombuffer(saved.x).copy()
    n = len(saved.columns) // 8
    P = np.frombuffer(saved.P).reshape(n, n).copy()
    forget(x, P, away_s)
    for biases, density in ((BG, q[2]), (BA, q[3])):
        P[biases, biases] += np.eye(3) * density * away_s
    x[sd.LAST] = 0.0  # no sample went before the next one
    return msgspec.structs.replace(
        saved,
        t_ns=saved.t_ns + round(away_s * 1e9),
        x=x.tobytes(),
        P=(0.5 * (P + P.T)).tobytes(),
        refused_in_a_row=0,
        t_used_ns=None,
        velocity_refused={},
        aided=False,
    )


def forget(x: Array, P: Array, away_s: float) -> None:
    """Let the pose in mean and covariance go on unseen, in place.  # (M.135)-(M.138)"""
    _wander(x, P, away_s)
    _turn(x, P, away_s)


def unseen_transition(away_s: float) -> Array:
    """Transition of the additive error, see `gateway.nav.transition.identity`.  # (M.135)"""
    Phi = transition.identity()
    Phi[VEL, VEL] *= math.exp(-away_s / WANDER_S)
    Phi[POS, VEL] = WANDER_S * -math.expm1(-away_s / WANDER_S) * np.eye(3)
    return Phi


def _wander(x: Array, P: Array, away_s: float) -> None:
    """Carry position and velocity as a Gauss-Markov velocity does.  # (M.135), (M.136)"""
    v, T = x[sd.V_EB_E], WANDER_S
    variance = max(WANDER_M_S**2, float(v @ v))
    left = math.exp(-away_s / T)
    way = T * -math.expm1(-away_s / T)
    x[sd.R_E] += way * v
    x[sd.V_EB_E] *= left
    Phi = transition.whole(unseen_transition(away_s), len(P))
    P[:] = Phi @ P @ Phi.T
    k = np.arange(3)
    P[VEL, VEL][k, k] += variance * (1.0 - left**2)
    P[POS, VEL][k, k] += variance * T * (1.0 - left) ** 2
    P[VEL, POS][k, k] += variance * T * (1.0 - left) ** 2
    square = 2.0 * away_s / T - 3.0 + 4.0 * left - left**2
    P[POS, POS][k, k] += variance * T**2 * max(square, 0.0)


def _turn(x: Array, P: Array, away_s: float) -> None:
    """Let heading and level be forgotten.  # (M.137), (M.138)"""
    lat, lon, _ = ecef_to_lla(x[sd.R_E])
    C = C_en(lat, lon)
    known = np.diagonal(C.T @ P[ATT, ATT] @ C)
    share = -np.expm1(-away_s * np.array([2.0 / SWAY_S, 2.0 / SWAY_S, TURN / ANY_HEADING]))
    unseen = np.maximum(np.array([SWAY, SWAY, ANY_HEADING]) - known, 0.0) * share
    P[ATT, ATT] += C @ np.diag(unseen) @ C.T
