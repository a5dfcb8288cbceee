"""Frames: every link type, tags, headers with options, fragments, and damage."""

import random
import struct

import dpkt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.capture.fragments import MAX_WAIT_NS, MAX_WAITING, Fragments
from drivers.capture.packets import Datagram, Fragment, Segment, Skipped, decode, transport
from tests.drivers.frames import A4, A6, B4, B6, ethernet, tcp4, udp4, udp6

IP4, IP6 = bytes(udp4(b"payload")), bytes(udp6(b"payload"))
FOUR = Datagram(A4, B4, 4000, 7001, b"payload")
SIX = Datagram(A6, B6, 4000, 7001, b"payload")
NATIVE_ORDERS = ("<I", ">I")


def tagged(ethertypes: list[int], ip: bytes, kind: int) -> bytes:
    """Ethernet with stacked VLAN tags."""
    frame = bytes(12)
    for ethertype in ethertypes:
        frame += struct.pack(">HH", ethertype, 0x2005)
    return frame + struct.pack(">H", kind) + ip


FRAMES = [
    (1, ethernet(udp4(b"payload")), FOUR),
    (1, ethernet(udp6(b"payload")), SIX),
    (1, tagged([0x8100], IP4, 0x0800), FOUR),
    (1, tagged([0x88A8, 0x8100], IP4, 0x0800), FOUR),
    (1, tagged([0x9100, 0x8100, 0x8100], IP6, 0x86DD), SIX),
    (113, bytes(dpkt.sll.SLL(ethtype=0x0800, data=IP4)), FOUR),
    (113, bytes(dpkt.sll.SLL(ethtype=0x86DD, data=IP6)), SIX),
    (276, bytes(dpkt.sll2.SLL2(ethtype=0x0800, data=IP4)), FOUR),
    (276, bytes(dpkt.sll2.SLL2(ethtype=0x86DD, data=IP6)), SIX),
    (101, IP4, FOUR),
    (101, IP6, SIX),
    (12, IP4, FOUR),
    (14, IP6, SIX),
    (228, IP4, FOUR),
    (229, IP6, SIX),
    (108, bytes(dpkt.loopback.Loopback(family=2, data=IP4)), FOUR),
    *[(0, struct.pack(order, 2) + IP4, FOUR) for order in NATIVE_ORDERS],
    *[
        (0, struct.pack(order, family) + IP6, SIX)
        for order in NATIVE_ORDERS
        for family in (10, 24, 28, 30)
    ],
]


@pytest.mark.parametrize(("linktype", "frame", "expected"), FRAMES)
def test_link_types(linktype: int, frame: bytes, expected: Datagram) -> None:
    assert decode(linktype, frame) == expected


def test_padding_behind_the_ip_packet_is_none_of_it() -> None:
    short = ethernet(udp4(b"x"))
    assert decode(1, short.ljust(60, b"\0")) == Datagram(A4, B4, 4000, 7001, b"x")
    assert decode(1, tagged([0x8100], bytes(udp4(b"x")), 0x0800) + b"pad") == Datagram(
        A4, B4, 4000, 7001, b"x"
    )
    assert decode(101, IP6 + b"fcs!") == SIX


def test_ipv4_options() -> None:
    ip = udp4(b"payload")
    ip.opts = b"\x94\x04\x00\x00"  # router alert
    ip.hl = 6
    ip.len = len(ip)
    assert decode(1, ethernet(ip)) == FOUR


def test_tcp() -> None:
    frame = ethernet(tcp4(b"payload", 2**32 - 3, flags=0x18))
    assert decode(1, frame.ljust(100, b"\0")) == Segment(
        A4, B4, 4001, 50_000, 2**32 - 3, 0x18, b"payload"
    )


def test_ipv6_extension_headers() -> None:
    udp = bytes(udp6(b"payload"))[40:]
    destination = bytes([17, 1]) + bytes(14)
    authentication = bytes([60, 4]) + bytes(22)
    routing = bytes([51, 0]) + bytes(6)
    hop_by_hop = bytes([43, 0]) + bytes(6)
    chain = hop_by_hop + routing + authentication + destination + udp
    ip = dpkt.ip6.IP6(src=A6, dst=B6, nxt=0, hlim=1, plen=len(chain), data=chain)
    assert decode(101, bytes(ip)) == SIX


def test_an_offloaded_length_of_zero_means_all_of_it() -> None:
    four = bytearray(tcp4(b"x" * 3000, 7).__bytes__())
    four[2:4] = b"\0\0"
    assert decode(101, bytes(four))[-1] == b"x" * 3000
    six = bytearray(IP6)
    six[4:6] = b"\0\0"
    assert decode(229, bytes(six)) == SIX


def test_other_traffic_is_other() -> None:
    arp = dpkt.arp.ARP(spa=A4, tpa=B4)
    assert decode(1, bytes(12) + b"\x08\x06" + bytes(arp)) is Skipped.OTHER
    icmp = dpkt.ip.IP(src=A4, dst=B4, p=1, data=dpkt.icmp.ICMP())
    assert decode(1, ethernet(icmp)) is Skipped.OTHER
    assert decode(0, struct.pack("<I", 7) + IP4) is Skipped.OTHER
    assert decode(1, bytes(12) + b"\x00\x26" + bytes(38)) is Skipped.OTHER  # 802.3 length
    assert decode(127, IP4) is Skipped.LINK_TYPE


@pytest.mark.parametrize("frame", [IP4, IP6, bytes(tcp4(b"payload", 7))])
def test_cut_short_is_never_a_payload(frame: bytes) -> None:
    for linktype, prefix in ((101, b""), (1, ethernet(udp4(b""))[:14])):
        whole = prefix + frame
        if frame is IP6 and linktype == 1:
            continue
        for size in range(len(whole)):
            assert isinstance(decode(linktype, whole[:size]), Skipped)


def test_lengths_that_contradict_each_other_are_damage() -> None:
    for length in (0, 7, 16, 0xFFFF):
        frame = bytearray(ethernet(udp4(b"payload")))
        frame[38:40] = struct.pack(">H", length)
        assert decode(1, bytes(frame)) is Skipped.DAMAGED
    padded = bytearray(ethernet(udp4(b"payload")).ljust(80, b"\0"))
    padded[38:40] = struct.pack(">H", 16)
    assert decode(1, bytes(padded)) is Skipped.DAMAGED  # reaches into the padding
    for version in (0x44, 0x55, 0x4F):
        frame = bytearray(ethernet(udp4(b"payload")))
        frame[14] = version
        assert decode(1, bytes(frame)) is Skipped.DAMAGED
    for words in (0x40, 0xF0):
        frame = bytearray(ethernet(tcp4(b"payload", 7)))
        frame[46] = words
        assert decode(1, bytes(frame)) is Skipped.DAMAGED


@settings(deadline=None)
@given(
    linktype=st.sampled_from([0, 1, 12, 101, 108, 113, 228, 276]),
    place=st.integers(0, 80),
    junk=st.binary(min_size=1, max_size=20),
)
def test_junk_never_raises(linktype: int, place: int, junk: bytes) -> None:
    frame = next(frame for number, frame, _ in FRAMES if number == linktype)
    decode(linktype, junk)
    decode(linktype, frame[:place] + junk + frame[place + len(junk) :])


# Fragments


def fragments4(size: int, pieces: int, identification: int = 9) -> list[bytes]:
    """A datagram of `size` bytes, cut by hand into frames of raw IP."""
    ip = udp4(bytes(range(256)) * (size // 256 + 1))
    ip = udp4(ip.data.data[:size])
    body = bytes(ip)[20:]
    step = -(-len(body) // pieces) // 8 * 8 + 8
    frames = []
    for offset in range(0, len(body), step):
        part = body[offset : offset + step]
        more = offset + step < len(body)
        header = dpkt.ip.IP(src=A4, dst=B4, p=17, id=identification)
        header.mf, header.offset = int(more), offset // 8
        header.data = part
        header.len = 20 + len(part)
        frames.append(bytes(header))
    return frames


def feed(fragments: Fragments, frame: bytes, t_ns: int = 0) -> object:
    content = decode(101, frame)
    kind = b"\x08\x00" if frame[0] >> 4 == 4 else b"\x86\xdd"
    assert content == decode(1, bytes(12) + kind + frame)
    assert isinstance(content, Fragment)
    return fragments.add(content, t_ns)


@pytest.mark.parametrize("seed", range(5))
def test_fragments_in_any_order_with_repetitions(seed: int) -> None:
    frames = fragments4(5000, 4)
    expected = (bytes(range(256)) * 20)[:5000]
    order = frames[:-1] * 2
    random.Random(seed).shuffle(order)
    fragments = Fragments()
    assert [feed(fragments, frame) for frame in order] == [None] * len(order)
    whole = feed(fragments, frames[-1])
    assert whole == Datagram(A4, B4, 4000, 7001, expected)
    assert len(fragments) == 0


def test_a_later_fragment_that_looks_like_a_datagram_is_none() -> None:
    ip = udp4(b"looks whole")
    ip.offset = 8
    assert decode(1, ethernet(ip)) == Fragment(A4, B4, 17, 0, 64, False, bytes(ip)[20:])


def test_fragments_that_overlap() -> None:
    ip = udp4(bytes(range(200)))
    body = bytes(ip)[20:]
    fragments = Fragments()
    results = []
    for start, end in ((48, 104), (0, 64), (96, len(body))):
        more = end < len(body)
        part = Fragment(A4, B4, 17, 3, start, more, body[start:end])
        results.append(fragments.add(part, 0))
    assert results == [None, None, Datagram(A4, B4, 4000, 7001, bytes(range(200)))]


def test_ipv6_fragments() -> None:
    body = bytes(udp6(b"q" * 100))[40:]
    fragments = Fragments()
    results = []
    for offset, more in ((0, 1), (64, 0)):
        part = body[offset : offset + 64]
        head = struct.pack(">BxHI", 17, offset | more, 5)
        ip = dpkt.ip6.IP6(src=A6, dst=B6, nxt=44, plen=8 + len(part), data=head + part)
        results.append(feed(fragments, bytes(ip)))
    assert results == [None, Datagram(A6, B6, 4000, 7001, b"q" * 100)]
    alone = struct.pack(">BxHI", 17, 0, 5) + body
    assert transport(44, A6, B6, alone) == Datagram(A6, B6, 4000, 7001, b"q" * 100)


def test_what_never_becomes_whole_is_given_up_and_counted() -> None:
    fragments = Fragments()
    for n in range(MAX_WAITING + 10):
        assert feed(fragments, fragments4(3000, 2, n)[0], t_ns=n) is None
    assert (len(fragments), fragments.abandoned) == (MAX_WAITING, 10)
    feed(fragments, fragments4(3000, 2, 9999)[0], t_ns=MAX_WAIT_NS + 1000)
    assert (len(fragments), fragments.abandoned) == (1, MAX_WAITING + 10)
