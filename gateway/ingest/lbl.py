"""Replies of moored transponders to ranges, each at its own reception, with the ping they share."""

from dataclasses import dataclass, field

from drivers.records import LblRecord, LblReply, Record, Rejected
from gateway.config import Config, LblDevice
from gateway.ingest.device import FixIngest
from gateway.messages import BeaconRange, RadialRate


@dataclass(frozen=True)
class Sea:
    """What an interrogator's times mean: the nominal speed of sound, and who answers how.

    ``turnaround_s`` by beacon; ``one_way`` names those that send by the clock, unasked.
    """

    sound_speed_m_s: float = 1500.0
    turnaround_s: dict[str, float] = field(default_factory=dict)
    one_way: frozenset[str] = frozenset()

    @classmethod
    def of(cls, config: Config) -> "Sea":
        """The sea of a configuration."""
        beacons = config.moored.items()
        return cls(
            config.sound_speed_m_s,
            {name: beacon.turnaround_ms * 1e-3 for name, beacon in beacons},
            frozenset(name for name, beacon in beacons if beacon.travel == "one_way"),
        )


class LblIngest(FixIngest):
    """Replies to ranges.

    The sentence comes when the last transponder has answered, so that reply is as old as the
    latency says and the others follow from it. Where one does not answer, the sentence waits for a
    time-out that is not in it: its replies have no time then, unless the instrument tells the
    ping's and its clock is wanted.
    """

    def __init__(self, name: str, device: LblDevice, sea: Sea) -> None:
        super().__init__(device)
        self._name = name
        self._sea = sea
        self._asked = frozenset(device.beacons or sea.turnaround_s)

    def take(self, record: Record | Rejected) -> None:
        """Take the next record; what makes no range counts."""
        if not self._count(record):
            return
        if not isinstance(record, LblRecord):
            self.counts.ignored["not_lbl"] += 1
        elif not record.valid or not record.replies:
            self.counts.ignored["no_reply" if record.valid else "invalid"] += 1
        elif record.t_ping_s is not None and not self._knows_the_ping(record):
            self.counts.ignored["incomplete"] += 1
        else:
            self._take_replies(record)

    def _knows_the_ping(self, record: LblRecord) -> bool:
        """By the instrument's clock, or because nobody was waited for in vain."""
        complete = self._asked <= {reply.beacon for reply in record.replies}
        return self._wants_device_time or complete

    def _take_replies(self, record: LblRecord) -> None:
        """Place every reply of one ping; a radial rate is a measurement of its own."""
        t_last_ns = self._left_instrument_ns(record)
        waits_s = {reply: self._wait_s(reply) for reply in record.replies}
        latest_ns = t_last_ns - round(1e9 * max(waits_s.values()))
        t_ping_ns = self._told_ns(record.t_ping_s, latest_ns)
        for reply, wait_s in waits_s.items():
            t_ns = t_ping_ns + round(1e9 * wait_s)
            range_m = self._range_m(reply)
            if range_m is not None:
                sent_ns = None if record.t_ping_s is None else t_ping_ns
                self._fixes.append(BeaconRange(t_ns, self._name, reply.beacon, range_m, sent_ns))
            if reply.range_rate_m_s is not None:
                rates = (reply.range_rate_m_s,)
                self._fixes.append(RadialRate(t_ns, self._name, reply.beacon, rates))

    def _range_m(self, reply: LblReply) -> float | None:
        if reply.one_way_s is None:
            return reply.range_m
        return reply.one_way_s * self._sea.sound_speed_m_s

    def _wait_s(self, reply: LblReply) -> float:
        """From the ping to the reply's reception."""
        range_m = self._range_m(reply) or 0.0
        ways = 1 if reply.beacon in self._sea.one_way else 2
        turnaround_s = self._sea.turnaround_s.get(reply.beacon, 0.0)
        return ways * range_m / self._sea.sound_speed_m_s + turnaround_s
