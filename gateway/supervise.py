"""Keep a line running: retry what may come back, say so once, let everything else through."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import NamedTuple

Alive = Callable[[], None]


class Notice(NamedTuple):
    """A line went away (``up`` false) or came back; ``text`` is ready to be shown."""

    name: str
    up: bool
    text: str


@dataclass(frozen=True, slots=True)
class Backoff:
    """How long to wait before the next try.

    Attributes
    ----------
    first_s, longest_s
        The first wait; it doubles up to the longest.
    steady_s
        A line that has lived this long is healthy: the waits begin anew, and if it had been coming
        and going, that is over.
    """

    first_s: float = 0.25
    longest_s: float = 2.0
    steady_s: float = 10.0


def is_retryable(error: BaseException) -> bool:
    """Whether trying again may help: `OSError` (so `LinkError`), alone or in a group of such."""
    if isinstance(error, BaseExceptionGroup):
        return all(is_retryable(inner) for inner in error.exceptions)
    return isinstance(error, OSError)


def log_notice(notice: Notice) -> None:
    """Give a notice to the log."""
    level = logging.INFO if notice.up else logging.WARNING
    logging.getLogger(__name__).log(level, "%s", notice.text)


async def keep_running(
    name: str,
    make: Callable[[Alive], Awaitable[None]],
    *,
    report: Callable[[Notice], None] = log_notice,
    backoff: Backoff = Backoff(),
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
) -> None:
    """Run `make` until it ends by itself; after a retryable error wait and run it again.

    Parameters
    ----------
    name
        Opens every notice.
    make
        Opens the line and works until it is lost. It calls its argument at every sign of life (each
        chunk received): that is cheap, and how a recovery is known.
    report
        Told of a loss once, however many tries follow, and of the recovery once. A line that soon
        goes again is then told of only when it has been steady.
    clock, sleep
        Seconds that only ever grow; how to wait.

    Raises
    ------
    Exception
        Whatever `is_retryable` does not name.
    """
    pulse = _Pulse(name, report, backoff.steady_s, clock)
    wait = backoff.first_s
    while True:
        pulse.begin()
        try:
            return await make(pulse.alive)
        except (OSError, ExceptionGroup) as error:
            if not is_retryable(error):
                raise
            pulse.lost(error)
        if pulse.was_steady:
            wait = backoff.first_s
        await sleep(wait)
        wait = min(2.0 * wait, backoff.longest_s)


class _Pulse:
    """What has been said of a line, and whether it lives."""

    def __init__(
        self,
        name: str,
        report: Callable[[Notice], None],
        steady_s: float,
        clock: Callable[[], float],
    ) -> None:
        self._name, self._report, self._steady_s, self._clock = name, report, steady_s, clock
        self._said_up = True
        self._flaps = False
        self._lost_at: float | None = None
        self.begin()

    def begin(self) -> None:
        """Note that a new try begins."""
        self._first_life: float | None = None
        self.was_steady = False

    def alive(self) -> None:
        """Note a sign of life; announce the recovery when it is one."""
        if self.was_steady:
            return
        now = self._clock()
        if self._first_life is None:
            self._first_life = now
        if now - self._first_life >= self._steady_s:
            self.was_steady = True
            self._flaps = False
        if self._lost_at is not None and not self._said_up and not self._flaps:
            self._said_up = True
            away = now - self._lost_at
            self._report(Notice(self._name, True, f"{self._name}: back after {away:.1f} s"))

    def lost(self, error: BaseException) -> None:
        """Announce the loss, unless it is known."""
        if not self._said_up:
            return
        lived = self._first_life is not None
        self._flaps = lived and not self.was_steady and self._lost_at is not None
        self._said_up = False
        self._lost_at = self._clock()
        until = "it is steady" if self._flaps else "it is back"
        text = f"{self._name}: {_first_line(error)}; trying until {until}"
        self._report(Notice(self._name, False, text))


def _first_line(error: BaseException) -> str:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return next(iter(str(error).splitlines()), type(error).__name__)
