"""The reports of the last minutes, and which of them a query's time range asks for.

A range is written as Zenoh's own storages take it: ``[now(-2m)..]``, ``[now(-10s);5s]``, or with
RFC 3339 times at its ends; ``[`` and ``]`` turned outward leave the end itself out.
"""

import re
from collections import deque
from datetime import UTC, datetime

PAST_BYTES = 16 << 20
"""Of each kind of report: two minutes at 200 Hz."""

_UNITS_S = {"u": 1e-6, "ms": 1e-3, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0, "w": 604800.0}
_RANGE = re.compile(
    r"(?P<open>[\[\]])(?P<first>.*?)(?:\.\.(?P<last>.*)|;(?P<length>.*))(?P<close>[\[\]])"
)
_DURATION = re.compile(r"(?P<number>[-+]?\d{1,12}(?:\.\d{1,12})?)(?P<unit>u|ms|[smhdw])")
_NOW = re.compile(r"now\((?P<offset>[^)]*)\)")


class Past:
    """Reports with their times of validity (Unix ns), as many as the bounds hold, the last always.

    Added to by one thread, read by others.

    Parameters
    ----------
    seconds
        Older ones go.
    limit_bytes
        The oldest go beyond it.
    """

    def __init__(self, seconds: float, limit_bytes: int = PAST_BYTES) -> None:
        self._keep_ns = round(seconds * 1e9)
        self._limit_bytes = limit_bytes
        self._bytes = 0
        self._reports: deque[tuple[int, bytes]] = deque()

    @property
    def last(self) -> tuple[int, bytes] | None:
        """The newest, if there is any."""
        reports = self._reports
        return reports[-1] if reports else None

    def add(self, t_ns: int, payload: bytes) -> None:
        """Keep a report."""
        reports = self._reports
        reports.append((t_ns, payload))
        self._bytes += len(payload)
        oldest_ns = t_ns - self._keep_ns
        while len(reports) > 1 and (self._bytes > self._limit_bytes or reports[0][0] < oldest_ns):
            self._bytes -= len(reports.popleft()[1])

    def between(self, first_ns: int, last_ns: int) -> list[tuple[int, bytes]]:
        """Those of a range of times, both ends in it, oldest first."""
        return [report for report in self._reports.copy() if first_ns <= report[0] <= last_ns]


def time_range(text: str, now_ns: int) -> tuple[int, int]:
    """Read a range of times.

    Parameters
    ----------
    text
        As in a selector, ``[now(-2m)..]``.
    now_ns
        Unix time.

    Returns
    -------
    Both ends, themselves in it (Unix ns).

    Raises
    ------
    ValueError
        With what is wrong with the text.
    """
    parts = _RANGE.fullmatch(text.strip())
    if parts is None:
        raise ValueError(f"{text!r} is no range of times such as [now(-2m)..]")
    first_ns, last_ns = _moment(parts["first"], now_ns, -(1 << 63)), (1 << 63) - 1
    if parts["length"] is not None:
        last_ns = first_ns + _duration_ns(parts["length"])
    else:
        last_ns = _moment(parts["last"], now_ns, last_ns)
    return first_ns + (parts["open"] == "]"), last_ns - (parts["close"] == "[")


def _moment(text: str, now_ns: int, default_ns: int) -> int:
    """Unix ns of one end; empty is without end."""
    text = text.strip()
    if not text:
        return default_ns
    now = _NOW.fullmatch(text)
    if now is not None:
        return now_ns + (_duration_ns(now["offset"]) if now["offset"].strip() else 0)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(
            f"{text!r} is neither now(...) nor a time such as 2026-05-01T12:00:00Z"
        ) from None
    since = moment.replace(tzinfo=moment.tzinfo or UTC) - datetime.fromtimestamp(0, UTC)
    return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000


def _duration_ns(text: str) -> int:
    duration = _DURATION.fullmatch(text.strip())
    if duration is None:
        raise ValueError(f"{text!r} is no duration such as 2m, 1.5h or 250ms")
    return round(float(duration["number"]) * _UNITS_S[duration["unit"]] * 1e9)
