"""Which boot of the machine it is, and what its clocks say: how long something was ago.

The monotonic clock begins anew with every boot. Between two boots only the wall clock tells the
time, and it may be wrong at first: a machine without a battery wakes up in the past, or where it
fell asleep. It is believed where a hardware clock, which ran meanwhile, says the same.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

from drivers.hosttime import now_ns

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
HARDWARE_CLOCKS = Path("/sys/class/rtc")
AGREE_S = 5.0
"""How far a hardware clock may be from the wall clock, of which it knows whole seconds."""


class Moment(msgspec.Struct, frozen=True, array_like=True):
    """One moment as the machine's clocks tell it.

    ``is_sure`` says whether a hardware clock vouches for ``utc_ns``.
    """

    boot: str
    mono_ns: int
    utc_ns: int
    is_sure: bool

    def since(self, earlier: "Moment") -> int:
        """Nanoseconds since an earlier moment: by the monotonic clock if that is the same."""
        if self.boot == earlier.boot:
            return self.mono_ns - earlier.mono_ns
        return self.utc_ns - earlier.utc_ns


def now(boot_id: Path = BOOT_ID, hardware: Path = HARDWARE_CLOCKS) -> Moment:
    """The present moment."""
    utc_ns = time.time_ns()
    is_sure = any(abs(utc_ns * 1e-9 - t_s) < AGREE_S for t_s in _told(hardware))
    return Moment(_boot(boot_id), now_ns(), utc_ns, is_sure)


def unbelievable(earlier: Moment, at: Moment) -> str | None:
    """Why it is not known how long ago a moment was; None if it is."""
    if at.since(earlier) < 0:
        return "was written in the future, by the clock of now"
    if at.boot != earlier.boot and not (earlier.is_sure and at.is_sure):
        return "is of another boot, and no hardware clock tells how long ago that was"
    return None


def _boot(boot_id: Path) -> str:
    """Identity of this boot; one of its own for this process where the system has none."""
    try:
        return boot_id.read_text().strip()
    except OSError:
        return f"process {time.monotonic_ns()}"


def _told(hardware: Path) -> Iterator[float]:
    """Seconds since 1970 by each hardware clock."""
    for clock in hardware.glob("*/since_epoch"):
        try:
            yield float(clock.read_text())
        except (OSError, ValueError):
            continue
