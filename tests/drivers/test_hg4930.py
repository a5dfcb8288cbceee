"""Honeywell's messages by the tables of the manual: sums, scales, faults, what is not used."""

import struct

import pytest

from drivers.imu.hg4930 import HG4930, Hg4930Options
from drivers.records import ImuRecord, OtherFrame, Record, Rejected

FOOT = 0.3048
CONTROL = (100, -200, 300, 1000, -2000, 3000)
INCREMENTS = (1 << 20, -(1 << 21), 1 << 22, 1 << 24, -(1 << 25), (1 << 31) - 1)


def frame(message: int, status: int = 4, status_2: int = 7) -> bytes:
    """As the manual's tables have it, summed as its program does."""
    body = struct.pack("<BB6hHH", 0x0E, message, *CONTROL, status, status_2)
    if message == 2:
        body += struct.pack("<6i", *INCREMENTS)
    total = 0
    for at in range(0, len(body), 2):
        total = (total + body[at] + 256 * body[at + 1]) % 65536
    return body + bytes([total % 256, total // 256])


def read(stream: bytes, **options: str) -> list[Record | Rejected]:
    reader = HG4930.decoder(Hg4930Options(**options))
    return [*reader.feed(stream, 0), *reader.close()]


def test_lengths_of_the_manual() -> None:
    assert [len(frame(message)) for message in (1, 2)] == [20, 44]


def test_increments_of_every_sixth_message() -> None:
    *control, sample = read(5 * frame(1) + frame(2))
    assert [record.name for record in control] == 5 * ["control message"]
    assert isinstance(sample, ImuRecord)
    assert sample.valid
    assert sample.delta_angle_rad == (2.0**-13, -(2.0**-12), 2.0**-11)
    assert sample.delta_velocity_m_s == pytest.approx(
        (FOOT / 8, -FOOT / 4, FOOT * 16 * (1 - 2**-31))
    )


def test_rates_of_each_message() -> None:
    first, second = read(frame(1) + frame(2), prefer="rates")
    assert first.rate_rad_s == pytest.approx([n * 600 / 2**20 for n in (100, -200, 300)])
    assert first.specific_force_m_s2 == pytest.approx(
        [n * 600 / 2**14 * FOOT for n in (1000, -2000, 3000)]
    )
    assert second.rate_rad_s == first.rate_rad_s


@pytest.mark.parametrize("bit", [4, 5, 6, 7, 8, 9, 10, 15])
def test_faults_of_the_first_status(bit: int) -> None:
    (sample,) = read(frame(2, status=1 << bit))
    assert not sample.valid


@pytest.mark.parametrize("bit", [8, 10, 11, 12, 13, 14])
def test_faults_of_the_second_status(bit: int) -> None:
    (sample,) = read(frame(2, status_2=1 << bit))
    assert not sample.valid


@pytest.mark.parametrize("counter", range(16))
def test_counter_and_test_are_no_faults(counter: int) -> None:
    (sample,) = read(frame(2, status=counter))
    assert sample.valid


@pytest.mark.parametrize(("low", "degrees"), [(25, 25), (0xE1, -31)])
def test_temperature_where_it_is_told(low: int, degrees: int) -> None:
    (sample,) = read(frame(2, status_2=0x8000 | low))
    assert (sample.temperature_c, sample.valid) == (degrees, True)
    (cold,) = read(frame(2, status_2=low))
    assert cold.temperature_c is None


def test_what_is_sent_before_there_are_data() -> None:
    (start,) = read(frame(2, status_2=1 << 9))
    assert (type(start), start.name) == (OtherFrame, "no data yet")


def test_what_is_beyond_a_field_is_its_end() -> None:
    fast = ImuRecord(t_rx_ns=0, rate_rad_s=(99.0, -99.0, 0.0), specific_force_m_s2=(1e3, 0.0, -1e3))
    options = Hg4930Options(prefer="rates")
    (again,) = read(HG4930.encode(fast, options), prefer="rates")
    assert again.rate_rad_s == pytest.approx((18.75, -18.75, 0.0), rel=1e-4)


def test_what_it_cannot_say() -> None:
    with pytest.raises(ValueError, match="does not carry"):
        HG4930.encode(ImuRecord(t_rx_ns=0), Hg4930Options())
