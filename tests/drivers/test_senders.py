"""Streams of several senders on one line: frames are never put together from two of them."""

from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from drivers import registry
from drivers.imu.kvh import KVH1750, KvhOptions
from drivers.records import ImuRecord, Rejected
from drivers.senders import MOST_SENDERS, SenderCounts, Senders


def kvh() -> Senders:
    return Senders(partial(KVH1750.decoder, KvhOptions()))


def stream(first: int, count: int) -> bytes:
    """Frames of one unit, numbered from `first` on."""
    samples = (
        ImuRecord(
            t_rx_ns=0,
            sequence=first + n,
            delta_angle_rad=(0.001, 0.0, 0.0),
            specific_force_m_s2=(0.0, 0.0, -9.8),
        )
        for n in range(count)
    )
    return b"".join(KVH1750.encode(one, KvhOptions()) for one in samples)


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(1, 50)), max_size=60))
def test_interleaved_streams_give_what_each_gives_alone(turns: list[tuple[int, int]]) -> None:
    rest = [stream(40 * k, 10) for k in range(3)]
    senders = kvh()
    heard: list[list[int]] = [[], [], []]
    for who, size in [*turns, (0, 999), (1, 999), (2, 999)]:
        data, rest[who] = rest[who][:size], rest[who][size:]
        for record in senders.feed(data, 0, f"10.0.0.{who}:4001"):
            assert not isinstance(record, Rejected)
            heard[who].append(record.sequence)
    assert heard == [[40 * k + n for n in range(10)] for k in range(3)]
    assert not list(senders.close())
    size = len(stream(0, 10))
    assert senders.counts == {f"10.0.0.{k}:4001": SenderCounts(size, 10, 0) for k in range(3)}


def test_of_inventions_the_longest_silent_is_let_go_and_every_byte_counted() -> None:
    senders = kvh()
    half = stream(0, 1)[:20]
    records = list(senders.feed(half, 0, "a friend"))
    for n in range(100):
        records += senders.feed(half, 0, f"invented {n}")
        if n % 5 == 0:
            records += senders.feed(b"", 0, "a friend")
    records += senders.feed(stream(0, 1)[20:], 0, "a friend")
    assert len(senders.counts) == MOST_SENDERS
    assert senders.counts["a friend"] == SenderCounts(len(stream(0, 1)), 1, 0)
    records += senders.close()
    rejected = [record for record in records if isinstance(record, Rejected)]
    counted = [*senders.counts.values(), senders.others]
    assert sum(len(record.data) for record in rejected) == 100 * len(half)
    assert sum(counts.rejected_bytes for counts in counted) == 100 * len(half)
    assert sum(counts.bytes for counts in counted) == 100 * len(half) + len(stream(0, 1))


def test_every_codec_is_told_apart() -> None:
    for codec in registry.all_codecs():
        senders = Senders(partial(codec.decoder, codec.options()))
        list(senders.feed(b"\x01", 0, "one"))
        list(senders.feed(b"\x02", 0, "two"))
        list(senders.close())
        assert [counts.bytes for counts in senders.counts.values()] == [1, 1]
