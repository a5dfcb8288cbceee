"""UDP links over real sockets: unicast, broadcast, multicast, stamps, refusals, overflow."""

import asyncio
import os
import socket
import time
from collections.abc import Iterator
from itertools import pairwise

import pytest

from drivers.hosttime import now_ns
from drivers.links import Chunk, LinkCounts, LinkError, open_link, udp
from drivers.settings import UdpLink
from tests.drivers.hearing import Heard, hearing
from tests.loopback import free_port


@pytest.fixture
def sender() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        yield sock


async def take(link: Heard, count: int) -> list[Chunk]:
    async with asyncio.timeout(5):
        return [await anext(link) for _ in range(count)]


async def test_datagrams_come_whole_and_in_order(sender: socket.socket) -> None:
    port = free_port(socket.SOCK_DGRAM)
    counts = LinkCounts()
    sent = [b"", b"a", b"\x00" * 9000, b"z" * 60_000]
    async with hearing(UdpLink(port=port), counts) as link:
        for data in sent:
            sender.sendto(data, ("127.0.0.1", port))
        chunks = await take(link, len(sent))
    assert [chunk.data for chunk in chunks] == sent
    assert {chunk.source for chunk in chunks} == {f"127.0.0.1:{sender.getsockname()[1]}"}
    assert (counts.chunks, counts.bytes) == (4, sum(map(len, sent)))


def stall(seconds: float) -> None:
    """Hold up the event loop."""
    time.sleep(seconds)


@pytest.mark.skipif(os.uname().sysname != "Linux", reason="the kernel stamps on Linux only")
async def test_stamp_is_the_kernels_even_when_the_loop_is_blocked(sender: socket.socket) -> None:
    port = free_port(socket.SOCK_DGRAM)
    async with hearing(UdpLink(port=port)) as link:
        sent = []
        for n in range(5):
            sent.append(now_ns())
            sender.sendto(bytes([n]), ("127.0.0.1", port))
            stall(0.05)
        chunks = await take(link, 5)
    # All were read after the last stall; each was stamped before the next one was sent.
    bounds = pairwise([*sent, sent[-1] + 50_000_000])
    for (t_sent, t_next), chunk in zip(bounds, chunks, strict=True):
        assert t_sent - 1_000_000 <= chunk.t_rx_ns < t_next


async def test_a_wall_clock_set_ahead_moves_no_stamp(
    sender: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = free_port(socket.SOCK_DGRAM)
    async with hearing(UdpLink(port=port)) as link:
        before = now_ns()
        sender.sendto(b"x", ("127.0.0.1", port))
        real = time.time_ns
        monkeypatch.setattr(time, "time_ns", lambda: real() + 3_600_000_000_000)
        (chunk,) = await take(link, 1)
    assert before - 1_000_000 <= chunk.t_rx_ns <= now_ns()


@pytest.mark.parametrize("allow", [("127.0.0.2",), ("10.0.0.0/8", "127.0.0.2/32")])
async def test_only_allowed_senders_are_heard(
    sender: socket.socket, allow: tuple[str, ...]
) -> None:
    port = free_port(socket.SOCK_DGRAM)
    counts = LinkCounts()
    async with hearing(UdpLink(port=port, allow=allow), counts) as link:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as friend:
            friend.bind(("127.0.0.2", 0))
            sender.sendto(b"stranger", ("127.0.0.1", port))
            friend.sendto(b"friend", ("127.0.0.1", port))
            (chunk,) = await take(link, 1)
    assert chunk.data == b"friend"
    assert counts.refused == 1


def spoken(address: str, data: bytes, port: int) -> None:
    """Send from an address of loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((address, 0))
        sock.sendto(data, ("127.0.0.1", port))


async def test_two_links_share_a_port_and_each_hears_its_own_sender() -> None:
    port, one, two = free_port(socket.SOCK_DGRAM), LinkCounts(), LinkCounts()
    first = UdpLink(port=port, allow=("127.0.0.1",))
    second = UdpLink(port=port, allow=("127.0.0.2/31",))
    async with hearing(second, two) as other:
        async with hearing(first, one) as link:
            for n in range(1, 6):
                spoken(f"127.0.0.{n}", bytes([n]), port)
            assert [chunk.data for chunk in await take(link, 1)] == [b"\1"]
            assert [chunk.data for chunk in await take(other, 2)] == [b"\2", b"\3"]
            await drained(two)
            assert (one.chunks, two.chunks, one.refused, two.refused) == (1, 2, 2, 2)
        spoken("127.0.0.1", b"nobody's now", port)
        spoken("127.0.0.3", b"still heard", port)
        assert [chunk.data for chunk in await take(other, 1)] == [b"still heard"]
        assert (one.chunks, two.refused) == (1, 3)
        with pytest.raises(LinkError, match="address already in use"):
            async with hearing(UdpLink(port=port)):  # all senders: some are others' already
                pass
    async with hearing(UdpLink(port=port)):
        pass


async def test_a_multicast_group_is_joined_and_nothing_else_gets_in(sender: socket.socket) -> None:
    port = free_port(socket.SOCK_DGRAM, "0.0.0.0")
    settings = UdpLink(port=port, group="239.192.7.1", bind="127.0.0.1")
    interface = socket.inet_aton("127.0.0.1")
    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
    async with hearing(settings) as first, hearing(settings) as second:
        sender.sendto(b"not for the group", ("127.0.0.1", port))
        sender.sendto(b"another group", ("239.192.7.2", port))
        sender.sendto(b"group", ("239.192.7.1", port))
        for link in (first, second):
            assert (await take(link, 1))[0].data == b"group"


async def test_joining_again_does_no_harm(
    sender: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(udp, "REJOIN_S", 0.001)
    port = free_port(socket.SOCK_DGRAM, "0.0.0.0")
    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
    async with hearing(UdpLink(port=port, group="239.192.7.1")) as link:
        for n in range(10):
            await asyncio.sleep(0.002)
            sender.sendto(bytes([n]), ("239.192.7.1", port))
        assert [chunk.data[0] for chunk in await take(link, 10)] == list(range(10))


def multicast_sender6() -> tuple[socket.socket, str, int]:
    """A socket that sends to IPv6 groups on an interface with such a route; never off this host."""
    for index, name in socket.if_nameindex():
        six = socket.socket(socket.AF_INET6, socket.SOCK_DGRAM)
        six.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, 0)
        six.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_IF, index)
        try:
            six.sendto(b"", ("ff12::7001", 9, 0, index))
        except OSError:
            six.close()
        else:
            return six, name, index
    pytest.skip("no interface with a route for IPv6 multicast")


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6")
async def test_an_ipv6_group_is_joined_on_its_interface() -> None:
    port = free_port(socket.SOCK_DGRAM, "::1")
    six, name, index = multicast_sender6()
    with six:
        async with hearing(UdpLink(port=port, group=f"ff12::7001%{name}")) as link:
            six.sendto(b"six", ("ff12::7001", port, 0, index))
            assert (await take(link, 1))[0].data == b"six"


async def test_broadcasts_are_heard_on_the_wildcard(sender: socket.socket) -> None:
    port = free_port(socket.SOCK_DGRAM, "0.0.0.0")
    sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    async with hearing(UdpLink(port=port, bind="0.0.0.0")) as link:
        sender.sendto(b"all", ("127.255.255.255", port))
        assert (await take(link, 1))[0].data == b"all"


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6")
async def test_ipv6_and_a_dual_stack_wildcard(sender: socket.socket) -> None:
    port = free_port(socket.SOCK_DGRAM, "::1")
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as six:
        six.bind(("::1", 0))
        own = f"[::1]:{six.getsockname()[1]}"
        async with hearing(UdpLink(port=port, bind="::1", allow=("::1",))) as link:
            six.sendto(b"six", ("::1", port))
            (chunk,) = await take(link, 1)
        assert chunk.source == own
    async with hearing(UdpLink(port=port, bind="::", allow=("127.0.0.1",))) as link:
        sender.sendto(b"four", ("127.0.0.1", port))
        assert (await take(link, 1))[0].data == b"four"


async def test_a_taken_port_is_one_clear_line() -> None:
    port = free_port(socket.SOCK_DGRAM)
    async with hearing(UdpLink(port=port)):
        with pytest.raises(LinkError) as lost:
            async with hearing(UdpLink(port=port)):
                pass
    assert str(lost.value) == f"udp 127.0.0.1:{port}: address already in use"


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        (UdpLink(port=7001, bind="203.0.113.9"), "cannot assign requested address"),
        (UdpLink(port=7001, group="10.0.0.1"), "not a multicast group"),
        (UdpLink(port=7001, allow=("nonsense",)), "'nonsense' does not appear to be"),
    ],
)
async def test_unusable_addresses_are_one_clear_line(settings: UdpLink, line: str) -> None:
    with pytest.raises(LinkError, match=f"^udp .*:7001: .*{line}"):
        async with hearing(settings):
            pass


async def test_kernel_drops_are_counted_exactly(sender: socket.socket) -> None:
    port = free_port(socket.SOCK_DGRAM)
    counts = LinkCounts()
    async with hearing(UdpLink(port=port), counts) as link:
        dropped = []
        for _ in range(2):
            for _ in range(20_000):  # more than any receive buffer holds; the loop does not run
                sender.sendto(b"x" * 1000, ("127.0.0.1", port))
            await drained(counts)
            sender.sendto(b"last", ("127.0.0.1", port))  # carries the count up to here
            while (await take(link, 1))[0].data != b"last":
                pass
            dropped.append(counts.kernel_dropped)
    assert 0 < dropped[0] < dropped[1]
    assert counts.chunks + counts.kernel_dropped == 2 * 20_001


async def drained(counts: LinkCounts) -> None:
    """Turn the loop until nothing new comes."""
    before = -1
    while before != counts.chunks:
        before = counts.chunks
        for _ in range(10):
            await asyncio.sleep(0)


async def test_what_fails_in_the_taker_is_not_swallowed(sender: socket.socket) -> None:
    port = free_port(socket.SOCK_DGRAM)
    asyncio.get_running_loop().set_exception_handler(lambda _loop, _context: None)  # it is said too

    def fail(chunk: Chunk) -> None:
        raise ValueError(chunk.data.decode())

    async with open_link(UdpLink(port=port), fail) as link:
        sender.sendto(b"a bug", ("127.0.0.1", port))
        with pytest.raises(ValueError, match="a bug"):
            await asyncio.wait_for(link.lost(), 5)
