"""The bytes of each device, picked out of captures by its `link` settings."""

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

from drivers.capture.files import CaptureError, Packet
from drivers.capture.fragments import Fragments
from drivers.capture.packets import Datagram, Fragment, Segment, Skipped, decode
from drivers.capture.reader import read_packets
from drivers.capture.tcpstream import SYN, Piece, StreamCounts, TcpStream
from drivers.settings import Link, TcpLink, UdpLink
from drivers.sources import source_filter

SILENT_NS = 5_000_000_000
"""A connection that has carried nothing for so long gives way to another one."""


class Payload(NamedTuple):
    """Bytes of one datagram, or of a stream as they became readable.

    ``t_rx_ns``: arrival in ns, since the Unix epoch in a capture. ``source``: who sent them,
    ``address:port``, where several could have.
    """

    device: str
    data: bytes
    t_rx_ns: int
    source: str = ""


@dataclass(slots=True)
class CaptureCounts:
    """What became of the packets of a capture.

    ``packets`` = selected + not_selected + refused + undecodable + fragments.
    """

    file_bytes: int = 0
    """Read so far of the files as they are stored."""
    packets: int = 0
    selected: int = 0
    not_selected: int = 0
    """Of no device's port, or of another protocol."""
    refused: int = 0
    """To a device's port from senders its `allow` list does not name."""
    fragments: int = 0
    """Parts of IP packets, but for the part that completed one."""
    fragments_lost: int = 0
    """Those of them whose packet never became whole."""
    other_connections: int = 0
    """Among the selected: segments of connections beside the one that is followed."""
    undecodable: Counter[str] = field(default_factory=Counter)
    """By reason."""
    tcp: StreamCounts = field(default_factory=StreamCounts)

    def read(self, size: int) -> None:
        """Count bytes of a file."""
        self.file_bytes += size


def read_streams(
    paths: Iterable[Path], selectors: Mapping[str, Link], counts: CaptureCounts | None = None
) -> Iterator[Payload]:
    """Payloads of the selected devices, in file order; several captures are merged by time.

    Parameters
    ----------
    paths
        pcap or pcapng files, gzipped or not.
    selectors
        For each device where its bytes come from. UDP: the destination port, and `group` and
        `allow` where given. TCP: the server's port; its `host` too, where several devices share the
        port. A serial line selects nothing.
    counts
        What becomes of the packets is counted here, as they are read.

    Yields
    ------
    Payload
        What came for one device.

    Raises
    ------
    CaptureError
        Where a capture cannot be read further, after all that came before.
    """
    counts = CaptureCounts() if counts is None else counts
    udp, tcp = _udp_routes(selectors), _tcp_routes(selectors, counts)
    fragments = Fragments()
    try:
        for t_ns, linktype, frame in _merged(list(paths), counts):
            counts.packets += 1
            content = decode(linktype, frame)
            if type(content) is Fragment:
                content = fragments.add(content, t_ns) or content
            if type(content) is Datagram:
                yield from _heard(content, udp.get(content.dport, ()), t_ns, counts)
            elif type(content) is Segment:
                yield from _followed(content, tcp.get(content.sport, ()), t_ns, counts)
            elif type(content) is Fragment:
                counts.fragments += 1
            elif content is Skipped.OTHER:
                counts.not_selected += 1
            elif content is Skipped.LINK_TYPE:
                counts.undecodable[f"{content.value}: {linktype}"] += 1
            elif isinstance(content, Skipped):
                counts.undecodable[content.value] += 1
    except CaptureError:
        yield from _rest(tcp)
        raise
    finally:
        counts.fragments_lost = fragments.abandoned + len(fragments)
    yield from _rest(tcp)


def _merged(paths: list[Path], counts: CaptureCounts) -> Iterator[Packet]:
    captures = [read_packets(path, counts.read) for path in paths]
    if len(captures) == 1:
        return captures[0]
    return heapq.merge(*captures, key=lambda packet: packet.t_ns)


class _UdpRoute(NamedTuple):
    device: str
    group: bytes | None
    admits: Callable[[bytes], bool] | None


def _udp_routes(selectors: Mapping[str, Link]) -> dict[int, list[_UdpRoute]]:
    """Devices by destination port."""
    routes: dict[int, list[_UdpRoute]] = {}
    for device, link in selectors.items():
        if isinstance(link, UdpLink):
            group = ip_address(link.group).packed if link.group else None
            admits = source_filter(link.allow) if link.allow else None
            routes.setdefault(link.port, []).append(_UdpRoute(device, group, admits))
    return routes


def _heard(
    datagram: Datagram, routes: Sequence[_UdpRoute], t_ns: int, counts: CaptureCounts
) -> list[Payload]:
    heard = []
    refused = False
    for device, group, admits in routes:
        if group is not None and group != datagram.dst:
            continue
        if admits is not None and not admits(datagram.src):
            refused = True
            continue
        source = _sender(datagram.src, datagram.sport)
        heard.append(Payload(device, datagram.payload, t_ns, source))
    if heard:
        counts.selected += 1
    elif refused:
        counts.refused += 1
    else:
        counts.not_selected += 1
    return heard


class _TcpRoute:
    """The one connection that a device's bytes are taken from.

    A server may have several clients, each of whom it sends the same: the newest is followed, until
    it ends or falls silent.
    """

    def __init__(self, device: str, host: bytes | None, counts: CaptureCounts) -> None:
        self.device = device
        self.host = host
        self._counts = counts
        self._connection: tuple[bytes, bytes, int, int] | None = None
        self._stream = TcpStream(counts.tcp)
        self._heard_ns = 0

    def add(self, segment: Segment, t_ns: int) -> list[Piece]:
        pieces: list[Piece] = []
        if segment[:4] != self._connection:
            if not self._gives_way(segment, t_ns):
                self._counts.other_connections += 1
                return []
            pieces = self._stream.close()
            self._stream = TcpStream(self._counts.tcp)
            self._connection = segment[:4]
        pieces += self._stream.add(segment.sequence, segment.flags, segment.payload, t_ns)
        if segment.payload:
            self._heard_ns = t_ns
        return pieces

    def close(self) -> list[Piece]:
        return self._stream.close()

    def _gives_way(self, segment: Segment, t_ns: int) -> bool:
        if segment.flags & SYN:
            return True
        over = self._stream.ended or t_ns - self._heard_ns > SILENT_NS
        return bool(segment.payload) and (self._connection is None or over)


def _tcp_routes(selectors: Mapping[str, Link], counts: CaptureCounts) -> dict[int, list[_TcpRoute]]:
    """Devices by their servers' port."""
    ports = Counter(link.port for link in selectors.values() if isinstance(link, TcpLink))
    routes: dict[int, list[_TcpRoute]] = {}
    for device, link in selectors.items():
        if isinstance(link, TcpLink):
            host = _packed(link.host) if ports[link.port] > 1 else None
            routes.setdefault(link.port, []).append(_TcpRoute(device, host, counts))
    return routes


def _followed(
    segment: Segment, routes: Sequence[_TcpRoute], t_ns: int, counts: CaptureCounts
) -> list[Payload]:
    followed = [route for route in routes if route.host is None or route.host == segment.src]
    if followed:
        counts.selected += 1
    else:
        counts.not_selected += 1
    return [
        Payload(route.device, data, t_piece)
        for route in followed
        for data, t_piece in route.add(segment, t_ns)
    ]


def _rest(tcp: Mapping[int, list[_TcpRoute]]) -> Iterator[Payload]:
    for routes in tcp.values():
        for route in routes:
            yield from (Payload(route.device, data, t_ns) for data, t_ns in route.close())


@lru_cache(maxsize=1024)
def _sender(address: bytes, port: int) -> str:
    host = str(ip_address(address))
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _packed(host: str) -> bytes | None:
    """Address of a host; None for a name, which a capture cannot resolve."""
    try:
        return ip_address(host).packed
    except ValueError:
        return None
