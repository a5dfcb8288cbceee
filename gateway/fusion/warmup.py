"""Every compiled function that a running filter may call, called once: nothing waits for it later.

The smoother's own are left out: it runs over what is past already.
"""

import numpy as np

from gateway.fusion import usbl
from gateway.fusion.errors import FAMILY
from gateway.fusion.kalman import update
from gateway.fusion.ranging import Past
from gateway.fusion.report import solution
from gateway.fusion.state import N_STATES, State
from gateway.fusion.window import attitudes
from gateway.modes import Mode
from gateway.nav import strapdown
from gateway.nav.lie import exp_so3, left_jacobian


def warm_up() -> None:
    """Compile all of it, or load it from the cache."""
    state = State.at(np.eye(3), np.zeros(3), np.array([6.4e6, 0.0, 0.0]), np.eye(N_STATES))
    rows, track, q = np.zeros((1, 8)), np.zeros((1, 12)), np.zeros(4)
    rows[:, 0] = 0.005
    strapdown.run(state.x, state.P, rows, q, track)
    strapdown.advance(state.x, state.P, rows[0], 0.0, 1.0, q)
    strapdown.gravity_e((6.4e6, 0.0, 0.0))
    state.is_sound()
    solution(state, 0, Mode.ALIGNING, None, 0, 0)
    attitudes(rows)
    exp_so3(np.zeros(3))
    left_jacobian(np.zeros(3))
    _use_a_fix(state)


def _use_a_fix(state: State) -> None:
    """With angles and without, in each definition's coordinates."""
    beacon_e, past = state.r_e + 100.0, Past(np.zeros(3), np.eye(3), 0.1)
    for measured in (
        np.full(3, 0.5),
        np.array([0.5, np.nan, 0.5]),
        np.array([np.nan, np.nan, 0.5]),
    ):
        sight = usbl.Sighting(measured, np.ones(3), beacon_e, past)
        z = usbl.linearise(state, usbl.ArrayGeometry(np.zeros(3), np.eye(3)), sight)
        assert z is not None
        for error in FAMILY.values():
            update(state.copy(), z, error, state.r_e.copy())
            error.to_additive(state, state.r_e.copy())
            error.boxplus(state, np.zeros(N_STATES), state.r_e.copy())
