"""Fields of text sentences: numbers and clocks, taken only if they look exactly like one."""

import re

from drivers.framing import UnreadableError

_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")
_CLOCK = re.compile(r"(\d\d):?(\d\d):?(\d\d(?:\.\d+)?)")


def number(text: str, low: float = -1e9, high: float = 1e9) -> float:
    """Read a plain decimal number between bounds; raises `UnreadableError`."""
    if not _NUMBER.fullmatch(text):
        raise UnreadableError("syntax", f'"{text}" is no number')
    value = float(text)
    if not low <= value <= high:
        raise UnreadableError("range", f"{text} is not between {low} and {high}")
    return value


def seconds_of_day(text: str) -> float:
    """Read ``hh:mm:ss`` or ``hhmmss``, either with decimals."""
    match = _CLOCK.fullmatch(text)
    if match is None:
        raise UnreadableError("syntax", f'"{text}" is no time')
    hours, minutes, seconds = int(match[1]), int(match[2]), float(match[3])
    if hours > 23 or minutes > 59 or seconds >= 61:
        raise UnreadableError("range", f"{text} is not on the clock")
    return hours * 3600 + minutes * 60 + seconds
