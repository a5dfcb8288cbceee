"""A device whose seconds begin with a pulse: the sentences name the second, the pulse says when.

What a sentence is late by no longer matters then. Where the pulses stop, its own clock goes on.
"""

from collections.abc import Mapping

from gateway.clock.device import DeviceClock, Tick
from gateway.clock.memory import ClockMemory
from gateway.clock.report import ClockReport

DAY_MS = 86_400_000
SECOND_MS = 1000
TOO_LATE_MS = 100
"""How much more than in truth the latency of the sentences may be declared."""
MISSED_S = 10.0
"""Pulses older than this are not relied on any more."""


class PulsedClock:
    """Host time of a time of day (ms), by the sentences that tell it and the pulses between.

    Parameters
    ----------
    told
        The clock of the sentences alone.
    """

    def __init__(self, told: DeviceClock) -> None:
        self._told = told
        self._pulsed = DeviceClock(1e-3, DAY_MS)
        self._t_pulse_ns: int | None = None
        self._t_told_ns = 0

    def pulse(self, t_ns: int) -> None:
        """Take the moment at which a second began.

        Sentences only ever come late, so by their clock the second that begins is not over yet.
        """
        now_ms = self._told.now(t_ns)
        if now_ms is None:
            return
        second = -(-(round(now_ms) - TOO_LATE_MS) // SECOND_MS)
        self._pulsed.take([(second * SECOND_MS % DAY_MS, t_ns)])
        self._t_pulse_ns = t_ns

    def take(self, value: int, t_arrival_ns: int) -> Tick:
        """Place a time of day that a sentence told."""
        tick = self._told.take([(value, t_arrival_ns)])[0]
        self._t_told_ns = t_arrival_ns
        if self._is_pulsed():
            return Tick(self._pulsed.locate(value), tick.step_s)
        return tick

    def learn(self) -> None:
        """Learn how to place what comes next from what came."""
        self._told.learn()
        self._pulsed.learn()

    def memory(self) -> dict[str, ClockMemory]:
        """What is worth keeping when this process ends, of the sentences and of the pulses."""
        found = {"time": self._told.memory(), "pulse": self._pulsed.memory()}
        return {name: memory for name, memory in found.items() if memory is not None}

    def resume(self, clocks: Mapping[str, ClockMemory]) -> None:
        """Go on from what an earlier process knew."""
        for name, clock in (("time", self._told), ("pulse", self._pulsed)):
            if name in clocks:
                clock.resume(clocks[name])

    def report(self, untimed: int) -> ClockReport:
        """That of the pulses, while there are any."""
        if self._is_pulsed():
            return self._pulsed.report("pulse", untimed)
        return self._told.report("time", untimed)

    def _is_pulsed(self) -> bool:
        missed_ns = round(MISSED_S * 1e9)
        return self._t_pulse_ns is not None and self._t_told_ns - self._t_pulse_ns < missed_ns
