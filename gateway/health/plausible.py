"""Whether what devices say can be right: what nobody would look for in columns of numbers."""

import logging
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from gateway.config import DeviceKind
from gateway.health.doubts import Doubt
from gateway.health.freed import Freed
from gateway.ingest import Ingest, Intake
from gateway.ingest.imu import ImuIngest
from gateway.messages import Innovation

WINDOW_S = 5.0
DOUBTED_AFTER, TRUSTED_AFTER = 2, 6
"""Windows in a row; those without evidence do not count."""
REJECTED_SHARE = 0.9
ENOUGH_BYTES = 200
"""So many without a frame are not one that is still to be ended."""
RATE_SHARE = 0.2
"""How far the rate of an inertial unit may be from the declared one."""
GRAVITY_M_S2 = 9.8
FORCE_OFF_M_S2 = 1.0
"""No vehicle gains speed like this for seconds on end."""
UPRIGHT_COS = 0.5
"""Beyond 60 deg from upright a vehicle lies on its side, or its unit does."""
SPIN_DEG_S = 60.0
FIXES = 10
"""So many are looked at together."""

_HINTS: dict[DeviceKind, str] = {
    "imu": "the IMU",
    "usbl": "beacon's place, mounting, latency",
    "lbl": "beacons' places, latency",
    "gnss": "lever arm, latency, reception",
    "depth": "surface_height_m, its zero",
    "dvl": "mounting, scale, bottom lock",
    "heading": "mounting, true or magnetic",
}

_STEADY: tuple[DeviceKind, ...] = ("imu", "gnss", "depth", "heading")
"""Speak of what they are there for all the time; an acoustic device has much else to say."""

_log = logging.getLogger(__name__)


class _Finding(NamedTuple):
    """What a window shows of one thing; an empty text is that it is as it should be."""

    of: str
    what: str
    text: str


class _Thing:
    """One thing watched: doubted and trusted again when windows agree."""

    def __init__(self) -> None:
        self.text = ""
        self._against = 0

    def take(self, finding: _Finding) -> None:
        """Take what a window shows; what changes is said once."""
        agrees = bool(finding.text) == bool(self.text)
        self._against = 0 if agrees else self._against + 1
        if agrees:
            self.text = finding.text
        elif finding.text and self._against >= DOUBTED_AFTER:
            self.text, self._against = finding.text, 0
            _log.warning("%s: %s", finding.of, finding.text)
        elif not finding.text and self._against >= TRUSTED_AFTER:
            self.text, self._against = "", 0
            _log.info("%s: the %s is as it should be again", finding.of, finding.what)


class Plausibility:
    """Looks at lines and verdicts window by window.

    Parameters
    ----------
    intakes
        Those of the run, each once.
    """

    def __init__(self, intakes: Sequence[Intake]) -> None:
        self._intakes = intakes
        self._rates: list[float] = []
        self._kinds = {name: kind for way in intakes for name, kind in way.kinds.items()}
        self._things: dict[tuple[str, str], _Thing] = {}
        self._at: float | None = None
        self._totals: dict[tuple[str, str], int] = {}
        self._used: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._known: set[str] = set()
        self._strange: dict[str, str] = {}
        self._freed = Freed()

    @property
    def doubts(self) -> list[Doubt]:
        """What is doubted now."""
        found = [Doubt(of, thing.text) for (of, _), thing in self._things.items() if thing.text]
        return found + self._freed.doubts

    def verdict(self, innovation: Innovation) -> None:
        """Note what the filter made of a fix."""
        self._freed.verdict(innovation)
        device = innovation.device
        if innovation.accepted or innovation.reason == "gate":
            (self._used if innovation.accepted else self._refused)[device] += 1
            self._known.add(device)
        elif innovation.reason == "unknown_beacon":
            self._strange[device] = innovation.beacon

    def start_over(self) -> None:
        """Judge no rate by a window in which nobody listened, nor by what came of it at once."""
        self._at, self._rates = None, []

    def look(self, now: float) -> None:
        """Judge the window that ends, if one does."""
        self._freed.look(now)
        if self._at is not None and now - self._at < WINDOW_S:
            return
        span_s = math.inf if self._at is None else now - self._at
        self._at = now
        found = [finding for intake in self._intakes for finding in self._of_line(intake, span_s)]
        for finding in [*found, *self._of_fixes(), *self._of_beacons()]:
            thing = self._things.setdefault((finding.of, finding.what), _Thing())
            thing.take(finding)

    def _of_line(self, intake: Intake, span_s: float) -> Iterator[_Finding]:
        counts = intake.counts
        came = self._more(intake.name, "bytes", counts.bytes)
        rejected = self._more(intake.name, "rejected", counts.rejected_bytes)
        total = sum(ingest.counts.records for ingest in intake.ingests.values())
        records = self._more(intake.name, "records", total)
        nothing = not records and came >= ENOUGH_BYTES  # junk may be rejected in lumps
        if nothing or rejected or records:
            wrong = nothing or rejected > REJECTED_SHARE * came
            lost = came if nothing else min(rejected, came)
            text = f"{lost} of {came} bytes make no frame of {intake.codec}"
            text = f"{text}{self._hint_of_format(intake)}" if wrong else ""
            yield _Finding(intake.name, "format", text)
        for name, ingest in intake.ingests.items():
            yield from self._of_kind(name, ingest)
            if isinstance(ingest, ImuIngest):
                samples = self._more(name, "samples", ingest.counts.measurements)
                yield from self._of_imu(name, ingest, samples / span_s)

    def _hint_of_format(self, intake: Intake) -> str:
        """Whose bytes they may be that come on a line."""
        for other in self._intakes:
            if other.codec != intake.codec and other.reads(intake.newest):
                return f", but of {other.codec}, as {other.name} is said to speak: cables swapped?"
        return ": its codec, options or baud rate?"

    def _of_kind(self, name: str, ingest: Ingest) -> Iterator[_Finding]:
        """Sentences that can be read, none of which is of the kind of their device."""
        kind = self._kinds[name]
        if kind not in _STEADY:
            return
        counts = ingest.counts
        strange = self._more(name, "strange", counts.ignored[f"not_{kind}"])
        own = self._more(name, "own", counts.records - counts.ignored[f"not_{kind}"])
        if strange or own:
            text = f"{strange} sentences came, and none of a {kind} device: another one's cable?"
            yield _Finding(name, "kind", "" if own else text)

    def _more(self, of: str, what: str, total: int) -> int:
        """By how much a running total has grown since the last window."""
        before = self._totals.get((of, what), 0)
        self._totals[of, what] = total
        return total - before

    def _of_imu(self, name: str, ingest: ImuIngest, rate_hz: float) -> Iterator[_Finding]:
        felt = ingest.felt.look()
        self._rates = [*self._rates[-2:], rate_hz]
        if len(self._rates) == 3 and _alike(self._rates):  # no cable was out
            wrong = abs(rate_hz - ingest.rate_hz) > RATE_SHARE * ingest.rate_hz
            text = f"{rate_hz:.0f} samples a second, rate_hz says {ingest.rate_hz:g}"
            yield _Finding(name, "rate", text if wrong else "")
        if felt is None:
            return
        force, turn_rad_s = felt
        yield _Finding(name, "gravity", _of_gravity(*force))
        turn_deg_s = math.degrees(turn_rad_s)
        text = (
            f"turns by {turn_deg_s:.0f} deg a second all the time: the unit of its gyros (options)?"
        )
        yield _Finding(name, "turning", text if turn_deg_s > SPIN_DEG_S else "")

    def _of_fixes(self) -> Iterator[_Finding]:
        for device in self._used | self._refused:
            used, refused = self._used[device], self._refused[device]
            if used + refused >= FIXES:
                del self._used[device], self._refused[device]
                hint = _HINTS[self._kinds[device]]
                text = f"{refused} of {used + refused} fixes do not fit: {hint}?"
                yield _Finding(device, "fit of fixes", text if refused > used else "")

    def _of_beacons(self) -> Iterator[_Finding]:
        """Fixes of a beacon that is not known, and no others."""
        strange, known = self._strange, self._known
        self._strange, self._known = {}, set()
        for device, beacon in strange.items():
            text = f'hears beacon "{beacon}", of which the configuration does not know'
            yield _Finding(device, "beacon", "" if device in known else text)


def _alike(rates_hz: Sequence[float]) -> bool:
    """Whether a unit spoke, and steadily."""
    return 0.0 < max(rates_hz) < (1.0 + RATE_SHARE) * min(rates_hz)


def _of_gravity(x: float, y: float, z: float) -> str:
    """What is wrong with a mean specific force in body axes; at rest it is up, by gravity."""
    size = math.hypot(x, y, z)
    if abs(size - GRAVITY_M_S2) > FORCE_OFF_M_S2:
        return (
            f"feels {size:.3g} m/s2 where gravity is 9.8: the unit of its accelerometers (options)?"
        )
    if -z >= UPRIGHT_COS * size:
        return ""
    axes = (("forward", x), ("starboard", y), ("down", z))
    name, value = max(axes, key=lambda axis: abs(axis[1]))
    opposite = {"forward": "astern", "starboard": "port", "down": "up"}
    up = name if value > 0.0 else opposite[name]
    return f"by gravity the sky is {up} of the vehicle's axes: its mounting_deg?"
