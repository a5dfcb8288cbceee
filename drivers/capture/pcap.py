"""Packets of a pcap file: microseconds or nanoseconds, either byte order.

File header: magic, version (2+2), zone (4), accuracy (4), snap length (4), link type (4).
Packet header: seconds, fraction, captured length, original length (4 each).
"""

import struct
from collections.abc import Iterator

from drivers.capture.files import MAX_PACKET, Packet, Source

_HEADER_BYTES = 24
_FORMATS = {
    bytes.fromhex("d4c3b2a1"): ("<", 1000),
    bytes.fromhex("a1b2c3d4"): (">", 1000),
    bytes.fromhex("4d3cb2a1"): ("<", 1),
    bytes.fromhex("a1b23c4d"): (">", 1),
}
MAGICS = frozenset(_FORMATS)


def pcap_packets(source: Source, block: bytes) -> Iterator[Packet]:
    """Packets of a pcap file whose first bytes are `block`.

    Raises
    ------
    CaptureError
        Where it is cut off or damaged, after the packets before that.
    """
    while len(block) < _HEADER_BYTES:
        block = source.further(block)
    order, unit_ns = _FORMATS[block[:4]]
    # The upper half of the field tells of a frame check sequence, which IP lengths trim anyway.
    linktype = struct.unpack_from(order + "I", block, 20)[0] & 0xFFFF
    header = struct.Struct(order + "4I")
    unpack, header_bytes = header.unpack_from, header.size
    position = _HEADER_BYTES
    while block:
        last = len(block) - header_bytes
        while position <= last:
            seconds, fraction, size, _original = unpack(block, position)
            start = position + header_bytes
            end = start + size
            if end > len(block):
                if size > MAX_PACKET:
                    raise source.damaged(len(block) - position, f"a packet of {size} bytes")
                break
            source.good += 1
            yield Packet(seconds * 1_000_000_000 + fraction * unit_ns, linktype, block[start:end])
            position = end
        block, position = source.further(block[position:]), 0
