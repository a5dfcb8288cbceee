"""The frame buffer and the framings on it: arrival, runs of junk, long and last lines."""

import pytest

from drivers.framing import JUNK_MAX, FrameBuffer, LineDecoder, SyncDecoder, UnreadableError
from drivers.records import NmeaSentence, Record, Rejected

SYNC = b"\xaa\x55"


def measure(data: bytes, at: int) -> int | None:
    """Sync word, one byte of total length, content, sum of all before it."""
    if at + 2 >= len(data):
        return None
    return data[at + 2] if data[at + 2] > 3 else 0


def said(text: str, t_rx_ns: int, line_bytes: int) -> NmeaSentence:
    return NmeaSentence(
        t_rx_ns=t_rx_ns, line_bytes=line_bytes, talker="", formatter=text, fields=()
    )


def decode_frame(frame: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record, ...] | None:
    if sum(frame[:-1]) % 256 != frame[-1]:
        return None
    parts = frame[3:-1].decode("latin-1").split(",")
    return tuple(said(part, t_rx_ns, line_bytes) for part in parts)


def frame(content: bytes) -> bytes:
    body = SYNC + bytes([len(content) + 4]) + content
    return body + bytes([sum(body) % 256])


def syncs() -> SyncDecoder:
    return SyncDecoder((SYNC,), measure, decode_frame)


def decode_line(text: str, t_rx_ns: int, line_bytes: int) -> Record:
    if not text.startswith("ok"):
        raise UnreadableError("syntax", "not ok")
    return said(text, t_rx_ns, line_bytes)


def lines(**more: int) -> LineDecoder:
    def starts(line: bytes) -> tuple[int, ...]:
        return 0, max(line.rfind(b"ok"), 0)

    return LineDecoder(decode_line, starts, **more)


def brief(records: object) -> list[tuple[str, object]]:
    return [(r.reason, r.data) if isinstance(r, Rejected) else ("ok", r.formatter) for r in records]


def test_arrival_is_that_of_the_first_byte() -> None:
    reader = syncs()
    one, two = frame(b"one"), frame(b"two")
    assert list(reader.feed(b"--" + one[:3], 10)) == []
    junk, first = reader.feed(one[3:] + two[:1], 20)
    assert (junk.t_rx_ns, junk.line_bytes, junk.data) == (10, 5, b"--")
    assert (first.t_rx_ns, first.line_bytes, first.formatter) == (10, 3, "one")
    (second,) = reader.feed(two[1:] + b"-", 30)
    assert (second.t_rx_ns, second.line_bytes) == (20, 1)
    (tail,) = reader.close()
    assert (tail.t_rx_ns, tail.line_bytes, tail.reason) == (30, 1, "unknown")


def test_every_damaged_frame_is_one_rejection() -> None:
    bad = bytearray(frame(b"hit"))
    bad[4] ^= 1
    found = syncs().feed(b"x" + bytes(bad) + bytes(bad) + frame(b"good") + b"y" + frame(b""), 0)
    assert brief(found) == [
        ("unknown", b"x"),
        ("checksum", bytes(bad)),
        ("checksum", bytes(bad)),
        ("ok", "good"),
        ("unknown", b"y"),
        ("ok", ""),
    ]


def test_a_false_length_hides_nothing() -> None:
    false = SYNC + b"\x28"
    found = syncs().feed(false + frame(b"a") + frame(b"b") + bytes(40), 0)
    assert brief(found)[:3] == [("checksum", false), ("ok", "a"), ("ok", "b")]


def test_a_frame_of_several_records() -> None:
    reader = syncs()
    assert brief(reader.feed(frame(b"a,b"), 0)) == [("ok", "a"), ("ok", "b")]
    found = list(reader.feed(b"x" + frame(b"a,b") + frame(b"c"), 1))
    assert brief(found) == [("unknown", b"x"), ("ok", "a"), ("ok", "b"), ("ok", "c")]
    assert [r.line_bytes for r in found] == [13, 12, 12, 5]


def test_frames_that_begin_in_several_ways() -> None:
    def measure_two(data: bytes, at: int) -> int | None:
        return measure(data, at) if data[at] == SYNC[0] else 2

    def decode_two(data: bytes, t_rx_ns: int, line_bytes: int) -> tuple[Record, ...] | None:
        if data[0] == SYNC[0]:
            return decode_frame(data, t_rx_ns, line_bytes)
        return (said(data.decode(), t_rx_ns, line_bytes),)

    reader = SyncDecoder((SYNC, b"<>", b"!"), measure_two, decode_two)
    stream = b"<" + frame(b"a") + b"<>--!?" + SYNC[:1] + b"<" + b"<"
    found = [record for i, _ in enumerate(stream) for record in reader.feed(stream[i : i + 1], i)]
    assert brief([*found, *reader.close()]) == [
        ("unknown", b"<"),
        ("ok", "a"),
        ("ok", "<>"),
        ("unknown", b"--"),
        ("ok", "!?"),
        ("unknown", SYNC[:1] + b"<"),
        ("length", b"<"),
    ]


def test_frame_cut_by_the_end_of_the_stream() -> None:
    reader = syncs()
    cut = SYNC + b"\x28" + b"abc" + frame(b"in")
    assert list(reader.feed(cut, 0)) == []
    assert brief(reader.close()) == [("length", cut[:6]), ("ok", "in")]


def test_long_junk_comes_in_pieces() -> None:
    reader = syncs()
    found = [r for i in range(3000) for r in reader.feed(b"x", i)] + list(reader.close())
    assert [len(record.data) for record in found] == [JUNK_MAX, JUNK_MAX, 3000 - 2 * JUNK_MAX]
    assert [record.t_rx_ns for record in found] == [0, JUNK_MAX, 2 * JUNK_MAX]


@pytest.mark.parametrize("end", [b"\r\n", b"\n", b"\r\r\n"])
def test_line_ends(end: bytes) -> None:
    found = list(lines().feed(b"ok 1" + end + b"ok 2" + end, 5))
    assert brief(found) == [("ok", "ok 1"), ("ok", "ok 2")]
    assert found[1].line_bytes == 4 + len(end)


def test_lone_carriage_return_ends_no_line() -> None:
    reader = lines()
    assert list(reader.feed(b"no 1\rok 2\r", 0)) == []
    assert brief(reader.feed(b"\n", 0)) == [("syntax", b"no 1\r"), ("ok", "ok 2")]


def test_each_bad_line_is_one_rejection_at_once() -> None:
    found = lines().feed(b"bad\r\nworse\nok\n\n", 0)
    assert brief(found) == [
        ("syntax", b"bad\r\n"),
        ("syntax", b"worse\n"),
        ("ok", "ok"),
        ("syntax", b"\n"),
    ]


@pytest.mark.parametrize("byte", [b"\x00", b"\x7f", b"\x80", b"\xff", b"\x1b"])
def test_unprintable_bytes_are_no_text(byte: bytes) -> None:
    line = b"ok " + byte + b"\n"
    assert brief(lines().feed(line, 0)) == [("syntax", line)]


def test_tail_of_an_overlong_line_is_not_taken_for_a_line() -> None:
    """What is left of it begins with "ok" only because the buffer ended there."""
    line = b"x" * 10 + b"ok " + b"y" * 16 + b"\n"
    found = LineDecoder(decode_line, lambda line: (0,), longest=20).feed(line, 0)
    assert brief(found) == [("length", line)]


def test_line_behind_overlong_junk_is_found() -> None:
    reader = lines(longest=20)
    found = []
    for i in range(100):
        found += reader.feed(b"x", i)
    found += reader.feed(b"ok 1\r\nok 2\r\n", 100)
    assert brief(found) == [("length", b"x" * 100), ("ok", "ok 1"), ("ok", "ok 2")]
    assert (found[1].t_rx_ns, found[1].line_bytes) == (100, 12)


def test_overlong_line_that_never_ends_is_bounded() -> None:
    reader = lines(longest=20)
    out = sum(len(r.data) for i in range(5000) for r in reader.feed(b"x", i))
    assert 5000 - out <= JUNK_MAX + 20
    assert sum(len(r.data) for r in reader.close()) == 5000 - out


def test_last_line_waits_for_its_end_until_close() -> None:
    reader = lines()
    assert list(reader.feed(b"ok last", 3)) == []
    assert brief(reader.close()) == [("ok", "ok last")]
    assert list(reader.close()) == []


def test_last_line_that_is_too_short_was_cut() -> None:
    reader = lines(shortest=8)
    assert brief(reader.feed(b"ok\nok cut", 3)) == [("ok", "ok")]
    assert brief(reader.close()) == [("length", b"ok cut")]


def test_buffer_remembers_no_chunk_it_does_not_need() -> None:
    buffer = FrameBuffer()
    for i in range(1000):
        buffer.push(b"ab", i)
        buffer.push(b"", i)
        buffer.accept(2, (said("", i, 0),))
    assert len(buffer) == 0
    assert len(buffer.take()) == 1000
    assert not buffer._chunks


def test_a_long_run_of_junk_keeps_its_reason():
    buffer = FrameBuffer()
    buffer.push(bytes(2 * JUNK_MAX + 20), 0)
    buffer.begin(10, "length")
    buffer.extend(2 * JUNK_MAX - 10)
    buffer.accept(5, ())
    buffer.extend(15)
    buffer.flush()
    pieces = [(record.reason, len(record.data)) for record in buffer.take()]
    assert pieces == [("length", JUNK_MAX), ("length", JUNK_MAX), ("unknown", 15)]


def test_a_line_may_be_longer_than_a_run_of_junk():
    (record,) = lines(longest=3000).feed(b"ok" + b"x" * 2500 + b"\n", 0)
    assert (type(record), record.line_bytes) == (NmeaSentence, 2503)
    found = lines(longest=3000).feed(b"x" * 2500 + b"\n", 0)
    assert [(r.reason, len(r.data)) for r in found] == [
        ("syntax", JUNK_MAX),
        ("syntax", JUNK_MAX),
        ("syntax", 2501 - 2 * JUNK_MAX),
    ]
