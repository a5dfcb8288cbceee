"""Frames and capture files built by dpkt, which knows the formats independently of this project."""

import gzip
import io
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import dpkt

A4, B4 = bytes([10, 0, 0, 1]), bytes([10, 0, 0, 2])
A6, B6 = b"\xfd" + bytes(14) + b"\x01", b"\xfd" + bytes(14) + b"\x02"
T0_NS = 1_780_000_000_123_456_789


def udp4(
    payload: bytes, sport: int = 4000, dport: int = 7001, src: bytes = A4, dst: bytes = B4
) -> dpkt.ip.IP:
    udp = dpkt.udp.UDP(sport=sport, dport=dport, data=payload, ulen=8 + len(payload))
    return dpkt.ip.IP(src=src, dst=dst, p=17, data=udp)


def udp6(payload: bytes, sport: int = 4000, dport: int = 7001) -> dpkt.ip6.IP6:
    udp = dpkt.udp.UDP(sport=sport, dport=dport, data=payload, ulen=8 + len(payload))
    return dpkt.ip6.IP6(src=A6, dst=B6, nxt=17, plen=len(udp), hlim=64, data=udp)


def tcp4(
    payload: bytes,
    sequence: int,
    flags: int = dpkt.tcp.TH_ACK,
    sport: int = 4001,
    dport: int = 50_000,
    src: bytes = A4,
) -> dpkt.ip.IP:
    tcp = dpkt.tcp.TCP(
        sport=sport, dport=dport, seq=sequence % 2**32, flags=flags, data=payload, opts=b"\1\1\1\0"
    )
    tcp.off = 6
    return dpkt.ip.IP(src=src, dst=B4, p=6, data=tcp)


def ethernet(ip: dpkt.Packet) -> bytes:
    kind = 0x86DD if isinstance(ip, dpkt.ip6.IP6) else 0x0800
    return bytes(dpkt.ethernet.Ethernet(src=b"\2" * 6, dst=b"\4" * 6, type=kind, data=bytes(ip)))


def pcap(
    frames: Iterable[bytes],
    linktype: int = 1,
    t0_ns: int = T0_NS,
    step_ns: int = 1_000_000,
    nano: bool = True,
) -> bytes:
    """A capture whose frames are `step_ns` apart."""
    file = io.BytesIO()
    writer = dpkt.pcap.Writer(file, linktype=linktype, nano=nano)
    for n, frame in enumerate(frames):
        writer.writepkt(frame, Fraction(t0_ns + n * step_ns, 10**9))
    return file.getvalue()


def pcapng(frames: Iterable[bytes], t0_us: int = T0_NS // 1000, step_us: int = 1000) -> bytes:
    """A capture of Ethernet in pcapng, microseconds."""
    file = io.BytesIO()
    writer = dpkt.pcapng.Writer(file)
    for n, frame in enumerate(frames):
        writer.writepkt(frame, Fraction(t0_us + n * step_us, 10**6))
    return file.getvalue()


def save(folder: Path, data: bytes, name: str = "x.pcap", gzipped: bool = False) -> Path:
    path = folder / name
    path.write_bytes(gzip.compress(data) if gzipped else data)
    return path
