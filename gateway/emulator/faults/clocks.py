"""What an instrument's clock tells, and its counter, after all that has happened to them."""

import numpy as np
from numpy.typing import NDArray

from drivers.codec import Counting
from gateway.emulator.faults.occasions import begins
from gateway.emulator.scenario import Scenario
from gateway.emulator.scenario.faults import ClockDrift, ClockStep, ClockWrap, PowerCycle

Array = NDArray[np.float64]


def ahead(scenario: Scenario, name: str, t: Array) -> Array:
    """By how much drift and steps have put a device's clock ahead at times (n,) s."""
    by = np.zeros_like(t)
    for k, fault in enumerate(scenario.faults):
        if not isinstance(fault, ClockDrift | ClockStep) or fault.device != name:
            continue
        for begin in begins(scenario, k).tolist():
            if isinstance(fault, ClockStep):
                by += np.where(t >= begin, fault.step_s, 0.0)
            else:
                by += 1e-6 * fault.ppm * np.clip(t - begin, 0.0, fault.for_s)
    return by


class ImuClock:
    """Number and time that an IMU puts on its samples: from its last start on, with its faults.

    Parameters
    ----------
    uptime_s
        How long it has been powered at t = 0.
    shown_s
        What its clock shows at t = 0, if something else tells it the time (a receiver's, UTC) and
        it does not count from its start.
    """

    def __init__(
        self,
        scenario: Scenario,
        name: str,
        counting: Counting,
        rate_hz: float,
        *,
        uptime_s: float = 0.0,
        shown_s: float | None = None,
    ) -> None:
        self._scenario, self._name = scenario, name
        self._counting = counting
        self._per_s = rate_hz if counting.sequence_s is None else 1.0 / counting.sequence_s
        self._starts = [0.0]
        self._uptime_s = self._first_s = uptime_s
        self._shown_s = shown_s
        self._first = 0.0 if counting.sequence_s is None else np.rint(uptime_s * self._per_s)
        for k, fault in enumerate(scenario.faults):
            if not isinstance(fault, PowerCycle | ClockWrap) or fault.device != name:
                continue
            if isinstance(fault, PowerCycle):
                self._starts += (begins(scenario, k) + fault.for_s).tolist()
            else:
                self._turn_over(float(begins(scenario, k)[0]))
        self._starts.sort()

    @property
    def power_ups(self) -> list[float]:
        """When the unit was switched on, in order, s; not that of long before t = 0."""
        return self._starts[1:] if self._uptime_s else self._starts

    def tell(self, t: Array) -> tuple[list[int], list[float]]:
        """Numbers and times (s) of samples that end at times (n,) s."""
        starts = np.array(self._starts)
        on = starts[np.searchsorted(starts, t, side="right") - 1]
        since, first = t - on, on == 0.0
        gained = ahead(self._scenario, self._name, t)
        told = since + gained - np.where(first, 0.0, ahead(self._scenario, self._name, on))
        counted = since if self._counting.sequence_s is None else told
        number = np.rint(counted * self._per_s + self._first * first) - 1.0
        time = told + self._first_s * first
        if self._shown_s is not None:
            time = self._shown_s + t + gained
        if self._counting.sequence_modulus is not None:
            number %= self._counting.sequence_modulus
        turn_s = self._counting.time_modulus_s
        time = np.maximum(time, 0.0) if turn_s is None else time % turn_s
        return number.astype(np.int64).tolist(), time.tolist()

    def _turn_over(self, at_s: float) -> None:
        """Begin with what turns over at a time, where a turn is longer than until then."""
        modulus, turn_s = self._counting.sequence_modulus, self._counting.time_modulus_s
        if modulus is not None:
            self._first = -np.rint(at_s * self._per_s) % modulus
        if turn_s is not None:
            self._first_s = -at_s % turn_s
            self._shown_s = None if self._shown_s is None else self._first_s
