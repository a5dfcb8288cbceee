"""From a captured frame to what UDP or TCP carries in it.

Link headers: Ethernet, Linux cooked (both), raw IP, BSD loopback; VLAN tags, stacked too. IPv4 with
options, IPv6 with extension headers. A frame that yields nothing gives one of `Skipped`.
"""

import struct
from collections.abc import Callable
from enum import Enum
from typing import NamedTuple

ETHERNET = 1
_IPV4, _IPV6 = 0x0800, 0x86DD
_VLAN_TAGS = frozenset({0x8100, 0x88A8, 0x9100})
_LOOPBACK_FAMILIES = {2: _IPV4, 10: _IPV6, 24: _IPV6, 28: _IPV6, 30: _IPV6}  # Linux, BSDs, macOS
_TCP, _UDP = 6, 17
_FRAGMENT, _AUTHENTICATION = 44, 51
_EXTENSIONS = frozenset({0, 43, _AUTHENTICATION, 60, 135, 139, 140})

_ETHERNET_IPV4_UDP = struct.Struct(">12xHBxHxxHxB2x4s4sHHH")
_IPV4_HEADER = struct.Struct(">BxHHHxBxx4s4s")
_IPV6_HEADER = struct.Struct(">B3xHBx16s16s")
_FRAGMENT_HEADER = struct.Struct(">BxHI")
_UDP_HEADER = struct.Struct(">HHH2x")
_TCP_HEADER = struct.Struct(">HHI4xBB6x")
_U16 = struct.Struct(">H")

_OFFSET_OR_MORE = 0x3FFF


class Datagram(NamedTuple):
    """What UDP carried; addresses packed (4 or 16 bytes)."""

    src: bytes
    dst: bytes
    sport: int
    dport: int
    payload: bytes


class Segment(NamedTuple):
    """What TCP carried, with the sequence number of its first byte; addresses packed."""

    src: bytes
    dst: bytes
    sport: int
    dport: int
    sequence: int
    flags: int
    payload: bytes


class Fragment(NamedTuple):
    """Part of an IP packet: `payload` belongs `offset` bytes into it."""

    src: bytes
    dst: bytes
    protocol: int
    identification: int
    offset: int
    more: bool
    payload: bytes


class Skipped(Enum):
    """Why a frame yields nothing."""

    OTHER = "neither UDP nor TCP"
    LINK_TYPE = "link type not known"
    CUT = "cut short by the capture's snap length"
    DAMAGED = "headers damaged"


Content = Datagram | Segment | Fragment | Skipped


def decode(linktype: int, frame: bytes) -> Content:
    """What one captured frame carries."""
    if linktype == ETHERNET and len(frame) >= 42:  # nearly every frame of nearly every capture
        (ethertype, version, total, fragment, protocol, src, dst, sport, dport, size) = (
            _ETHERNET_IPV4_UDP.unpack_from(frame)
        )
        plain = protocol == _UDP and ethertype == _IPV4 and version == 0x45
        if plain and not fragment & _OFFSET_OR_MORE and 8 <= size <= total - 20:
            end = 34 + size
            if end <= len(frame):
                return Datagram(src, dst, sport, dport, frame[42:end])
    link = _LINKS.get(linktype)
    if link is None:
        return Skipped.LINK_TYPE
    try:
        ethertype, start = link(frame)
        while ethertype in _VLAN_TAGS:
            ethertype, start = _u16(frame, start + 2), start + 4
        if ethertype == _IPV4:
            return _ipv4(frame, start)
        return _ipv6(frame, start) if ethertype == _IPV6 else Skipped.OTHER
    except (struct.error, IndexError):
        return Skipped.DAMAGED


def transport(protocol: int, src: bytes, dst: bytes, data: bytes) -> Content:
    """What a whole IP payload carries."""
    try:
        while protocol in _EXTENSIONS:
            unit, first = (4, 2) if protocol == _AUTHENTICATION else (8, 1)
            protocol, data = data[0], data[(data[1] + first) * unit :]
        if protocol == _FRAGMENT:
            return _ipv6_fragment(src, dst, data)
        if protocol == _UDP:
            sport, dport, size = _UDP_HEADER.unpack_from(data)
            if not 8 <= size <= len(data):
                return Skipped.DAMAGED
            return Datagram(src, dst, sport, dport, data[8:size])
        if protocol == _TCP:
            sport, dport, sequence, words, flags = _TCP_HEADER.unpack_from(data)
            header = (words >> 4) * 4
            if not 20 <= header <= len(data):
                return Skipped.DAMAGED
            return Segment(src, dst, sport, dport, sequence, flags, data[header:])
    except (struct.error, IndexError):
        return Skipped.DAMAGED
    return Skipped.OTHER


def _ipv4(frame: bytes, start: int) -> Content:
    version, total, identification, fragment, protocol, src, dst = _IPV4_HEADER.unpack_from(
        frame, start
    )
    header = (version & 15) * 4
    total = total or len(frame) - start  # 0: the adapter was to cut it up (TSO)
    if version >> 4 != 4 or not 20 <= header <= total:
        return Skipped.DAMAGED
    if start + total > len(frame):
        return Skipped.CUT
    payload = frame[start + header : start + total]
    if fragment & _OFFSET_OR_MORE:
        offset, more = (fragment & 0x1FFF) * 8, bool(fragment & 0x2000)
        return Fragment(src, dst, protocol, identification, offset, more, payload)
    return transport(protocol, src, dst, payload)


def _ipv6(frame: bytes, start: int) -> Content:
    version, size, protocol, src, dst = _IPV6_HEADER.unpack_from(frame, start)
    start += _IPV6_HEADER.size
    size = size or len(frame) - start
    if version >> 4 != 6:
        return Skipped.DAMAGED
    if start + size > len(frame):
        return Skipped.CUT
    return transport(protocol, src, dst, frame[start : start + size])


def _ipv6_fragment(src: bytes, dst: bytes, data: bytes) -> Content:
    protocol, place, identification = _FRAGMENT_HEADER.unpack_from(data)
    offset, more = place & 0xFFF8, bool(place & 1)
    payload = data[_FRAGMENT_HEADER.size :]
    if offset or more:
        return Fragment(src, dst, protocol, identification, offset, more, payload)
    return transport(protocol, src, dst, payload)


def _u16(frame: bytes, position: int) -> int:
    value: int = _U16.unpack_from(frame, position)[0]
    return value


def _loopback(frame: bytes) -> tuple[int, int]:
    # Its family is in the byte order of the host that captured, which is not ours to know.
    family = min(int.from_bytes(frame[:4], "little"), int.from_bytes(frame[:4], "big"))
    return _LOOPBACK_FAMILIES.get(family, 0), 4


def _raw(frame: bytes) -> tuple[int, int]:
    return {4: _IPV4, 6: _IPV6}.get(frame[0] >> 4, 0), 0


_LINKS: dict[int, Callable[[bytes], tuple[int, int]]] = {
    0: _loopback,
    ETHERNET: lambda frame: (_u16(frame, 12), 14),
    12: _raw,
    14: _raw,
    101: _raw,
    108: _loopback,
    113: lambda frame: (_u16(frame, 14), 16),
    228: _raw,
    229: _raw,
    276: lambda frame: (_u16(frame, 0), 20),
}
"""Link type -> function giving the ethertype of what follows, and where it begins."""
