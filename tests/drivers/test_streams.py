"""What holds for every codec on every stream: chunking, junk, damage, truncation.

Longer searches for the same: ``python -m tests.fuzz``.
"""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import registry
from drivers.records import Rejected
from tests.drivers.imu_frames import IMU
from tests.drivers.streams import FRAMES, STRONG, bare, check_tiling, decoder, good, run

FORMAT_IN_OPTIONS = set(IMU)
"""One set of options reads several formats and writes one."""

EVERY = pytest.mark.parametrize("name", sorted(FRAMES))


def junk(name: str) -> st.SearchStrategy[bytes]:
    """Any bytes where a frame's beginning is unmistakable, lines where only their ends are."""
    end = b"\n" if name == "tracklink-log" else b""
    return st.binary(max_size=60).map(lambda noise: noise + end)


def damaged(frames: list[bytes]) -> st.SearchStrategy[bytes]:
    """A frame, one with a byte changed, a piece of one, noise, or a line too long."""
    frame = st.sampled_from(frames)
    changed = st.builds(
        lambda whole, at, by: whole[: at % len(whole)] + by + whole[at % len(whole) + 1 :],
        frame,
        st.integers(0, 10_000),
        st.binary(min_size=1, max_size=1),
    )
    piece = st.builds(lambda whole, at: whole[: at % len(whole)], frame, st.integers(0, 10_000))
    long_line = st.integers(900, 1200).map(lambda length: b"#" * length)
    return st.one_of(frame, changed, piece, st.binary(max_size=80), long_line)


def cut(stream: bytes, places: list[int]) -> list[bytes]:
    bounds = sorted({0, len(stream), *(place % (len(stream) + 1) for place in places)})
    return [stream[a:b] for a, b in pairwise(bounds)]


def test_every_registered_codec_is_tried_here() -> None:
    assert set(FRAMES) == set(registry.CODECS)


@EVERY
def test_whole_stream_decodes(name: str) -> None:
    frames = FRAMES[name]
    records = run(name, frames)
    assert len(records) == len(frames)
    assert not any(isinstance(record, Rejected) for record in records)
    assert bare(run(name, [b"".join(frames)])) == bare(records)


@EVERY
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_chunking_gives_the_same_records(name: str, data: st.DataObject) -> None:
    stream = b"".join(data.draw(st.lists(damaged(FRAMES[name]), max_size=8)))
    chunks = cut(stream, data.draw(st.lists(st.integers(0, 10_000), max_size=12)))
    records = run(name, chunks)
    assert bare(records) == bare(run(name, [stream]))
    check_tiling(name, chunks, records)


@EVERY
def test_byte_by_byte(name: str) -> None:
    stream = b"\x00noise\n" + b"".join(FRAMES[name]) + FRAMES[name][0][:-3]
    chunks = [bytes([byte]) for byte in stream]
    records = run(name, chunks)
    assert bare(records) == bare(run(name, [stream]))
    check_tiling(name, chunks, records)


@EVERY
def test_long_junk_stays_bounded(name: str) -> None:
    """A wrong baud rate for ever: everything comes out as rejected bytes, little is held back."""
    reader = decoder(name)
    junk = b"\xfe\x81\xffU $1 2" * 512
    out = sum(
        len(r.data) for i in range(8) for r in reader.feed(junk, i) if isinstance(r, Rejected)
    )
    held = 8 * len(junk) - out
    assert 0 <= held <= 2048
    assert held == sum(len(r.data) for r in reader.close() if isinstance(r, Rejected))


@EVERY
def test_one_flipped_bit_costs_only_its_frame(name: str) -> None:
    frames = FRAMES[name]
    before, *after = (record for frame in (frames[0], *frames[2:]) for record in run(name, [frame]))
    for bit in range(8 * len(frames[1])):
        hit = bytearray(frames[1])
        hit[bit // 8] ^= 1 << bit % 8
        stream = frames[0] + bytes(hit) + b"".join(frames[2:])
        records = run(name, [stream])
        check_tiling(name, [stream], records)
        kept = good(records)
        assert kept[0] == bare([before])[0], bit
        assert kept[-len(after) :] == bare(after), bit
        assert len(kept) <= len(frames), bit
        if name in STRONG:
            assert len(kept) == len(frames) - 1, bit


@EVERY
def test_truncation_at_every_byte_costs_only_its_frame(name: str) -> None:
    frames = FRAMES[name]
    rest = [record for frame in frames[2:] for record in good(run(name, [frame]))]
    first = good(run(name, [frames[0]]))
    for length in range(len(frames[1])):
        stream = frames[0] + frames[1][:length] + b"".join(frames[2:])
        if name == "tracklink-log" and 0 < length < len(frames[1]) - 1:
            stream = frames[0] + frames[1][:length] + b"\n" + b"".join(frames[2:])
        records = run(name, [stream])
        check_tiling(name, [stream], records)
        kept = good(records)
        assert kept[:1] == first, length
        assert kept[-len(rest) :] == rest, length


@EVERY
def test_a_stream_that_ends_anywhere(name: str) -> None:
    frames = FRAMES[name]
    whole = good(run(name, frames[:1]))
    for length in range(len(frames[1])):
        records = run(name, [frames[0] + frames[1][:length]])
        assert good(records)[:1] == whole
        assert len(good(records)) <= 2
        check_tiling(name, [frames[0] + frames[1][:length]], records)


@EVERY
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_junk_between_frames_costs_nothing(name: str, data: st.DataObject) -> None:
    pieces = [data.draw(junk(name)) + frame for frame in FRAMES[name]]
    wanted = good(run(name, FRAMES[name]))
    assert good(run(name, pieces)) == wanted


@EVERY
@settings(max_examples=80, deadline=None)
@given(chunks=st.lists(st.binary(max_size=200), max_size=6))
def test_garbage_never_raises_and_is_accounted_for(name: str, chunks: list[bytes]) -> None:
    chunks = [chunk for chunk in chunks if chunk]
    check_tiling(name, chunks, run(name, chunks))


@pytest.mark.parametrize("name", sorted(set(FRAMES) - FORMAT_IN_OPTIONS))
def test_round_trip(name: str) -> None:
    codec = registry.lookup(name)
    for frame in FRAMES[name]:
        (record,) = run(name, [frame])
        assert good(run(name, [codec.encode(record, codec.options())])) == bare([record])
