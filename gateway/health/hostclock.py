"""Whether the host's clock can be right, when somebody sets it, and that it slept."""

import logging
from datetime import UTC, datetime, timedelta

from gateway.health.doubts import Doubt

SET_NS = 500_000_000
"""What disciplines a clock bit by bit stays far below this from one look to the next."""
EARLIEST_NS = 1_704_067_200_000_000_000
"""The year 2024, before there was this program."""

_log = logging.getLogger(__name__)


class HostClock:
    """Looks at Unix time over the host's own; nothing but the stamps of what is sent goes by it."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._asleep_ns: int | None = None
        self._said = ""

    @property
    def doubts(self) -> list[Doubt]:
        """That it was never set, as long as that is so."""
        return [Doubt("host", self._said)] if self._said else []

    def sampled(self, now_ns: int, offset_ns: int, asleep_ns: int = 0) -> None:
        """Look once more; what changes is said once.

        Parameters
        ----------
        now_ns, offset_ns
            The host's own time, and what Unix time is ahead of it.
        asleep_ns
            How long the host has slept since it was started.
        """
        if self._asleep_ns is not None and asleep_ns - self._asleep_ns > SET_NS:
            _log.warning("host: it slept for %s", _span(asleep_ns - self._asleep_ns))
        self._asleep_ns = asleep_ns
        before, self._offset_ns = self._offset_ns, offset_ns
        if before is not None and abs(offset_ns - before) > SET_NS:
            way = "forward" if offset_ns > before else "back"
            _log.warning("host: its clock was set %s by %s", way, _span(abs(offset_ns - before)))
        unix_ns = now_ns + offset_ns
        if unix_ns >= EARLIEST_NS:
            self._said = ""
        elif not self._said:
            date = datetime.fromtimestamp(unix_ns // 1_000_000_000, UTC)
            self._said = f"its clock says {date:%Y-%m-%d}: not set yet, and what is sent carries it"
            _log.warning("host: %s", self._said)


def _span(ns: int) -> str:
    return f"{ns * 1e-9:.1f} s" if ns < 60_000_000_000 else str(timedelta(seconds=round(ns * 1e-9)))
