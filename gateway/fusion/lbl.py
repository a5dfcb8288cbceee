"""One slant range of a long baseline, with the vehicle's motion while the sound was on its way.

Seed 001 uses all replies to a ping when the last one is in. Here each is a measurement of its own
at its own reception, with the transmission they share: the timeline puts it in its place whenever
the sentence arrives.  # (M.44), (M.45), (M.72)

A range is a circle, which its derivative takes for a straight line: what that leaves out counts as
noise, so that a first position 200 m off is not believed to 2 m.  # (M.150)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised
from gateway.fusion.kinematics import add_latency, earlier
from gateway.fusion.ranging import Past, range_row
from gateway.fusion.state import N_FULL, POS, State

Array = NDArray[np.float64]


class Reply(NamedTuple):
    """A measured slant range (m), its noise, the (3,) beacon, and where the array was at the ping.

    ``transmit`` is None for a one-way range.
    """

    slant_range: float
    sigma: float
    beacon_e: Array
    transmit: Past | None


def linearise(state: State, lever_b: Array, reply: Reply) -> Linearised:
    """Predict a range at its reception; `lever_b` (3,) nominal, from the IMU to the transducer."""
    state, omega_e = earlier(state)
    H = np.zeros((1, N_FULL))
    h = range_row(state, lever_b + state.lever_b, reply.beacon_e, reply.transmit, H[0])
    add_latency(state, omega_e, H)
    return Linearised(
        np.array([h - reply.slant_range]),
        np.ascontiguousarray(H[:, state.columns]),
        np.array([[reply.sigma**2 + _bend(state, H[0, POS], h)]]),
        ("range_m",),
    )


def _bend(state: State, u: Array, distance: float) -> float:
    """Mean square of the range's second order under the present uncertainty (m^2).  # (M.150)

    Half of xi^T A xi with ``A = (I - u u^T) / distance``: mean tr(AP)/2, variance tr(APAP)/2.
    """
    AP = (np.eye(3) - np.outer(u, u)) / distance @ state.P[POS, POS]
    return float(0.25 * np.trace(AP) ** 2 + 0.5 * np.trace(AP @ AP))
