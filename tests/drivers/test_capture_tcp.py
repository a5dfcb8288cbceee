"""TCP streams: whatever happens to the segments, the bytes are those that were sent."""

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.capture.tcpstream import (
    FIN,
    HOLE_BYTES,
    HOLE_WAIT_NS,
    RST,
    SYN,
    StreamCounts,
    TcpStream,
)

ACK = 0x10
WRAP = 2**32


def joined(pieces: list[tuple[bytes, int]]) -> bytes:
    return b"".join(data for data, _t_ns in pieces)


@st.composite
def mangled(draw: st.DrawFn) -> tuple[int, bytes, list[tuple[int, int, bytes]]]:
    """First sequence number, the stream, and its segments: overlapping, repeated, in any order."""
    first = draw(st.one_of(st.integers(0, WRAP - 1), st.integers(WRAP - 200, WRAP - 1)))
    stream = draw(st.binary(min_size=1, max_size=300))
    cuts = sorted(draw(st.sets(st.integers(1, len(stream)), max_size=12)) | {len(stream)})
    spans = list(zip([0, *cuts[:-1]], cuts, strict=True))
    extra = st.tuples(st.integers(0, len(stream)), st.integers(0, len(stream)))
    spans += [(min(span), max(span)) for span in draw(st.lists(extra, max_size=12))]
    spans = draw(st.permutations(spans))
    segments = [
        (
            (first + 1 + start) % WRAP,
            ACK | (FIN if end == len(stream) else 0),
            stream[start:end],
        )
        for start, end in spans
    ]
    return first, stream, segments


@settings(deadline=None, max_examples=300)
@given(mangled())
def test_any_order_overlap_and_repetition_gives_the_stream(
    case: tuple[int, bytes, list[tuple[int, int, bytes]]],
) -> None:
    first, stream, segments = case
    counts = StreamCounts()
    tcp = TcpStream(counts)
    pieces = tcp.add(first, SYN | ACK, b"", 0)
    for t_ns, (sequence, flags, payload) in enumerate(segments, 1):
        pieces += tcp.add(sequence, flags, payload, t_ns)
    assert joined(pieces) == stream
    assert tcp.ended
    assert tcp.close() == []
    times = [t_ns for _data, t_ns in pieces]
    assert times == sorted(times)
    sent = sum(len(payload) for _sequence, _flags, payload in segments)
    assert counts == StreamCounts(repeated_bytes=sent - len(stream))


def test_a_stream_begun_before_the_capture_is_taken_up() -> None:
    tcp = TcpStream(StreamCounts())
    assert joined(tcp.add(5000, ACK, b"abc", 1)) == b"abc"
    assert joined(tcp.add(5003, ACK, b"def", 2)) == b"def"


def test_what_waited_for_a_retransmission_is_late() -> None:
    tcp = TcpStream(StreamCounts())
    tcp.add(0, SYN, b"", 0)
    assert tcp.add(1, ACK, b"a", 10) == [(b"a", 10)]
    assert tcp.add(3, ACK, b"c", 30) == []
    assert tcp.add(2, ACK, b"b", 50) == [(b"b", 50), (b"c", 50)]


def test_a_hole_is_skipped_after_a_while_and_what_waited_keeps_its_time() -> None:
    counts = StreamCounts()
    tcp = TcpStream(counts)
    tcp.add(0, SYN, b"", 0)
    assert tcp.add(11, ACK, b"later", 100) == []
    assert tcp.add(16, ACK, b"more", 100 + HOLE_WAIT_NS) == []
    t_ns = 101 + HOLE_WAIT_NS
    assert tcp.add(20, ACK, b"!", t_ns) == [
        (b"later", 100),
        (b"more", 100 + HOLE_WAIT_NS),
        (b"!", t_ns),
    ]
    assert counts == StreamCounts(holes=1, missing_bytes=10)


def test_a_hole_is_skipped_when_too_much_waits() -> None:
    counts = StreamCounts()
    tcp = TcpStream(counts)
    tcp.add(0, SYN, b"", 0)
    size, sequence, received = 1000, 501, b""
    for t_ns in range(HOLE_BYTES // size + 10):
        received += joined(tcp.add(sequence, ACK, bytes([t_ns % 256]) * size, t_ns))
        sequence += size
    assert counts == StreamCounts(holes=1, missing_bytes=500)
    assert len(received) == size * (HOLE_BYTES // size + 10)


def test_the_end_of_the_capture_gives_what_waits() -> None:
    counts = StreamCounts()
    tcp = TcpStream(counts)
    tcp.add(0, SYN, b"", 0)
    tcp.add(3, ACK, b"cd", 1)
    tcp.add(8, ACK, b"hi", 2)
    assert tcp.close() == [(b"cd", 1), (b"hi", 2)]
    assert counts == StreamCounts(holes=2, missing_bytes=2 + 3)


def test_reset_and_handshake_begin_anew() -> None:
    counts = StreamCounts()
    tcp = TcpStream(counts)
    tcp.add(0, SYN, b"", 0)
    assert joined(tcp.add(1, ACK, b"one", 1)) == b"one"
    tcp.add(6, ACK, b"waits", 2)
    assert joined(tcp.add(0, RST, b"", 3)) == b"waits"
    assert tcp.ended
    tcp.add(3_000_000_000, SYN, b"", 4)
    assert not tcp.ended
    assert joined(tcp.add(3_000_000_001, ACK, b"two", 5)) == b"two"
    assert counts == StreamCounts(holes=1, missing_bytes=2)


def test_a_repeated_handshake_or_end_repeats_nothing() -> None:
    tcp = TcpStream(StreamCounts())
    tcp.add(9, SYN, b"", 0)
    assert joined(tcp.add(10, ACK, b"abc", 1)) == b"abc"
    assert tcp.add(9, SYN, b"", 2) == []
    assert joined(tcp.add(13, FIN, b"d", 3)) == b"d"
    assert tcp.ended
    assert tcp.add(13, FIN, b"d", 4) == []
    assert tcp.add(10, ACK, b"abcd", 5) == []


def test_the_end_is_not_reached_over_a_hole() -> None:
    tcp = TcpStream(StreamCounts())
    tcp.add(9, SYN, b"", 0)
    tcp.add(12, FIN, b"c", 1)
    assert not tcp.ended
    assert joined(tcp.add(10, ACK, b"ab", 2)) == b"abc"
    assert tcp.ended


def test_keep_alive_probes_carry_nothing() -> None:
    tcp = TcpStream(StreamCounts())
    tcp.add(9, SYN, b"", 0)
    tcp.add(10, ACK, b"abc", 1)
    assert tcp.add(12, ACK, b"\0", 2) == []
    assert joined(tcp.add(13, ACK, b"d", 3)) == b"d"


def test_another_connection_without_handshake_is_not_taken_for_an_old_one() -> None:
    counts = StreamCounts()
    tcp = TcpStream(counts)
    tcp.add(2_000_000_000, SYN, b"", 0)
    tcp.add(2_000_000_001, ACK, b"abc", 1)
    assert joined(tcp.add(5, ACK, b"new", 2)) == b"new"
    assert joined(tcp.add(8, ACK, b"er", 3)) == b"er"
    assert counts == StreamCounts(restarts=1)
