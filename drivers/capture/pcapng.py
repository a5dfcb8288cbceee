"""Packets of a pcapng file: any number of sections and interfaces, each with its own clock units.

Every block: type (4), total length (4), body, total length again (4).
Read are the section header, the interface description with ``if_tsresol`` and ``if_tsoffset``, and
enhanced, simple and (obsolete) packet blocks; all others are passed over.
"""

import struct
from collections.abc import Iterator
from typing import NamedTuple

from drivers.capture.files import MAX_PACKET, Packet, Source

MAGIC = bytes.fromhex("0a0d0d0a")

_SECTION, _INTERFACE, _PACKET, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 2, 3, 6
_ORDERS = {bytes.fromhex("4d3c2b1a"): "<", bytes.fromhex("1a2b3c4d"): ">"}
_OVERHEAD = 12
_IF_TSRESOL, _IF_TSOFFSET = 9, 14
_NS = 1_000_000_000


class _Interface(NamedTuple):
    """Time (ns) = ticks * multiplier // divisor + offset_ns."""

    linktype: int
    snap_bytes: int
    multiplier: int
    divisor: int
    offset_ns: int


class _Block(NamedTuple):
    kind: int
    order: str
    body: bytes
    left: int
    """Bytes read ahead from the block's start on: its place for an error message."""


def pcapng_packets(source: Source, start: bytes) -> Iterator[Packet]:
    """Packets of a pcapng file whose first bytes are `start`.

    A simple packet block carries no time: it is given that of the packet before it.

    Raises
    ------
    CaptureError
        Where it is cut off or damaged, after the packets before that.
    """
    interfaces: list[_Interface] = []
    t_ns = 0
    for block in _blocks(source, start):
        try:
            if block.kind == _ENHANCED or block.kind == _PACKET:
                packet = _timed_packet(block, interfaces)
            elif block.kind == _SIMPLE:
                packet = _simple_packet(block, interfaces, t_ns)
            else:
                if block.kind == _SECTION:
                    interfaces = []
                elif block.kind == _INTERFACE:
                    interfaces.append(_interface(block))
                continue
        except (struct.error, IndexError, ValueError):
            raise source.damaged(block.left, f"block of type {block.kind}") from None
        t_ns = packet.t_ns
        source.good += 1
        yield packet


def _blocks(source: Source, data: bytes) -> Iterator[_Block]:
    order, position = "<", 0
    while data:
        while len(data) - position >= _OVERHEAD:
            left = len(data) - position
            if data.startswith(MAGIC, position):
                order = _ORDERS.get(data[position + 8 : position + 12], "")
                if not order:
                    raise source.damaged(left, "section without a byte order")
            kind, size = struct.unpack_from(order + "2I", data, position)
            if size % 4 or not _OVERHEAD <= size <= MAX_PACKET:
                raise source.damaged(left, f"a block of {size} bytes")
            if size > left:
                break
            end = position + size
            if struct.unpack_from(order + "I", data, end - 4)[0] != size:
                raise source.damaged(left, "a block's two lengths differ")
            yield _Block(kind, order, data[position + 8 : end - 4], left)
            position = end
        data, position = source.further(data[position:]), 0


def _interface(block: _Block) -> _Interface:
    linktype, snap_bytes = struct.unpack_from(block.order + "HxxI", block.body)
    multiplier, divisor, offset_ns = _NS, 10**6, 0
    for code, value in _options(block, 8):
        if code == _IF_TSRESOL:
            digits = value[0] & 0x7F
            divisor = 2**digits if value[0] & 0x80 else 10**digits
        elif code == _IF_TSOFFSET:
            offset_ns = struct.unpack(block.order + "q", value)[0] * _NS
    if multiplier % divisor == 0:
        multiplier, divisor = multiplier // divisor, 1
    return _Interface(linktype, snap_bytes or MAX_PACKET, multiplier, divisor, offset_ns)


def _options(block: _Block, position: int) -> Iterator[tuple[int, bytes]]:
    while position + 4 <= len(block.body):
        code, size = struct.unpack_from(block.order + "2H", block.body, position)
        if code == 0:
            return
        yield code, block.body[position + 4 : position + 4 + size]
        position += 4 + (size + 3) // 4 * 4


def _timed_packet(block: _Block, interfaces: list[_Interface]) -> Packet:
    layout = "5I" if block.kind == _ENHANCED else "HxxI3I"  # the obsolete one counts drops, too
    number, high, low, size, _original = struct.unpack_from(block.order + layout, block.body)
    linktype, _snap, multiplier, divisor, offset_ns = interfaces[number]
    if size > len(block.body) - 20:
        raise ValueError("longer than its block")
    t_ns = ((high << 32) | low) * multiplier
    if divisor != 1:
        t_ns //= divisor
    return Packet(t_ns + offset_ns, linktype, block.body[20 : 20 + size])


def _simple_packet(block: _Block, interfaces: list[_Interface], t_ns: int) -> Packet:
    original = struct.unpack_from(block.order + "I", block.body)[0]
    size = min(original, interfaces[0].snap_bytes)
    if size > len(block.body) - 4:
        raise ValueError("longer than its block")
    return Packet(t_ns, interfaces[0].linktype, block.body[4 : 4 + size])
