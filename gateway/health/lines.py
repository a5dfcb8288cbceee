"""The lines as the daemon runs them: who of their devices speaks, and what became of the bytes."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field

from drivers.links import LinkCounts
from gateway.config import DeviceKind
from gateway.health.report import DeviceReport, LinkReport, SenderReport
from gateway.ingest import Ingest, Intake

SILENT_S: dict[DeviceKind, float] = {
    "imu": 1.0,
    "usbl": 60.0,
    "lbl": 60.0,
    "gnss": 10.0,
    "depth": 10.0,
    "dvl": 10.0,
    "heading": 10.0,
}
"""Silence of an open line after which its device is called silent; USBL may interrogate slowly."""
FIRST_S = 10.0
"""How long a device may take to speak for the first time."""

_log = logging.getLogger(__name__)


@dataclass
class Voice:
    """One device as it is heard: when it spoke, and whether its silence has been said."""

    name: str
    kind: DeviceKind
    ingest: Ingest
    heard_at: float | None = None
    _records: int = field(default=0, init=False)
    _quiet_since: float | None = field(default=None, init=False)
    _said_silent: bool = field(default=False, init=False)

    def opened(self, now: float) -> None:
        """Note that its line is open."""
        self._quiet_since = now

    def heard(self, now: float) -> None:
        """Note that it spoke."""
        self.heard_at = self._quiet_since = now

    def stood_still(self, seconds: float) -> None:
        """Do not count a time in which nobody listened as silence."""
        if self._quiet_since is not None:
            self._quiet_since += seconds

    def lost(self) -> None:
        """Note that its line is gone."""
        self._quiet_since, self._said_silent = None, False

    def watch(self, now: float) -> None:
        """Say once that it is silent on an open line, and once that it speaks again."""
        if self._quiet_since is None:
            return
        quiet_s, limit_s = now - self._quiet_since, SILENT_S[self.kind]
        if self.heard_at is None:
            limit_s = max(limit_s, FIRST_S)
        if quiet_s <= limit_s and self._said_silent:
            _log.info("%s: speaks", self.name)
        elif quiet_s > limit_s and not self._said_silent:
            _log.warning("%s: silent for %.0f s", self.name, quiet_s)
        self._said_silent = quiet_s > limit_s

    def listen(self, now: float) -> None:
        """Find by its records whether it spoke, where bytes of a line may be another's."""
        records, self._records = self._records, self.ingest.counts.records
        if self._records > records:
            self.heard(now)


@dataclass
class Line:
    """One line as the daemon runs it, with the devices that share it."""

    intake: Intake
    link: LinkCounts = field(default_factory=LinkCounts)
    place: str | None = None
    up: bool = False
    times_opened: int = 0
    voices: list[Voice] = field(init=False)

    def __post_init__(self) -> None:
        kinds = self.intake.kinds
        self.voices = [Voice(n, kinds[n], ingest) for n, ingest in self.intake.ingests.items()]

    @property
    def name(self) -> str:
        """That of its first device."""
        return self.intake.name

    def opened(self, now: float, place: str) -> None:
        """Note that the line is open, and what it is called."""
        self.place, self.up = place, True
        self.times_opened += 1
        for voice in self.voices:
            voice.opened(now)

    def heard(self, now: float) -> None:
        """Note that bytes came; of whom among several, their records tell."""
        if len(self.voices) == 1:
            self.voices[0].heard(now)

    def lost(self) -> None:
        """Note that the line is gone, which is said by those who try to open it again."""
        self.up = False
        for voice in self.voices:
            voice.lost()

    def stood_still(self, seconds: float) -> None:
        """Do not count a time in which nobody listened as silence."""
        for voice in self.voices:
            voice.stood_still(seconds)

    def watch(self, now: float) -> None:
        """Say of whom nothing is heard."""
        for voice in self.voices:
            if len(self.voices) > 1:
                voice.listen(now)
            voice.watch(now)

    def reports(self, now: float) -> Iterator[tuple[str, DeviceReport]]:
        """By device its counts and its line's, of which the first one has the bytes."""
        link = self._link_report()
        for voice in self.voices:
            counts, heard_at = voice.ingest.counts, voice.heard_at
            yield (
                voice.name,
                DeviceReport(
                    kind=voice.kind,
                    codec=self.intake.codec,
                    line=self.name,
                    silent_s=None if heard_at is None else round(now - heard_at, 2),
                    bytes=counts.bytes,
                    records=counts.records,
                    measurements=counts.measurements,
                    rejected=dict(counts.rejected),
                    rejected_bytes=counts.rejected_bytes,
                    ignored=dict(counts.ignored),
                    gaps=counts.gaps,
                    missing=counts.missing,
                    refused_datagrams=self.link.refused,
                    kernel_dropped=self.link.kernel_dropped,
                    link=link,
                    clock=voice.ingest.clock_report(),
                ),
            )

    def _link_report(self) -> LinkReport:
        senders = self.intake.senders
        counted = dict(senders.counts)
        if senders.others.bytes:
            counted["others"] = senders.others
        return LinkReport(
            place=self.place,
            up=self.up,
            opened=self.times_opened,
            bytes=self.link.bytes,
            chunks=self.link.chunks,
            senders={
                who: SenderReport(told.bytes, told.records, told.rejected_bytes)
                for who, told in counted.items()
            },
        )
