"""STDBIN: versions, masks, blocks of unknown size, answers, times around midnight, round trips."""

import math
import struct

import msgspec
import pytest

from drivers.imu.stdbin.layout import EXTENDED, EXTERNAL, NAVIGATION
from drivers.imu.stdbin.telegrams import STDBIN, StdbinOptions
from drivers.records import (
    CompensatedRecord,
    DepthRecord,
    DvlRecord,
    GnssRecord,
    HeadingRecord,
    ImuRecord,
    LblRecord,
    LblReply,
    OtherFrame,
    Record,
    Rejected,
    TimeRecord,
    UsblRecord,
)

SAMPLE = ImuRecord(
    t_rx_ns=0,
    sequence=7,
    t_device_s=43200.25,
    rate_rad_s=(0.1, -0.2, 0.3),
    specific_force_m_s2=(0.5, -1.5, 9.8),
    temperature_c=21.5,
)


def read(stream: bytes, **options: object) -> list[Record | Rejected]:
    reader = STDBIN.decoder(msgspec.convert(options, StdbinOptions))
    return [*reader.feed(stream, 7), *reader.close()]


def telegram(
    masks: tuple[int, int, int], body: bytes, version: int = 5, inner: int = 0, validity: int = 0
) -> bytes:
    """A telegram put together by hand."""
    head = b"IX" + bytes([version]) + struct.pack(">I", masks[0])
    head += struct.pack(">I", masks[1]) if version > 2 else b""
    head += struct.pack(">I", masks[2])
    head += struct.pack(">H", inner) if version > 3 else b""
    size = len(head) + 10 + len(body) + 4
    whole = head + struct.pack(">HII", size, validity, 1) + body
    return whole + struct.pack(">I", sum(whole))


@pytest.mark.parametrize("version", [3, 4, 5])
def test_samples_round_trip(version: int) -> None:
    (record,) = read(STDBIN.encode(SAMPLE, StdbinOptions(version=version)))
    assert record.rate_rad_s == pytest.approx(SAMPLE.rate_rad_s, rel=1e-6)
    assert record.specific_force_m_s2 == pytest.approx(SAMPLE.specific_force_m_s2, rel=1e-6)
    assert (record.sequence, record.t_device_s) == (7, pytest.approx(43200.25))
    assert (record.temperature_c, record.valid) == (21.5, True)


def test_version_2_has_no_raw_rotation() -> None:
    with pytest.raises(ValueError, match="version 2"):
        STDBIN.encode(SAMPLE, StdbinOptions(version=2))


# Numbers that every format of the blocks holds exactly.
@pytest.mark.parametrize(
    "record",
    [
        CompensatedRecord(
            t_rx_ns=0,
            sequence=3,
            t_device_s=5.0,
            rate_rad_s=(math.radians(0.5), 0.0, 0.0),
            acceleration_m_s2=(0.25, 0.5, -0.125),
        ),
        HeadingRecord(
            t_rx_ns=0, t_device_s=5.0, heading_deg=12.5, roll_deg=1.5, pitch_deg=2.5, sd_deg=0.25
        ),
        GnssRecord(
            t_rx_ns=0,
            age_s=0.5,
            t_device_s=5.0,
            valid=True,
            lat_deg=-33.5,
            lon_deg=-72.25,
            height_m=12.5,
            geoid_m=10.0,
            quality=2,
            sd_m=(0.5, 0.25, 1.0),
        ),
        UsblRecord(
            t_rx_ns=0,
            age_s=1.5,
            t_device_s=5.0,
            beacon="12",
            lat_deg=1.5,
            lon_deg=-2.5,
            depth_m=50.5,
        ),
        DepthRecord(t_rx_ns=0, age_s=0.25, t_device_s=5.0, depth_m=12.5, sd_m=0.5),
        DvlRecord(
            t_rx_ns=0,
            age_s=0.25,
            t_device_s=5.0,
            velocity_m_s=(1.5, 0.5, -0.25),
            altitude_m=20.5,
            sd_m_s=(0.5, 0.5, 0.25),
            sound_speed_m_s=1500.0,
        ),
        DvlRecord(
            t_rx_ns=0,
            age_s=0.25,
            t_device_s=5.0,
            valid=False,
            water_velocity_m_s=(1.5, 0.5, -0.25),
            sound_speed_m_s=1500.0,
        ),
        LblRecord(
            t_rx_ns=0,
            age_s=2.0,
            t_ping_s=5.0,
            replies=(LblReply(beacon="A7", range_m=238.5),),
        ),
    ],
    ids=lambda record: type(record).__name__,
)
@pytest.mark.parametrize("version", [2, 3, 4, 5])
def test_other_records_round_trip(record: Record, version: int) -> None:
    (back,) = read(STDBIN.encode(record, StdbinOptions(version=version)))
    assert msgspec.structs.replace(back, t_rx_ns=0, line_bytes=0) == record


def test_records_no_block_can_say() -> None:
    with pytest.raises(ValueError, match="cannot say a TimeRecord"):
        STDBIN.encode(TimeRecord(t_rx_ns=0, unix_s=1.0), StdbinOptions())
    with pytest.raises(ValueError, match="latitude and longitude"):
        STDBIN.encode(UsblRecord(t_rx_ns=0, beacon="1"), StdbinOptions())


@pytest.mark.parametrize("bit", sorted(NAVIGATION))
def test_depth_behind_every_navigation_block(bit: int) -> None:
    body = bytes(NAVIGATION[bit]) + struct.pack(">iff", 0, 12.5, 0.5)
    for version in (2, 3, 4, 5):
        records = read(telegram((1 << bit, 0, 1 << 9), body, version, NAVIGATION[bit]))
        assert records[-1].depth_m == 12.5


@pytest.mark.parametrize("bit", sorted(EXTENDED))
def test_depth_behind_every_extended_block(bit: int) -> None:
    body = bytes(EXTENDED[bit]) + struct.pack(">iff", 0, 12.5, 0.5)
    for version in (3, 4, 5):
        records = read(telegram((0, 1 << bit, 1 << 9), body, version, EXTENDED[bit]))
        assert records[-1].depth_m == 12.5


@pytest.mark.parametrize("bit", sorted(bit for bit in EXTERNAL if bit < 9))
def test_depth_behind_every_external_block(bit: int) -> None:
    body = bytes(EXTERNAL[bit]) + struct.pack(">iff", 0, 12.5, 0.5)
    records = read(telegram((0, 0, 1 << bit | 1 << 9), body))
    assert records[-1].depth_m == 12.5


def test_a_navigation_block_of_unknown_size_is_jumped() -> None:
    """Only versions 4 and 5 say how far."""
    depth = struct.pack(">iff", 0, 12.5, 0.5)
    (known,) = read(telegram((1 << 31, 0, 1 << 9), bytes(17) + depth, 5, 17))
    assert known.depth_m == 12.5
    (hidden,) = read(telegram((1 << 31, 0, 1 << 9), bytes(17) + depth, 3))
    assert isinstance(hidden, OtherFrame)


def test_an_external_block_of_unknown_size_hides_those_behind_it() -> None:
    depth = struct.pack(">iff", 0, 12.5, 0.5)
    records = read(telegram((0, 0, 1 << 9 | 1 << 23 | 1 << 27), depth + bytes(60)))
    assert [type(record) for record in records] == [DepthRecord]


@pytest.mark.parametrize("missing", [1, 12, -1])
def test_a_telegram_that_is_not_as_long_as_its_masks_say(missing: int) -> None:
    body = (struct.pack(">iff", 0, 12.5, 0.5) + b"-")[: 12 - missing]
    (record,) = read(telegram((0, 0, 1 << 9), body))
    assert (type(record), record.reason) == (Rejected, "syntax")


def test_navigation_size_beyond_the_telegram() -> None:
    (record,) = read(telegram((0, 0, 1 << 9 | 1 << 23), bytes(12), 5, 60_000))
    assert isinstance(record, Rejected)


def test_answers_to_commands() -> None:
    text = b"$PIXSE,CONFIG,OK*00\r\n"
    answer = b"AN\x03" + struct.pack(">H", 5 + len(text) + 4) + text
    answer += struct.pack(">I", sum(answer))
    (record,) = read(answer)
    assert (record.name, record.data) == ("answer", answer)


def test_a_block_from_before_midnight() -> None:
    late = struct.pack(">iff", 863_999_000, 12.5, 0.5)
    (record,) = read(telegram((0, 0, 1 << 9), late, validity=500))
    assert record.t_device_s == pytest.approx(86399.9)
    assert record.age_s == pytest.approx(0.15)


@pytest.mark.parametrize("tag", [1_200_000, 100_000])
def test_a_block_with_another_clock_has_no_age(tag: int) -> None:
    (record,) = read(telegram((0, 0, 1 << 9), struct.pack(">iff", tag, 1, 1), validity=1_000_000))
    assert record.age_s is msgspec.UNSET


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30])
def test_a_sample_that_is_none_is_not_valid(value: float) -> None:
    bad = msgspec.structs.replace(SAMPLE, specific_force_m_s2=(0.0, value, 0.0))
    (record,) = read(STDBIN.encode(bad, StdbinOptions()))
    assert not record.valid


@pytest.mark.parametrize(("bit", "size"), [(3, 46), (6, 49), (9, 12), (10, 37), (11, 33), (14, 41)])
def test_blocks_of_no_numbers(bit: int, size: int) -> None:
    (record,) = read(telegram((0, 0, 1 << bit), b"\xff" * size), geoid_m=45.0)
    assert not record.valid
    assert "nan" not in repr(record).lower()


def test_navigation_of_no_numbers() -> None:
    masks = (1 << 0 | 1 << 1 | 1 << 5 | 1 << 6 | 1 << 25 | 1 << 28, 1 << 2, 0)
    size = 12 + 12 + 12 + 12 + 12 + 12 + 12
    for record in read(telegram(masks, b"\xff" * size)):
        assert not record.valid
        assert "nan" not in repr(record).lower()


@pytest.mark.parametrize("begin", [b"IX\x05" + bytes(14) + b"\xff\xff", b"AN\x05\xff\xff"])
def test_a_length_beyond_belief_is_not_waited_for(begin: bytes) -> None:
    reader = STDBIN.decoder(StdbinOptions())
    records = reader.feed(begin + STDBIN.encode(SAMPLE, StdbinOptions()), 0)
    assert [type(record).__name__ for record in records] == ["Rejected", "ImuRecord"]


def test_manual_gnss_is_not_measured() -> None:
    block = struct.pack(">iBBdd6f", 0, 2, 4, 48.5, 2.0, 10.0, 1, 1, 1, 0, 0)
    (record,) = read(telegram((0, 0, 1 << 3), block), geoid_m=45.0)
    assert (record.valid, record.height_m, record.geoid_m) == (False, 55.0, 45.0)
