"""Whether the vehicle can be moving as the inertial unit and the state together say.

The mean specific force of the last seconds, turned by the state's attitude and with gravity added,
is how fast the vehicle gains speed. A wrong unit, axes that are not the configured ones, or an
attitude that is lost show as more than any vehicle does, whatever its attitude; a dive, a wave or a
turn does not.  # (M.181)

Samples that all are longer, or shorter, than the time in which they came are of a unit with another
rate than the declared one: what is made of them is as wrong.

What is kept from second to second is of the samples alone: a filter that takes over from another
one judges the same.
"""

import numpy as np
from numpy.typing import NDArray

from gateway.fusion.state import State
from gateway.messages import Second, Vec3
from gateway.nav.lie import exp_so3
from gateway.nav.strapdown import gravity_e

Array = NDArray[np.float64]
Times = NDArray[np.int64]

MOST_M_S2 = 5.0
"""No vehicle that floats does this for `OVER` seconds; a fast boat in a hard turn comes near."""
OVER = 5
ENOUGH = 3
"""So many seconds tell, where there are no more."""
OTHER_RATE = 0.1
"""How much longer or shorter all samples may be than the time in which they came."""
NOTHING: Vec3 = (0.0, 0.0, 0.0)


class Credible:
    """Looks at the samples second by second.

    Parameters
    ----------
    seconds, is_credible, t_last_ns
        Those of an earlier one to go on from, and when its last sample ended.

    Attributes
    ----------
    seconds
        The newest `OVER` of them.
    is_credible
        What the last of them showed.
    """

    def __init__(
        self,
        seconds: tuple[Second, ...] = (),
        is_credible: bool = True,
        t_last_ns: int | None = None,
    ) -> None:
        self.seconds, self.is_credible = seconds, is_credible
        self._t_last_ns = t_last_ns
        self._span_s = self._told_s = 0.0
        self._passed_ns = 0
        self._turned, self._gained = NOTHING, NOTHING

    def pass_over(self) -> None:
        """Note that samples, or a time, are left out that nobody is to judge."""
        self._t_last_ns = None

    def add(self, t_ns: Times, rows: Array) -> None:
        """Take samples (n,), (n, 8), see `gateway.messages.ImuBlock`."""
        if not len(t_ns):
            return
        begins_ns = self._t_last_ns
        if begins_ns is None:
            begins_ns = int(t_ns[0]) - round(float(rows[0, 0]) * 1e9)
        self._t_last_ns = int(t_ns[-1])
        self._passed_ns += self._t_last_ns - begins_ns
        span_s, (a, b, c), (x, y, z) = self._span_s, self._turned, self._gained
        for dt, da, db, dc, dx, dy, dz, missing_s in rows.tolist():
            self._told_s += dt
            if not missing_s:  # one by one: sums must not depend on batches
                span_s, a, b, c = span_s + dt, a + da, b + db, c + dc
                x, y, z = x + dx, y + dy, z + dz
        self._span_s, self._turned, self._gained = span_s, (a, b, c), (x, y, z)

    def end_second(self, state: State) -> None:
        """Judge by the last seconds as seen from the state at their end."""
        if self._span_s > 0.0:
            x, y, z = (gained / self._span_s for gained in self._gained)
            told = Second(self._turned, (x, y, z), self._told_s, self._passed_ns * 1e-9)
            self.seconds = (*self.seconds[1 - OVER :], told)
            self.is_credible = len(self.seconds) < ENOUGH or (
                self._keeps_time() and self._gains_speed(state) <= MOST_M_S2
            )
        self._span_s = self._told_s = 0.0
        self._passed_ns = 0
        self._turned, self._gained = NOTHING, NOTHING

    def _keeps_time(self) -> bool:
        """Whether samples are as long as the time in which they came."""
        told_s = sum(second.told_s for second in self.seconds)
        passed_s = sum(second.passed_s for second in self.seconds)
        return abs(told_s - passed_s) <= OTHER_RATE * passed_s

    def _gains_speed(self, state: State) -> float:
        """How fast (m/s^2), on the mean of the seconds."""
        C_eb, f_e = state.C_eb, np.zeros(3)
        for second in reversed(self.seconds):
            back = exp_so3(-0.5 * np.array(second.turned))
            f_e += C_eb @ back @ np.array(second.force)
            C_eb = C_eb @ back @ back
        x, y, z = state.r_e.tolist()
        return float(np.linalg.norm(f_e / len(self.seconds) + gravity_e((x, y, z))))
