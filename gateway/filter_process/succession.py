"""What a worker was given and what it said; from that, what the next one begins with."""

import logging
from dataclasses import dataclass

from gateway.filter_process.backlog import Backlog
from gateway.filter_process.channel import Many, Start, read_in_worker
from gateway.filter_process.progress import At
from gateway.messages import Checkpoint, FilterOutput, NavSolution, SavedState

TRIES = 2
"""Workers that may die of one input before it is thrown away."""
IN_VAIN = 6
"""Workers in a row without news before all inputs since the newest state are thrown away.

As many more, and the state goes as well.
"""

_log = logging.getLogger(__name__)


@dataclass
class _Suspect:
    """Inputs of which one killed workers."""

    numbers: range
    said: int
    deaths: int = 1


class Succession:
    """Lets each worker go on where the last one died.

    Everything sent since the last checkpoint is kept. A new worker goes on from the checkpoint over
    the same inputs, so that its answers are those the dead one would have given; those that were
    heard already it keeps back.

    Parameters
    ----------
    limit
        Most inputs that are kept.
    resume
        Where an earlier gateway left off.
    at_first
        Most that wait for the first worker.
    """

    def __init__(self, limit: int, resume: SavedState | None, at_first: int = 0) -> None:
        self.backlog = Backlog(limit, at_first)
        self.in_vain = 0
        """Workers in a row that died without news."""
        self._from: Checkpoint | SavedState | None = resume
        self._newest = resume
        self._heard = 0
        self._heard_before = 0
        self._begun = (0, 0)
        self._suspect: _Suspect | None = None
        self._t_solved_ns = 0

    def orders(self) -> Start:
        """Where the next worker is to go on from; what was sent since then waits again."""
        if not self.backlog.is_whole or self.in_vain >= IN_VAIN:
            self._begin_anew()
        else:
            self.backlog.again()
            self._give_up_the_suspect()
        at = self._from
        self._begun = (at.received, at.said) if isinstance(at, Checkpoint) else (0, 0)
        self._heard_before = self._heard
        return Start(at, self._heard - self._begun[1], one_by_one=self._suspect is not None)

    def take(self, output: FilterOutput) -> bool:
        """Hear a worker; whether it is news to the daemon."""
        match output:
            case Checkpoint():
                self._from = output
                self.backlog.cover(output.received)
                if self._suspect is not None and self._suspect.numbers[-1] < output.received:
                    self._suspect = None
                return False
            case SavedState():
                if self._newest is not None and output.t_ns <= self._newest.t_ns:
                    return False
                self._newest = output
                return True
        self._heard += 1
        if isinstance(output, NavSolution):
            if output.t_ns <= self._t_solved_ns:
                return False
            self._t_solved_ns = output.t_ns
        return True

    def ended(self, at: At | None) -> None:
        """Note the death of a worker, and which of its inputs it may have died of."""
        self.in_vain = 0 if self._heard > self._heard_before else self.in_vain + 1
        if at is None:
            return
        first, said = self._begun[0] + at.taken, self._begun[1] + at.said
        before, now = self._suspect, _Suspect(range(first, first + at.count), said)
        if before is not None and first in before.numbers:
            now.deaths += before.deaths
        self._suspect = now

    def _give_up_the_suspect(self) -> None:
        """Throw away an input that killed one worker after the other."""
        suspect = self._suspect
        if suspect is None or len(suspect.numbers) > 1 or suspect.deaths < TRIES:
            return
        _log.error("filter process: an input of which %d died is thrown away", suspect.deaths)
        self.backlog.drop(suspect.numbers[0])
        self._heard = min(self._heard, suspect.said)  # what it said of this one is void
        self._suspect = None

    def _begin_anew(self) -> None:
        """Go on from the newest state, as the way to it is lost or leads nowhere."""
        if self.in_vain >= 2 * IN_VAIN:
            self._newest = None
        self._from, self._heard, self._suspect = self._newest, 0, None
        self.backlog.anew(self._is_after_newest, self.in_vain >= IN_VAIN)

    def _is_after_newest(self, data: bytes) -> bool:
        """Whether an input is later than the newest state."""
        if self._newest is None:
            return True
        measurement = read_in_worker(data)
        assert not isinstance(measurement, Start | Many)
        t = measurement.t_ns
        t_ns = t if isinstance(t, int) else int.from_bytes(t[-8:], "little", signed=True)
        return t_ns > self._newest.t_ns
