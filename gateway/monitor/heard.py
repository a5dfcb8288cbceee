"""What has been heard of one vehicle: the newest of each topic, what went before, and rates."""

import time
from collections import deque
from collections.abc import Callable

import msgspec

from gateway.health import HealthReport
from gateway.monitor.alarms import Alarm, Alarms, Severity
from gateway.outputs.schema import InnovationReport, NavReport, TargetReport

TRACK = 600
"""Positions kept for the picture, one a second."""
INNOVATIONS = 20
REPORTS = 11
"""Reports of health kept for rates, one a second: what comes every two seconds is no 0 and 1."""
SILENT_S = 3.0
"""A gateway that has said nothing for so long is lost."""


class Heard:
    """The newest words of one gateway.

    Attributes
    ----------
    nav, status
        None before the first.
    innovations
        The last ones, oldest first.
    track
        Solutions about a second apart, oldest first.
    targets
        The last word of each target, by name.
    unread
        Messages that could not be read: they are of another version.
    """

    def __init__(self, vehicle: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.vehicle = vehicle
        self.nav: NavReport | None = None
        self.status: HealthReport | None = None
        self.innovations: deque[InnovationReport] = deque(maxlen=INNOVATIONS)
        self.track: deque[NavReport] = deque(maxlen=TRACK)
        self.targets: dict[str, TargetReport] = {}
        self.unread = 0
        self._reports: deque[HealthReport] = deque(maxlen=REPORTS)
        self._alarms = Alarms()
        self._found: list[Alarm] = []
        self._clock = clock
        self._at = clock()

    @property
    def silent_s(self) -> float:
        """Since the last word."""
        return self._clock() - self._at

    def take(self, topic: str, payload: bytes) -> None:
        """Take one message."""
        self._at = self._clock()
        try:
            match topic:
                case "nav":
                    self._solved(msgspec.json.decode(payload, type=NavReport))
                case "status":
                    self._told(msgspec.json.decode(payload, type=HealthReport))
                case "innovation":
                    innovation = msgspec.json.decode(payload, type=InnovationReport)
                    self.innovations.append(innovation)
                case _ if topic.startswith("target/"):
                    target = msgspec.json.decode(payload, type=TargetReport)
                    self.targets[target.name] = target
                case _:
                    pass
        except msgspec.DecodeError:
            self.unread += 1

    def alarms(self) -> list[Alarm]:
        """What is not as it should be, the worst first."""
        alarms = list(self._found)
        if self.silent_s > SILENT_S:
            said = f"nothing heard for {self.silent_s:.0f} s"
            alarms.insert(0, Alarm(Severity.ALARM, "gateway silent", "", said))
        if self.unread:
            said = f"{self.unread} messages are of another version of usblnav"
            alarms.append(Alarm(Severity.NOTICE, "other version", "", said))
        return alarms

    def records_hz(self, device: str) -> float | None:
        """Records a second of a device, over the last ten seconds."""
        return self._rate(lambda report: report.devices[device].records)

    def sent_hz(self, k: int) -> float | None:
        """Payloads a second of the k-th output."""
        return self._rate(lambda report: report.outputs[k].sent)

    def _rate(self, count: Callable[[HealthReport], int]) -> float | None:
        if len(self._reports) < 2:
            return None
        first, last = self._reports[0], self._reports[-1]
        return (count(last) - count(first)) / (last.up_s - first.up_s)

    def _solved(self, nav: NavReport) -> None:
        self.nav = nav
        if not self.track or not 0.0 <= nav.t_s - self.track[-1].t_s < 1.0:
            self.track.append(nav)

    def _told(self, status: HealthReport) -> None:
        before = self.status
        if before and (
            status.up_s <= before.up_s or status.devices.keys() != before.devices.keys()
        ):
            self._reports.clear()  # another run
        self.status = status
        self._reports.append(status)
        self._found = self._alarms.take(status)
