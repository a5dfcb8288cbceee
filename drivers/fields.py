"""Fields of text sentences: numbers and clocks, taken only if they look exactly like one."""

import re
from datetime import date

from drivers.framing import UnreadableError

_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")
_NUMBERS = re.compile(rf"{_NUMBER.pattern}(?:,{_NUMBER.pattern})*")
_UNIX_EPOCH = date(1970, 1, 1).toordinal()
_CLOCK = re.compile(r"(\d\d):?(\d\d):?(\d\d(?:\.\d+)?)")


def number(text: str, low: float = -1e9, high: float = 1e9) -> float:
    """Read a plain decimal number between bounds; raises `UnreadableError`."""
    if not _NUMBER.fullmatch(text):
        raise UnreadableError("syntax", f'"{text}" is no number')
    value = float(text)
    if not low <= value <= high:
        raise UnreadableError("range", f"{text} is not between {low} and {high}")
    return value


def numbers(texts: tuple[str, ...], bound: float = 1e11) -> list[float]:
    """Read several plain decimal numbers at once, half again as fast; raises `UnreadableError`."""
    if not _NUMBERS.fullmatch(",".join(texts)):
        raise UnreadableError("syntax", f"{texts} are not all numbers")
    values = [float(text) for text in texts]
    if max(map(abs, values)) > bound:
        raise UnreadableError("range", f"{texts} are not all within {bound}")
    return values


def maybe(text: str, low: float = -1e9, high: float = 1e9) -> float | None:
    """Read the same where the field may be empty."""
    return number(text, low, high) if text else None


def plain(value: float | None, decimals: int) -> str:
    """Write a number, or an empty field for none."""
    return "" if value is None else f"{value:.{decimals}f}"


def seconds_of_day(text: str) -> float:
    """Read ``hh:mm:ss`` or ``hhmmss``, either with decimals."""
    match = _CLOCK.fullmatch(text)
    if match is None:
        raise UnreadableError("syntax", f'"{text}" is no time')
    hours, minutes, seconds = int(match[1]), int(match[2]), float(match[3])
    if hours > 23 or minutes > 59 or seconds >= 61:
        raise UnreadableError("range", f"{text} is not on the clock")
    return hours * 3600 + minutes * 60 + seconds


def clock(t_s: float | None, decimals: int = 2) -> str:
    """Write ``hhmmss.ss``, or an empty field for no time."""
    if t_s is None:
        return ""
    unit = 10**decimals
    seconds, part = divmod(round(t_s * unit) % (86_400 * unit), unit)
    minutes = seconds // 60
    return f"{minutes // 60:02d}{minutes % 60:02d}{seconds % 60:02d}.{part:0{decimals}d}"


def unix_day(year: int, month: int, day: int) -> int:
    """Unix time (s) at which a day of the calendar begins; raises `UnreadableError`."""
    try:
        return (date(year, month, day).toordinal() - _UNIX_EPOCH) * 86_400
    except (ValueError, OverflowError) as error:
        raise UnreadableError("range", f"{year}-{month}-{day} is no date") from error


def unix_date(days: int) -> date:
    """Day of the calendar that begins `days` after the Unix epoch."""
    return date.fromordinal(_UNIX_EPOCH + days)
