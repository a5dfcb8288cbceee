"""Captures as the bytes of each device: selection, connections, merging, and the accounts."""

import random
from pathlib import Path

import pytest

from drivers.capture import CaptureCounts, CaptureError, StreamCounts, read_packets, read_streams
from drivers.settings import SerialLink, TcpLink, UdpLink
from tests.drivers.frames import (
    B4,
    T0_NS,
    ethernet,
    pcap,
    pcapng,
    save,
    tcp4,
    udp4,
    udp6,
)
from tests.drivers.test_capture_packets import fragments4
from tests.shared_data import shared

SYN, FIN, RST, ACK = 0x02, 0x01, 0x04, 0x10
STEP_NS = 1_000_000


def total(counts: CaptureCounts) -> int:
    return (
        counts.selected
        + counts.not_selected
        + counts.refused
        + counts.fragments
        + sum(counts.undecodable.values())
    )


def test_ports_select_devices(tmp_path: Path) -> None:
    frames = [
        ethernet(udp4(b"imu", dport=7001)),
        ethernet(udp4(b"usbl", dport=7002)),
        ethernet(udp4(b"nobody's", dport=7003)),
        ethernet(udp6(b"imu six", dport=7001)),
        ethernet(udp4(b"reply", sport=7001, dport=9)),
        bytes(12) + b"\x08\x06" + bytes(28),
        ethernet(udp4(b"cut"))[:-1],
        b"\0" * 5,
    ]
    counts = CaptureCounts()
    selectors = {
        "imu0": UdpLink(port=7001),
        "usbl0": UdpLink(port=7002),
        "line": SerialLink(port="/dev/ttyS0"),
    }
    payloads = list(read_streams([save(tmp_path, pcap(frames))], selectors, counts))
    assert [payload[:3] for payload in payloads] == [
        ("imu0", b"imu", T0_NS),
        ("usbl0", b"usbl", T0_NS + STEP_NS),
        ("imu0", b"imu six", T0_NS + 3 * STEP_NS),
    ]
    assert (counts.packets, counts.selected, counts.not_selected) == (8, 3, 3)
    assert counts.undecodable == {
        "cut short by the capture's snap length": 1,
        "headers damaged": 1,
    }
    assert total(counts) == counts.packets


def test_unknown_link_types_are_named(tmp_path: Path) -> None:
    counts = CaptureCounts()
    path = save(tmp_path, pcap([b"x" * 60] * 3, linktype=127))
    assert list(read_streams([path], {"imu0": UdpLink(port=7001)}, counts)) == []
    assert counts.undecodable == {"link type not known: 127": 3}


def test_group_and_allow_are_respected(tmp_path: Path) -> None:
    group, other = bytes([239, 192, 7, 1]), bytes([239, 192, 7, 2])
    friend, stranger = bytes([10, 1, 0, 1]), bytes([10, 2, 0, 1])
    frames = [
        ethernet(udp4(b"1", src=friend, dst=group)),
        ethernet(udp4(b"2", src=stranger, dst=group)),
        ethernet(udp4(b"3", src=friend, dst=other)),
        ethernet(udp4(b"4", src=stranger, dst=B4)),
    ]
    path = save(tmp_path, pcap(frames))
    counts = CaptureCounts()
    selectors = {
        "strict": UdpLink(port=7001, group="239.192.7.1", allow=("10.1.0.0/16",)),
        "group": UdpLink(port=7001, group="239.192.7.1"),
    }
    assert [(who, data) for who, data, *_ in read_streams([path], selectors, counts)] == [
        ("strict", b"1"),
        ("group", b"1"),
        ("group", b"2"),
    ]
    assert (counts.selected, counts.not_selected) == (2, 2)
    counts = CaptureCounts()
    only = {"strict": selectors["strict"]}
    assert [data for _who, data, *_ in read_streams([path], only, counts)] == [b"1"]
    assert (counts.selected, counts.refused, counts.not_selected) == (1, 1, 2)


def test_fragmented_datagrams_are_put_together(tmp_path: Path) -> None:
    frames = [*fragments4(3000, 3), fragments4(3000, 3, 77)[0]]
    counts = CaptureCounts()
    path = save(tmp_path, pcap(frames, linktype=101))
    (payload,) = read_streams([path], {"imu0": UdpLink(port=7001)}, counts)
    assert len(payload[1]) == 3000
    assert payload[2] == T0_NS + 2 * STEP_NS
    assert (counts.selected, counts.fragments, counts.fragments_lost) == (1, 3, 1)
    assert total(counts) == counts.packets == 4


def connection(stream: bytes, first: int, size: int = 100, **ends: int) -> list[bytes]:
    """A server's side of a connection, in segments of `size`."""
    segments = [
        tcp4(b"", first, SYN | ACK, **ends),
        *(
            tcp4(stream[start : start + size], first + 1 + start, **ends)
            for start in range(0, len(stream), size)
        ),
        tcp4(b"", first + 1 + len(stream), FIN | ACK, **ends),
    ]
    return [ethernet(segment) for segment in segments]


@pytest.mark.parametrize("seed", range(5))
def test_tcp_streams_are_put_in_order(tmp_path: Path, seed: int) -> None:
    stream = random.Random(seed).randbytes(5000)
    start, *segments = connection(stream, 2**32 - 2000)
    segments += random.Random(seed).choices(segments, k=20)
    random.Random(seed + 1).shuffle(segments)
    client = ethernet(tcp4(b"command", 1, sport=50_000, dport=4001))
    counts = CaptureCounts()
    path = save(tmp_path, pcap([start, client, *segments]))
    payloads = list(read_streams([path], {"imu0": TcpLink(port=4001)}, counts))
    assert b"".join(data for _who, data, *_ in payloads) == stream
    assert counts.not_selected == 1
    assert counts.selected == 1 + len(segments)
    assert counts.tcp.holes == 0
    assert total(counts) == counts.packets


def test_a_lost_segment_is_counted(tmp_path: Path) -> None:
    stream = bytes(range(256)) * 10
    segments = connection(stream, 500)
    del segments[3]
    counts = CaptureCounts()
    path = save(tmp_path, pcap(segments))
    payloads = list(read_streams([path], {"imu0": TcpLink(port=4001)}, counts))
    assert b"".join(data for _who, data, *_ in payloads) == stream[:200] + stream[300:]
    assert [t_ns for _who, _data, t_ns, _ in payloads] == [
        T0_NS + n * STEP_NS for n in (1, 2, *range(3, 26))
    ]
    assert counts.tcp == StreamCounts(holes=1, missing_bytes=100)


def test_one_of_several_clients_is_followed(tmp_path: Path) -> None:
    first = connection(b"a" * 1000, 0, dport=50_001)
    second = connection(b"b" * 1000, 9_000_000, dport=50_002)
    # The second connects in the middle of the first, ends, and the first is taken up again.
    frames = first[:5] + second[:4] + first[5:6] + second[4:] + first[6:]
    counts = CaptureCounts()
    path = save(tmp_path, pcap(frames))
    payloads = list(read_streams([path], {"imu0": TcpLink(port=4001)}, counts))
    data = b"".join(data for _who, data, *_ in payloads)
    assert data == b"a" * 400 + b"b" * 1000 + b"a" * 500
    assert counts.other_connections == 1
    assert counts.tcp == StreamCounts()


def test_a_silent_connection_gives_way(tmp_path: Path) -> None:
    first = connection(b"a" * 300, 0, dport=50_001)[:3]
    second = connection(b"b" * 300, 9_000_000, dport=50_002)[1:]  # its handshake is not captured
    path = save(tmp_path, pcap(first + second, step_ns=2_000_000_000))
    payloads = list(read_streams([path], {"imu0": TcpLink(port=4001)}))
    assert b"".join(data for _who, data, *_ in payloads) == b"a" * 200 + b"b" * 100


def test_servers_with_the_same_port_are_told_apart_by_host(tmp_path: Path) -> None:
    hosts = {"one": "10.0.0.5", "two": "10.0.0.6"}
    frames = [
        frame
        for pair in zip(
            connection(b"1" * 500, 0, src=bytes([10, 0, 0, 5])),
            connection(b"2" * 500, 0, src=bytes([10, 0, 0, 6])),
            strict=True,
        )
        for frame in pair
    ]
    selectors = {name: TcpLink(port=4001, host=host) for name, host in hosts.items()}
    payloads = list(read_streams([save(tmp_path, pcap(frames))], selectors))
    for name, byte in (("one", b"1"), ("two", b"2")):
        assert b"".join(data for who, data, *_ in payloads if who == name) == byte * 500


def test_several_captures_are_merged_by_time(tmp_path: Path) -> None:
    t0_ns = T0_NS // 1000 * 1000
    odd = [ethernet(udp4(bytes([n]))) for n in range(1, 20, 2)]
    even = [ethernet(udp4(bytes([n]))) for n in range(0, 20, 2)]
    paths = [
        save(tmp_path, pcap(odd, t0_ns=t0_ns + STEP_NS, step_ns=2 * STEP_NS), "odd.pcap"),
        save(tmp_path, pcapng(even, t0_us=t0_ns // 1000, step_us=2000), "even.gz", gzipped=True),
    ]
    payloads = list(read_streams(paths, {"imu0": UdpLink(port=7001)}))
    assert [p[:3] for p in payloads] == [
        ("imu0", bytes([n]), t0_ns + n * STEP_NS) for n in range(20)
    ]


def test_what_came_before_a_cut_is_given_even_what_waited(tmp_path: Path) -> None:
    segments = connection(b"x" * 1000, 500)
    del segments[2]
    path = save(tmp_path, pcap(segments)[:-10])
    received = b""
    with pytest.raises(CaptureError, match="after 10 good packets"):
        for _device, data, *_ in read_streams([path], {"imu0": TcpLink(port=4001)}):
            received += data
    assert received == b"x" * 900


def test_real_telegrams_are_selected() -> None:
    path = shared("captures", "stdbin_V3_2Hz.pcapng")
    counts = CaptureCounts()
    payloads = list(read_streams([path], {"ins": UdpLink(port=8200)}, counts))
    assert counts.selected == len(payloads) == len(list(read_packets(path))) == 36
    assert all(data.startswith(b"IX") for _who, data, *_ in payloads)
