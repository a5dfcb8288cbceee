"""What the filter came to believe after it had refused it."""

import logging
import math
from dataclasses import dataclass

from gateway.health.doubts import Doubt
from gateway.messages import Innovation, Vec3

STAYS_S = 600.0
"""How long it is shown, and not said again of the same source."""
NOTHING_M = 1.0
"""A place that went no further is as it was."""

_log = logging.getLogger(__name__)


@dataclass
class _Source:
    """Fixes of one device and beacon, since it was last believed without doubt."""

    refused: int = 0
    north_m: float = 0.0
    east_m: float = 0.0
    down_m: float = 0.0

    def move(self, moved: Vec3) -> None:
        """Add how far a fix took the place."""
        self.north_m += moved[0]
        self.east_m += moved[1]
        self.down_m += moved[2]

    @property
    def far_m(self) -> float:
        """How far the place has gone by them."""
        return math.hypot(self.north_m, self.east_m, self.down_m)


class Freed:
    """Hears verdicts, and tells where the filter gave in."""

    def __init__(self) -> None:
        self._sources: dict[tuple[str, str], _Source] = {}
        self._given_in: list[tuple[str, str, _Source]] = []
        self._shown: dict[tuple[str, str], tuple[float, Doubt]] = {}

    @property
    def doubts(self) -> list[Doubt]:
        """Those that are still shown."""
        return [doubt for _, doubt in self._shown.values()]

    def verdict(self, innovation: Innovation) -> None:
        """Note what the filter made of a fix."""
        of = innovation.device, innovation.beacon
        if innovation.reason == "gate":
            self._sources.setdefault(of, _Source()).refused += 1
        elif innovation.moved is not None and of in self._sources:
            self._sources[of].move(innovation.moved)
        elif innovation.accepted:
            source = self._sources.pop(of, _Source())
            if source.far_m > NOTHING_M:
                self._given_in.append((*of, source))

    def look(self, now: float) -> None:
        """Say what is new, and forget what is old."""
        self._shown = {of: at for of, at in self._shown.items() if now - at[0] < STAYS_S}
        given_in, self._given_in = self._given_in, []
        for device, beacon, source in given_in:
            text = _text(beacon, source)
            if (device, beacon) not in self._shown:
                _log.warning("%s: %s", device, text)
            self._shown[device, beacon] = now, Doubt(device, text)


def _text(beacon: str, source: _Source) -> str:
    whose = f' of beacon "{beacon}"' if beacon else ""
    north = f"{abs(source.north_m):.0f} m {'north' if source.north_m >= 0.0 else 'south'}"
    east = f"{abs(source.east_m):.0f} m {'east' if source.east_m >= 0.0 else 'west'}"
    down = f"{abs(source.down_m):.0f} m {'down' if source.down_m >= 0.0 else 'up'}"
    return (
        f"the place went {north}, {east}, {down} to fit {source.refused} fixes{whose},"
        " which were refused: was it wrong, or is what they are told from?"
    )
