"""Datagrams as a capture file: pcap with nanosecond times, Ethernet, IPv4, UDP."""

import socket
import struct
from pathlib import Path
from typing import BinaryIO

_MAGIC_NS = 0xA1B23C4D
_LINKTYPE_ETHERNET = 1
_SNAPLEN = 65535
_ETHERNET = bytes.fromhex("020000000002 020000000001 0800")
"""Locally administered addresses, EtherType IPv4."""
_PROTOCOL_UDP = 17


class PcapWriter:
    """Writes datagrams with their times; use as a context manager."""

    def __init__(self, path: Path) -> None:
        self._file: BinaryIO = path.open("wb")
        header = (_MAGIC_NS, 2, 4, 0, 0, _SNAPLEN, _LINKTYPE_ETHERNET)
        self._file.write(struct.pack("<IHHiIII", *header))
        self._identification = 0

    def __enter__(self) -> "PcapWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, t_ns: int, source_port: int, to: tuple[str, int], payload: bytes) -> None:
        """Append one datagram sent at ``t_ns`` (Unix, ns) to (IPv4 address, port)."""
        self._identification = (self._identification + 1) & 0xFFFF
        frame = _ETHERNET + ipv4_udp(source_port, to, payload, self._identification)
        seconds, ns = divmod(t_ns, 1_000_000_000)
        self._file.write(struct.pack("<IIII", seconds, ns, len(frame), len(frame)) + frame)


def ipv4_udp(source_port: int, to: tuple[str, int], payload: bytes, identification: int) -> bytes:
    """One IPv4 packet from the loopback address with its UDP datagram, both checksums right."""
    source, destination = socket.inet_aton("127.0.0.1"), socket.inet_aton(to[0])
    length = 8 + len(payload)
    pseudo = source + destination + struct.pack(">BBH", 0, _PROTOCOL_UDP, length)
    ports = struct.pack(">HHH", source_port, to[1], length)
    # A UDP checksum of zero means "none"; its other form in ones' complement is sent instead.
    udp_check = _checksum(pseudo + ports + b"\0\0" + payload) or 0xFFFF
    start = struct.pack(">BBHHHBB", 0x45, 0, 20 + length, identification, 0x4000, 64, _PROTOCOL_UDP)
    ip_check = _checksum(start + b"\0\0" + source + destination)
    ip = start + struct.pack(">H", ip_check) + source + destination
    return ip + ports + struct.pack(">H", udp_check) + payload


def _checksum(data: bytes) -> int:
    """Internet checksum (RFC 1071)."""
    if len(data) % 2:
        data += b"\0"
    total: int = sum(struct.unpack(f">{len(data) // 2}H", data))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF
