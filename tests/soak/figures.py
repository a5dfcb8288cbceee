"""What a soak saw, as numbers: errors against their sigma, memory, latencies, bytes."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import theilslopes

from gateway.emulator.truth import TruthFile
from gateway.modes import Mode
from gateway.outputs.schema import NavReport
from tests.integration.cables import Carried

NAVIGATING = (Mode.AIDED, Mode.DEAD_RECKONING)
WARM_S = 60.0
"""Memory of the first minute of a run is not of its slope."""
SLOPE_S = 240.0
"""Less time tells no slope."""
BOUND = 5.0
"""Errors of so many sigma are no chance."""
CALM_S = 5.0
"""After so long without, they are of another cause."""
COMPONENTS = ("north", "east", "down", "heading")


@dataclass
class Errors:
    """Errors of the solutions that claim something."""

    solutions: int = 0
    judged: int = 0
    beyond_3: int = 0
    squares_m2: float = 0.0
    worst_m: float = 0.0
    worst: dict[str, float] = field(default_factory=lambda: dict.fromkeys(COMPONENTS, 0.0))
    beyond: list[tuple[float, str, float]] = field(default_factory=list)
    """Unix time, component and ratio of the errors beyond the bound."""
    modes: Counter[str] = field(default_factory=Counter)

    def take(self, nav: NavReport, truth: TruthFile) -> None:
        """Judge a solution by the truth of its time."""
        self.solutions += 1
        self.modes[nav.mode.value] += 1
        there = truth.at(nav.t_s)
        if nav.mode not in NAVIGATING or there is None:
            return
        north = (nav.lat_deg - there.lat_deg) * 111_132.0
        east = (nav.lon_deg - there.lon_deg) * 111_320.0 * math.cos(math.radians(there.lat_deg))
        down = there.height_m - nav.height_m
        heading = (nav.heading_deg - there.heading_deg + 180.0) % 360.0 - 180.0
        sigmas = (nav.sd_n_m, nav.sd_e_m, nav.sd_d_m, nav.sd_heading_deg)
        ratios = [abs(e) / sd for e, sd in zip((north, east, down, heading), sigmas, strict=True)]
        self.judged += 1
        self.beyond_3 += max(ratios) > 3.0
        self.squares_m2 += north**2 + east**2
        self.worst_m = max(self.worst_m, math.hypot(north, east))
        for name, ratio in zip(COMPONENTS, ratios, strict=True):
            self.worst[name] = max(self.worst[name], ratio)
            if ratio > BOUND:
                self.beyond.append((nav.t_s, name, ratio))

    def spells(self) -> Iterator[list[tuple[float, str, float]]]:
        """The errors beyond the bound, those together that follow each other closely."""
        spell: list[tuple[float, str, float]] = []
        for error in self.beyond:
            if spell and error[0] - spell[-1][0] > CALM_S:
                yield spell
                spell = []
            spell.append(error)
        if spell:
            yield spell


@dataclass
class Run:
    """One run of the gateway: its last status, its memory (s, MB) as time went by."""

    status: dict[str, Any] = field(default_factory=dict)
    memory: list[tuple[float, float]] = field(default_factory=list)

    def slope_mb_h(self) -> float | None:
        """Growth of memory once it is warm; None of a run too short to tell.

        The median of all slopes between two moments: a filter that is killed and grows anew is a
        dent in the line, not its direction.
        """
        t, mb = np.array(self.memory).T
        warm = t - t[0] > WARM_S
        if t[-1] - t[0] < WARM_S + SLOPE_S:
            return None
        return float(theilslopes(mb[warm], t[warm]).slope) * 3600.0


class Event(NamedTuple):
    """What was done, when (Unix s), and how long until the position was true again (s)."""

    what: str
    t_s: float
    back_s: float | None


@dataclass
class Figures:
    """Everything for the table."""

    seconds: float = 0.0
    errors: Errors = field(default_factory=Errors)
    runs: list[Run] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    carried: dict[str, Carried] = field(default_factory=dict)
    emulated: dict[str, Any] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)
    """What ended a run of the gateway before its time, or not as it should."""

    def device(self, name: str, key: str) -> int:
        """A count of a device over all runs."""
        return sum(int(run.status["devices"][name][key]) for run in self.runs)

    def heard(self, name: str) -> int:
        """Bytes that the gateways heard of a device."""
        return sum(int(run.status["devices"][name]["link"]["bytes"]) for run in self.runs)

    def unexplained(self, name: str) -> int:
        """Bytes that arrived at the gateway's end of a cable, and that it knows nothing of."""
        return self.carried[name].arrived - self.heard(name)

    def unsent(self, name: str) -> int:
        """Bytes that left the emulator and never came to the cable."""
        return int(self.emulated["devices"][name]["bytes"]) - self.carried[name].bytes

    def findings(self) -> Iterator[str]:
        """What must not be."""
        yield from self.broken
        for name in self.carried:
            if self.unexplained(name) or self.unsent(name):
                lost = self.unexplained(name) + self.unsent(name)
                yield f"{name}: {lost} bytes are accounted for nowhere"
        for event in self.events:
            if event.back_s is None:
                yield f"{event.what}: no true position afterwards"
        for spell in self.errors.spells():
            (first_s, *_), (last_s, *_) = spell[0], spell[-1]
            _, name, ratio = max(spell, key=itemgetter(2))
            before = [event for event in self.events if event.t_s < first_s][-1:]
            after = "".join(f", {first_s - e.t_s:.1f} s after: {e.what}" for e in before)
            yield (
                f"{len(spell)} errors beyond {BOUND:g} sigma within {last_s - first_s:.1f} s, the"
                f" worst of {ratio:.1f} ({name}), from {first_s:.1f} on{after}"
            )


def memory_mb(pids: Sequence[int]) -> float:
    """Memory of processes that no file is behind, shared pages shared among them (PSS).

    Pages of files, such as libraries, are the fewer ours the more other programs use them.
    """
    total = 0
    for pid in pids:
        with suppress(OSError):
            rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
            total += sum(
                int(line.split()[1])
                for line in rollup.splitlines()
                if line.startswith(("Pss_Anon:", "Pss_Shmem:"))
            )
    return total / 1000.0
