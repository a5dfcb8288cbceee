"""From a device's bytes to measurements: sensor axes to body, SI units, time of validity.

Time of validity = arrival of the frame's first byte - serial line time - declared latency. Where
the device counts or tells the time, that sets the arrivals right (`gateway.clock`): frames that
shared a chunk spread out, a missing one shows.
"""

from functools import partial
from typing import Protocol

from drivers.records import Record, Rejected
from drivers.senders import Senders
from gateway.clock import ClockReport
from gateway.config import (
    Config,
    DepthDevice,
    Device,
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

__all__ = ["DeviceCounts", "Intake", "intakes"]


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

    def pulse(self, t_ns: int) -> None:
        """Take the moment at which a second of the device began."""
        ...

    def clock_report(self) -> ClockReport:
        """How the device's measurements are placed in time."""
        ...


class Intake:
    """One device's whole way in: bytes as they arrived, measurements out."""

    def __init__(self, name: str, device: Device, sea: Sea | None = None) -> None:
        codec, options = wire_format(device)
        self.senders = Senders(partial(codec.decoder, options))
        self._ingest = _ingest(name, device, sea or Sea())
        self.counts = self._ingest.counts

    def feed(self, data: bytes, t_rx_ns: int, source: str = "") -> None:
        """Take one chunk with its receive stamp, and who sent it."""
        self.counts.bytes += len(data)
        for record in self.senders.feed(data, t_rx_ns, source):
            self._ingest.take(record)
        self._ingest.end_of_chunk()

    def close(self) -> None:
        """End of the bytes: what waits in the decoder is decoded or rejected."""
        for record in self.senders.close():
            self._ingest.take(record)
        self._ingest.end_of_chunk()

    def flush(self) -> list[Measurement]:
        """Give the measurements gathered since the last call."""
        return self._ingest.flush()

    def pulse(self, t_ns: int) -> None:
        """Take one edge of the device's pulse per second, by the host's monotonic clock."""
        self._ingest.pulse(t_ns)

    def clock_report(self) -> ClockReport:
        """How the device's measurements are placed in time, and how surely."""
        return self._ingest.clock_report()


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


def intakes(config: Config) -> dict[str, Intake]:
    """One intake for each device of the configuration."""
    sea = Sea.of(config)
    return {name: Intake(name, device, sea) for name, device in config.devices.items()}
