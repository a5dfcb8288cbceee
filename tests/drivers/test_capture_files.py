"""Capture files: formats and byte orders, gzip, exact times, and every way to be broken."""

import gzip
import itertools
import struct
from pathlib import Path

import dpkt
import pytest

from drivers.capture import CaptureError, Packet, read_packets
from tests.drivers.frames import T0_NS, ethernet, pcap, pcapng, save, udp4
from tests.shared_data import shared

FRAMES = [ethernet(udp4(b"z" * n)) for n in (1, 2, 3, 50, 1000)]


def whole(frames: list[bytes], t0_ns: int = T0_NS, step_ns: int = 1_000_000) -> list[Packet]:
    return [Packet(t0_ns + n * step_ns, 1, frame) for n, frame in enumerate(frames)]


def read_until_error(path: Path) -> tuple[list[Packet], str]:
    packets: list[Packet] = []
    try:
        packets.extend(read_packets(path))  # keeps those before an error
    except CaptureError as error:
        return packets, str(error)
    return packets, ""


def big_endian_pcap(frames: list[bytes], magic: int) -> bytes:
    parts = [bytes(dpkt.pcap.FileHdr(magic=magic, linktype=1))]
    for n, frame in enumerate(frames):
        t_ns = T0_NS + n * 1_000_000
        unit = 1 if magic == dpkt.pcap.TCPDUMP_MAGIC_NANO else 1000
        header = dpkt.pcap.PktHdr(
            tv_sec=t_ns // 10**9,
            tv_usec=t_ns % 10**9 // unit,
            caplen=len(frame),
            len=len(frame),
        )
        parts += [bytes(header), frame]
    return b"".join(parts)


@pytest.mark.parametrize("gzipped", [False, True])
def test_pcap_nanoseconds_are_exact(tmp_path: Path, gzipped: bool) -> None:
    path = save(tmp_path, pcap(FRAMES), gzipped=gzipped)
    assert list(read_packets(path)) == whole(FRAMES)


def test_pcap_microseconds(tmp_path: Path) -> None:
    path = save(tmp_path, pcap(FRAMES, t0_ns=T0_NS // 1000 * 1000, nano=False))
    assert list(read_packets(path)) == whole(FRAMES, T0_NS // 1000 * 1000)


def test_pcap_big_endian(tmp_path: Path) -> None:
    path = save(tmp_path, big_endian_pcap(FRAMES, dpkt.pcap.TCPDUMP_MAGIC_NANO))
    assert list(read_packets(path)) == whole(FRAMES)
    path = save(tmp_path, big_endian_pcap(FRAMES, dpkt.pcap.TCPDUMP_MAGIC))
    assert list(read_packets(path)) == whole(FRAMES, T0_NS // 1000 * 1000)


def test_pcap_larger_than_a_block_streams(tmp_path: Path) -> None:
    frames = [ethernet(udp4(bytes([n % 256]) * (n % 1400))) for n in range(4000)]
    for gzipped in (False, True):
        path = save(tmp_path, pcap(frames), gzipped=gzipped)
        assert list(read_packets(path)) == whole(frames)


def test_the_check_sequence_flag_of_the_link_type_is_no_part_of_it(tmp_path: Path) -> None:
    data = bytearray(pcap(FRAMES))
    data[23] |= 0x24  # the length of the check sequence, and the bit that says it is given
    assert {packet.linktype for packet in read_packets(save(tmp_path, bytes(data)))} == {1}


@pytest.mark.parametrize("gzipped", [False, True])
def test_pcapng(tmp_path: Path, gzipped: bool) -> None:
    path = save(tmp_path, pcapng(FRAMES), gzipped=gzipped)
    assert list(read_packets(path)) == whole(FRAMES, T0_NS // 1000 * 1000)


def option(code: int, data: bytes, kind: type = dpkt.pcapng.PcapngOptionLE) -> dpkt.Packet:
    return kind(code=code, data=data)


@pytest.mark.parametrize(
    ("resolution", "ticks", "t_ns"),
    [
        (9, 1_780_000_000_123_456_789, 1_780_000_000_123_456_789),
        (6, 1_780_000_000_123_456, 1_780_000_000_123_456_000),
        (3, 1_780_000_000_123, 1_780_000_000_123_000_000),
        (0, 1_780_000_000, 1_780_000_000_000_000_000),
        (12, 1_780_000_000_123_456, 1_780_000_000_123),
        (0x80 | 10, (1_780_000_000 << 10) + 512, 1_780_000_000_500_000_000),
        (0x80 | 30, 3 << 29, 1_500_000_000),
    ],
)
@pytest.mark.parametrize("offset_s", [0, 86_400, -3600])
def test_pcapng_units_of_time(
    tmp_path: Path, resolution: int, ticks: int, t_ns: int, offset_s: int
) -> None:
    opts = [
        option(2, b"eth0"),
        option(9, bytes([resolution])),
        option(14, struct.pack("<q", offset_s)),
        option(0, b""),
    ]
    frame = FRAMES[0]
    data = b"".join(
        bytes(block)
        for block in (
            dpkt.pcapng.SectionHeaderBlockLE(),
            dpkt.pcapng.InterfaceDescriptionBlockLE(linktype=1, opts=opts),
            dpkt.pcapng.EnhancedPacketBlockLE(
                ts_high=ticks >> 32,
                ts_low=ticks & 0xFFFF_FFFF,
                caplen=len(frame),
                pkt_len=len(frame),
                pkt_data=frame,
            ),
        )
    )
    (packet,) = read_packets(save(tmp_path, data))
    assert packet == Packet(t_ns + offset_s * 10**9, 1, frame)


def test_pcapng_sections_interfaces_and_old_blocks(tmp_path: Path) -> None:
    ng, frame = dpkt.pcapng, FRAMES[3]
    simple = struct.pack("<3I", 3, 16 + 92, len(frame)) + frame.ljust(92, b"\0")
    simple += struct.pack("<I", 16 + 92)
    unknown = struct.pack("<2I", 0x0BAD, 16) + b"abcd" + struct.pack("<I", 16)
    packed = {"caplen": len(frame), "pkt_len": len(frame), "pkt_data": frame}
    blocks = [
        ng.SectionHeaderBlockLE(),
        ng.InterfaceDescriptionBlockLE(linktype=1),
        ng.InterfaceDescriptionBlockLE(linktype=101, opts=[option(9, b"\x09"), option(0, b"")]),
        ng.EnhancedPacketBlockLE(iface_id=1, ts_high=0, ts_low=77, **packed),
        unknown,
        ng.PacketBlockLE(iface_id=0, drops_count=5, ts_high=0, ts_low=88, **packed),
        simple,
        ng.SectionHeaderBlock(),
        ng.InterfaceDescriptionBlock(linktype=113),
        ng.EnhancedPacketBlock(iface_id=0, ts_high=1, ts_low=99, **packed),
        ng.PacketBlock(iface_id=0, drops_count=0, ts_high=0, ts_low=5, **packed),
    ]
    path = save(tmp_path, b"".join(bytes(block) for block in blocks))
    assert list(read_packets(path)) == [
        Packet(77, 101, frame),
        Packet(88_000, 1, frame),
        Packet(88_000, 1, frame),
        Packet((2**32 + 99) * 1000, 113, frame),
        Packet(5000, 113, frame),
    ]


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (b"", "empty file"),
        (gzip.compress(b"", mtime=0), "empty file"),
        (b"\xd4\xc3", "too short for a capture"),
        (b"$GPGGA,not a capture\r\n", "neither pcap nor pcapng"),
        (b"PK\x03\x04" + bytes(100), "neither pcap nor pcapng"),
        (b"\x1f\x8b\x08 but not really gzip", "damaged (gzip data) at byte 0"),
        (pcap([]), ""),
        (pcap([])[:20], "cut off at byte 20, after 0 good packets"),
        (pcap(FRAMES)[:-1], "after 4 good packets"),
        (gzip.compress(pcap(FRAMES), mtime=0)[:-1], "of the unpacked data, after 5 good packets"),
        (pcap(FRAMES[:1]) + b"\0" * 8 + b"\xff" * 8, "(a packet of 4294967295 bytes)"),
        (pcapng(FRAMES[:1]) + b"\6\0\0\0" + b"\xff" * 8, "(a block of 4294967295 bytes)"),
        (pcapng([])[:28] + pcapng(FRAMES[:1])[48:], "(block of type 6)"),
    ],
)
def test_unusable_files_give_one_clear_line(tmp_path: Path, data: bytes, line: str) -> None:
    path = save(tmp_path, data)
    _, error = read_until_error(path)
    assert error.startswith(f"{path}: ") == bool(line)
    assert line in error
    assert "\n" not in error


def test_an_absent_file_and_a_folder(tmp_path: Path) -> None:
    assert read_until_error(tmp_path / "no.pcap")[1].endswith("no.pcap: no such file or directory")
    assert read_until_error(tmp_path)[1] == f"{tmp_path}: is a directory"


@pytest.mark.parametrize("make", [pcap, pcapng])
def test_cut_at_every_byte_gives_the_packets_before_it(tmp_path: Path, make) -> None:
    frames = FRAMES[:4]
    data = make(frames)
    ends = [len(make(frames[:n])) for n in range(5)]
    for size in range(len(data)):
        packets, error = read_until_error(save(tmp_path, data[:size]))
        good = sum(size >= end for end in ends[1:])
        assert [packet.data for packet in packets] == frames[:good]
        if size in ends:
            assert error == ""
        elif size >= 4 and not (make is pcapng and size == 28):  # between the two header blocks
            packets_word = "packet" if good == 1 else "packets"
            assert error.endswith(f"cut off at byte {size}, after {good} good {packets_word}")


@pytest.mark.parametrize("make", [pcap, pcapng])
def test_cut_anywhere_in_gzip(tmp_path: Path, make) -> None:
    data = gzip.compress(make(FRAMES))
    for size in range(1, len(data)):
        packets, error = read_until_error(save(tmp_path, data[:size]))
        assert [packet.data for packet in packets] == FRAMES[: len(packets)]
        assert error


@pytest.mark.parametrize("make", [pcap, pcapng])
def test_any_damaged_byte_gives_packets_or_a_capture_error(tmp_path: Path, make) -> None:
    data = make(FRAMES[:3])
    for place, value in itertools.product(range(len(data)), (0x00, 0xFF, 0x80)):
        damaged = bytearray(data)
        damaged[place] ^= value or 0x01
        packets, error = read_until_error(save(tmp_path, bytes(damaged)))
        assert packets or error


def test_gzip_of_several_members_and_padding(tmp_path: Path) -> None:
    data = pcap(FRAMES)
    members = gzip.compress(data[:100]) + gzip.compress(data[100:]) + bytes(512)
    assert list(read_packets(save(tmp_path, members))) == whole(FRAMES)


def test_lawnmower_reads_like_dpkt() -> None:
    path = shared("captures", "lawnmower", "capture.pcap.gz")
    count = 5000
    with gzip.open(path) as file:
        expected = [
            (round(t * 10**9), data) for t, data in itertools.islice(dpkt.pcap.Reader(file), count)
        ]
    ours = [(packet.t_ns, packet.data) for packet in itertools.islice(read_packets(path), count)]
    assert ours == expected


def test_stdbin_pcapng_reads_like_dpkt() -> None:
    path = shared("captures", "stdbin_V3_2Hz.pcapng")
    with path.open("rb") as file:
        reader = dpkt.pcapng.Reader(file)
        expected = [(round(t * 10**6) * 1000, reader.datalink(), data) for t, data in reader]
    assert [tuple(packet) for packet in read_packets(path)] == expected
    assert len(expected) == 36
