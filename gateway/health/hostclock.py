"""Whether the host's clock can be right, and when somebody sets it."""

import logging
from datetime import UTC, datetime, timedelta

from gateway.health.doubts import Doubt

SET_NS = 500_000_000
"""What disciplines a clock bit by bit stays far below this from one look to the next."""
EARLIEST_NS = 1_704_067_200_000_000_000
"""The year 2024, before there was this program."""

_log = logging.getLogger(__name__)


class HostClock:
    """Looks at Unix time over monotonic time; nothing but the stamps of what is sent goes by it."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._said = ""

    @property
    def doubts(self) -> list[Doubt]:
        """That it was never set, as long as that is so."""
        return [Doubt("host", self._said)] if self._said else []

    def sampled(self, now_ns: int, offset_ns: int) -> None:
        """Take Unix minus monotonic time (ns) at a monotonic moment; what changes is said once."""
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
