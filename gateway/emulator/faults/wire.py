"""What goes wrong between an instrument and its port: bytes damaged, frames lost, late or twice.

Each fault is a stream of emissions made from another, in the order of the file.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from gateway.emulator.faults.occasions import Occasions, begins
from gateway.emulator.scenario import Scenario
from gateway.emulator.scenario.faults import (
    Burst,
    Delay,
    Drop,
    Duplicate,
    Flip,
    Garbling,
    Jitter,
    Junk,
    PowerCycle,
    Reorder,
    Truncate,
    Unplug,
    WireFault,
)
from gateway.emulator.streams import Emission, Fate, generator

Stream = Iterator[Emission]
Rng = np.random.Generator
Act = Callable[[Stream, Any, Occasions, Rng], Stream]


def faulty(stream: Stream, name: str, scenario: Scenario) -> Stream:
    """What becomes of a device's emissions on their way to its port."""
    for k, fault in enumerate(scenario.faults):
        if isinstance(fault, WireFault) and fault.device == name:
            when = Occasions(begins(scenario, k), fault.for_s)
            rng = generator(scenario.seed, "faults", str(k), "draws")
            stream = _ACTS[type(fault)](stream, fault, when, rng)
    return stream


def _struck(
    stream: Stream, fault: Garbling, when: Occasions, rng: Rng
) -> Iterator[tuple[Emission, bool]]:
    """Each emission, and whether it is struck."""
    for e in stream:
        struck = bool(e.data) and when.strike(e.t)
        yield e, struck and (fault.probability == 1.0 or rng.random() < fault.probability)


def _damaged(e: Emission, data: bytes) -> Emission:
    """The emission with other bytes; a damaged copy is junk."""
    fate: Fate = "damaged" if e.fate in ("whole", "damaged") else "junk"
    return replace(e, data=data, fate=fate)


def _flip(stream: Stream, fault: Flip, when: Occasions, rng: Rng) -> Stream:
    for e, struck in _struck(stream, fault, when, rng):
        if not struck:
            yield e
            continue
        data = bytearray(e.data)
        bits = rng.choice(8 * len(data), size=min(fault.bits, 8 * len(data)), replace=False)
        for bit in bits.tolist():
            data[bit // 8] ^= 1 << bit % 8
        yield _damaged(e, bytes(data))


def _truncate(stream: Stream, fault: Truncate, when: Occasions, rng: Rng) -> Stream:
    for e, struck in _struck(stream, fault, when, rng):
        if struck and len(e.data) > 1:
            yield _damaged(e, e.data[: rng.integers(1, len(e.data))])
        else:
            yield e


def _junk(stream: Stream, fault: Junk, when: Occasions, rng: Rng) -> Stream:
    for e, struck in _struck(stream, fault, when, rng):
        if struck:
            junk = rng.bytes(int(rng.integers(1, fault.bytes + 1)))
            yield replace(e, data=junk, fate="junk")
        yield e


def _duplicate(stream: Stream, fault: Duplicate, when: Occasions, rng: Rng) -> Stream:
    for e, struck in _struck(stream, fault, when, rng):
        yield e
        if struck:
            yield replace(e, fate="repeated" if e.fate == "whole" else "junk")


def _reorder(stream: Stream, fault: Reorder, when: Occasions, rng: Rng) -> Stream:
    held: Emission | None = None
    for e, struck in _struck(stream, fault, when, rng):
        if held is not None and e.data:
            yield e
            yield replace(held, t=e.t)
            held = None
        elif struck:
            held = e
        else:
            yield e
    if held is not None:
        yield held


def _drop(stream: Stream, fault: Drop, when: Occasions, rng: Rng) -> Stream:
    for e, struck in _struck(stream, fault, when, rng):
        if struck:
            yield from _lost(e)
        else:
            yield e


def _burst(stream: Stream, _fault: Burst, when: Occasions, _rng: Rng) -> Stream:
    held: list[Emission] = []
    until = 0.0
    for e in stream:
        if held and e.t >= until:
            yield from (replace(h, t=until) for h in held)
            held = []
        if when.strike(e.t):
            held.append(e)
            until = when.until
        else:
            yield replace(e, t=max(e.t, until))
    yield from (replace(h, t=until) for h in held)


def _delay(stream: Stream, fault: Delay, when: Occasions, _rng: Rng) -> Stream:
    return _later(stream, when, lambda: 1e-3 * fault.delay_ms)


def _jitter(stream: Stream, fault: Jitter, when: Occasions, rng: Rng) -> Stream:
    return _later(stream, when, lambda: 1e-3 * fault.mean_ms * rng.standard_exponential())


def _later(stream: Stream, when: Occasions, draw: Callable[[], float]) -> Stream:
    """Frames later by what is drawn, none before the one ahead of it."""
    left = 0.0
    for e in stream:
        left = max(left, e.t + draw() if when.strike(e.t) else e.t)
        yield replace(e, t=left)


def _power_cycle(stream: Stream, _fault: PowerCycle, when: Occasions, _rng: Rng) -> Stream:
    for e in stream:
        if when.strike(e.t):
            yield from _lost(e)
        else:
            yield e


def _unplug(stream: Stream, _fault: Unplug, when: Occasions, _rng: Rng) -> Stream:
    """Tell the port when it goes and when it is back."""
    back: float | None = None
    device = ""
    for e in stream:
        device = e.device
        if back is not None and e.t >= back:
            yield Emission(back, device, b"", fate="plugged")
            back = None
        if not when.strike(e.t):
            yield e
            continue
        if back is None:
            yield Emission(e.t, device, b"", fate="unplugged")
        back = max(when.until, e.t)
        yield from _lost(e)
    if back is not None:
        yield Emission(back, device, b"", fate="plugged")


def _lost(e: Emission) -> Stream:
    """What is left of an emission that never arrives: a frame of the device is counted."""
    if not e.data:
        yield e
    elif e.fate in ("whole", "damaged"):
        yield replace(e, data=b"", fate="dropped")


_ACTS: dict[type[WireFault], Act] = {
    Flip: _flip,
    Truncate: _truncate,
    Junk: _junk,
    Duplicate: _duplicate,
    Reorder: _reorder,
    Drop: _drop,
    Burst: _burst,
    Delay: _delay,
    Jitter: _jitter,
    Unplug: _unplug,
    PowerCycle: _power_cycle,
}
