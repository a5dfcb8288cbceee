"""Keeping a process punctual: garbage collected in time, priority, locked memory, waking cores.

Nothing here may fail for want of a permission: navigation goes on, at the system's leisure.
"""

import ctypes
import gc
import math
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from gateway.config import Realtime

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
"""Of Linux' mlockall(2); the last leaves out what was never touched, such as stacks of threads."""
WAKING = Path("/dev/cpu_dma_latency")
"""Of Linux' power management: the strictest number (us) that a process holds open is kept."""
COLLECT_S = 1.0


class RealtimeStatus(msgspec.Struct, frozen=True):
    """What the system has granted; 0 is ordinary scheduling."""

    priority: int = 0
    memory_locked: bool = False
    wake_us: int | None = None


def enter(settings: "Realtime") -> tuple[RealtimeStatus, list[str]]:
    """Take the priority and lock the memory that the configuration asks for.

    The calling thread gets it, and every thread that it starts from then on: call this before
    `zenoh.open`.

    Returns
    -------
    status, complaints
        What was granted, and a line for whatever was not.
    """
    complaints = []
    priority, locked, wake_us = 0, False, None
    if settings.priority is not None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(settings.priority))
            priority = settings.priority
        except PermissionError:
            complaints.append(
                f"realtime.priority: {settings.priority} is not permitted"
                " (LimitRTPRIO= of the unit, or ulimit -r); going on without"
            )
        except AttributeError:
            complaints.append("realtime.priority: not available on this system")
    if settings.lock_memory:
        why = _lock_memory()
        locked = not why
        if why:
            complaints.append(f"realtime.lock_memory: {why}; going on without")
    if settings.wake_us is not None:
        why = _keep_awake(settings.wake_us)
        wake_us = None if why else settings.wake_us
        if why:
            complaints.append(f"realtime.wake_us: {why}; going on without")
    return RealtimeStatus(priority, locked, wake_us), complaints


@contextmanager
def ordinary() -> Iterator[None]:
    """Ordinary scheduling of the calling thread for the body, to be inherited by what it starts.

    A process that imports and compiles at the daemon's own priority would hold it up on a machine
    with few cores.
    """
    if not hasattr(os, "sched_setscheduler") or os.sched_getscheduler(0) != os.SCHED_FIFO:
        yield
        return
    before = os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_FIFO, before)


class Collector:
    """The garbage collector, run at moments of our own choosing."""

    def __init__(self) -> None:
        self._due = math.inf

    def settle(self) -> None:
        """Set aside for good what start-up made, and collect only when `quiet` is called.

        Going through modules and compiled code takes up to 100 ms, through what arises later 0.1.
        """
        gc.collect()
        gc.freeze()
        gc.disable()
        self._due = time.monotonic() + COLLECT_S

    def quiet(self) -> None:
        """Collect, if it is time; call this when the work at hand is done."""
        now = time.monotonic()
        if now >= self._due:
            gc.collect()
            self._due = now + COLLECT_S


def _keep_awake(wake_us: int) -> str:
    """Bound the sleep of idle cores until this process ends; why not, where that cannot be."""
    try:
        # Open for good: the bound holds for as long as the file does.
        os.write(os.open(WAKING, os.O_WRONLY), wake_us.to_bytes(4, sys.byteorder))
    except OSError as error:
        return f"{WAKING}: {os.strerror(error.errno or 0).lower()}"
    return ""


def _lock_memory() -> str:
    """Keep what this process touches in memory; why not, where that cannot be."""
    try:
        mlockall = ctypes.CDLL(None, use_errno=True).mlockall
    except (OSError, AttributeError):
        return "not available on this system"
    if mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0:
        return ""
    return f"{os.strerror(ctypes.get_errno()).lower()} (LimitMEMLOCK= of the unit, or ulimit -l)"
