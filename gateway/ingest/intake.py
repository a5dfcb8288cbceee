"""A line's whole way in: one decoder, and of its records to each device those of its kind."""

from collections.abc import Mapping
from functools import partial
from typing import Protocol

from drivers.records import (
    DepthRecord,
    DvlRecord,
    GnssRecord,
    HeadingRecord,
    ImuRecord,
    LblRecord,
    Record,
    Rejected,
    TimeRecord,
    UsblRecord,
)
from drivers.senders import Senders
from gateway.clock import ClockMemory, ClockReport, Clocks
from gateway.config import (
    Config,
    DepthDevice,
    Device,
    DeviceKind,
    DvlDevice,
    GnssDevice,
    HeadingDevice,
    ImuDevice,
    LblDevice,
    UsblDevice,
    wire_format,
)
from gateway.ingest.aiding import depth_ingest, dvl_ingest, heading_ingest
from gateway.ingest.device import DeviceCounts
from gateway.ingest.gnss import GnssIngest
from gateway.ingest.imu import ImuIngest
from gateway.ingest.lbl import LblIngest, Sea
from gateway.ingest.usbl import UsblIngest
from gateway.messages import Measurement

_RECORDS: dict[DeviceKind, tuple[type, ...]] = {
    "imu": (ImuRecord,),
    "usbl": (UsblRecord,),
    "lbl": (LblRecord,),
    "gnss": (GnssRecord, TimeRecord),
    "depth": (DepthRecord,),
    "dvl": (DvlRecord,),
    "heading": (HeadingRecord,),
}
NEWEST_BYTES = 1024


class Ingest(Protocol):
    """One device's way from records to measurements."""

    counts: DeviceCounts

    def take(self, record: Record | Rejected) -> None:
        """Take the next record of the device."""
        ...

    def end_of_chunk(self) -> None:
        """Place what came together: nothing more came with it."""
        ...

    def flush(self) -> list[Measurement]:
        """Give the measurements gathered since the last call."""
        ...

    def learn(self) -> None:
        """Learn how to place what comes next from what came."""
        ...

    def pulse(self, t_ns: int) -> None:
        """Take the moment at which a second of the device began."""
        ...

    def clock_report(self) -> ClockReport:
        """How the device's measurements are placed in time."""
        ...

    def clock_memory(self) -> dict[str, ClockMemory]:
        """What outlives this process of how they are placed, by what that goes by."""
        ...

    def resume(self, clocks: Mapping[str, ClockMemory]) -> None:
        """Go on from what an earlier process knew."""
        ...


class Intake:
    """One line's whole way in: bytes as they arrived, measurements of its devices out.

    Parameters
    ----------
    devices
        Those that share the line, by name; one alone is the usual case. Each takes the records of
        its kind. The first one names the line: what nobody takes is ignored by it, and it counts
        the line's bytes, those rejected too.

    Attributes
    ----------
    name, codec
        Of the line.
    kinds, ingests
        By device.
    senders
        Who speaks on the line.
    newest
        Bytes of the line, to see whose they are.
    """

    def __init__(self, devices: Mapping[str, Device], sea: Sea | None = None) -> None:
        self.name, first = next(iter(devices.items()))
        codec, options = wire_format(first)
        self.codec = codec.name
        self._make_decoder = partial(codec.decoder, options)
        self.senders = Senders(self._make_decoder)
        self.kinds: dict[str, DeviceKind] = {n: device.kind for n, device in devices.items()}
        self.ingests = {n: _ingest(n, device, sea or Sea()) for n, device in devices.items()}
        self._first = self.ingests[self.name]
        self._takers = {
            kind: ingest
            for name, ingest in self.ingests.items()
            for kind in _RECORDS[self.kinds[name]]
        }
        self._measured: list[Measurement] = []
        self.newest = b""

    @property
    def counts(self) -> DeviceCounts:
        """Counts of the device that names the line."""
        return self._first.counts

    def feed(self, data: bytes, t_rx_ns: int, source: str = "") -> None:
        """Take one chunk with its receive stamp, and who sent it.

        What `learn` was not asked for before is done first.
        """
        self.learn()
        self._first.counts.bytes += len(data)
        self.newest = (self.newest + data)[-NEWEST_BYTES:]
        for record in self.senders.feed(data, t_rx_ns, source):
            self._takers.get(type(record), self._first).take(record)
        self._end_of_chunk()

    def close(self) -> None:
        """End of the bytes: what waits in the decoder is decoded or rejected."""
        for record in self.senders.close():
            self._takers.get(type(record), self._first).take(record)
        self._end_of_chunk()

    def reads(self, data: bytes) -> bool:
        """Whether most of some bytes are of this line's format."""
        decoder = self._make_decoder()
        found = [*decoder.feed(data, 0), *decoder.close()]
        rejected = sum(len(one.data) for one in found if isinstance(one, Rejected))
        return 2 * rejected < len(data)

    def flush(self) -> list[Measurement]:
        """Give the measurements gathered since the last call, samples before fixes of a chunk."""
        gathered, self._measured = self._measured, []
        for ingest in self.ingests.values():
            gathered += ingest.flush()
        return gathered

    def learn(self) -> None:
        """Learn from what came how to place what comes next: no measurement waits for that."""
        for ingest in self.ingests.values():
            ingest.learn()

    def pulse(self, t_ns: int, device: str | None = None) -> None:
        """Take one edge of a device's pulse per second, by the host's monotonic clock."""
        self.learn()
        self.ingests[device or self.name].pulse(t_ns)

    def clock_report(self) -> ClockReport:
        """How the measurements of the device that names the line are placed in time."""
        return self._first.clock_report()

    def clock_memory(self) -> Clocks:
        """What outlives this process of how measurements are placed, by device."""
        return {name: ingest.clock_memory() for name, ingest in self.ingests.items()}

    def _end_of_chunk(self) -> None:
        for ingest in self.ingests.values():
            ingest.end_of_chunk()
        if len(self.ingests) > 1:
            self._keep_order()

    def _keep_order(self) -> None:
        """Samples may be gathered into longer blocks only while no fix comes between them."""
        samples = [i for i in self.ingests.values() if isinstance(i, ImuIngest)]
        fixes = [m for i in self.ingests.values() if i not in samples for m in i.flush()]
        if fixes:
            for ingest in samples:
                self._measured += ingest.flush()
            self._measured += fixes


def intakes(config: Config, clocks: Clocks | None = None) -> dict[str, Intake]:
    """By device the intake of its line, which it may share with others.

    Parameters
    ----------
    clocks
        What an earlier process knew of theirs.
    """
    sea = Sea.of(config)
    ways: dict[str, Intake] = {}
    for names in config.lines:
        intake = Intake({name: config.devices[name] for name in names}, sea)
        ways |= dict.fromkeys(names, intake)
        for name in names:
            intake.ingests[name].resume((clocks or {}).get(name, {}))
    return ways


def _ingest(name: str, device: Device, sea: Sea) -> Ingest:
    match device:
        case ImuDevice():
            return ImuIngest(device)
        case UsblDevice():
            return UsblIngest(name, device, sea.sound_speed_m_s)
        case LblDevice():
            return LblIngest(name, device, sea)
        case GnssDevice():
            return GnssIngest(name, device)
        case DepthDevice():
            return depth_ingest(name, device)
        case DvlDevice():
            return dvl_ingest(name, device)
        case HeadingDevice():
            return heading_ingest(name, device)
