"""The daemon's status: devices, filter, outputs and latencies, as others are told of them."""

import msgspec

from gateway.clock import ClockReport
from gateway.config import DeviceKind
from gateway.filter_process.host import HostStatus
from gateway.health.doubts import Doubt
from gateway.latency import StageReport
from gateway.machine.realtime import RealtimeStatus
from gateway.messages import FilterTotals
from gateway.modes import Mode
from gateway.outputs.sinks import SinkStatus
from gateway.statefile import KeeperStatus


class SenderReport(msgspec.Struct, frozen=True):
    """What became of one sender's bytes."""

    bytes: int
    records: int
    rejected_bytes: int


class LinkReport(msgspec.Struct, frozen=True):
    """The line of a device.

    Attributes
    ----------
    place
        What its messages call it; null until it was open for the first time.
    opened
        How often; once more than it was lost, while it is up.
    senders
        Who spoke on it, the last one at the end; beyond sixteen those heard longest ago are summed
        up as ``others``.
    """

    place: str | None
    up: bool
    opened: int
    bytes: int
    chunks: int
    senders: dict[str, SenderReport]


class DeviceReport(msgspec.Struct, frozen=True):
    """One device: its line, and what became of its bytes.

    ``line`` is the device that names the line: the bytes of one that several share, and what of it
    nobody takes, are counted there alone.
    """

    kind: DeviceKind
    codec: str
    line: str
    silent_s: float | None
    bytes: int
    records: int
    measurements: int
    rejected: dict[str, int]
    rejected_bytes: int
    ignored: dict[str, int]
    gaps: int
    missing: int
    refused_datagrams: int
    kernel_dropped: int
    link: LinkReport
    clock: ClockReport


class HealthReport(msgspec.Struct, frozen=True):
    """The daemon's status, as published on Zenoh."""

    vehicle: str
    t_s: float
    up_s: float
    mode: Mode
    fix_age_s: float | None
    devices: dict[str, DeviceReport]
    filter: HostStatus
    totals: FilterTotals | None
    outputs: list[SinkStatus]
    latency: list[StageReport]
    realtime: RealtimeStatus
    state_file: KeeperStatus | None
    doubts: list[Doubt] = []
