"""Check values against their published test values and a bit-by-bit division."""

from hypothesis import given
from hypothesis import strategies as st

from drivers.checksums import crc32_mpeg2, crc32_mpeg2_holds, sum8, xor8


def divided(data: bytes) -> int:
    remainder = 0xFFFFFFFF
    for byte in data:
        remainder ^= byte << 24
        for _ in range(8):
            remainder = remainder << 1 ^ (0x04C11DB7 if remainder >> 31 else 0)
            remainder &= 0xFFFFFFFF
    return remainder


def test_check_value_of_the_catalogue() -> None:
    assert crc32_mpeg2(b"123456789").hex() == "0376e6e7"


@given(st.binary(max_size=64))
def test_crc_is_the_division(data: bytes) -> None:
    assert int.from_bytes(crc32_mpeg2(data), "big") == divided(data)
    assert crc32_mpeg2_holds(data + crc32_mpeg2(data))


@given(st.binary(min_size=5, max_size=40), st.integers(0, 10_000))
def test_crc_sees_one_bit(data: bytes, place: int) -> None:
    frame = bytearray(data + crc32_mpeg2(data))
    frame[place % len(frame)] ^= 1 << place % 8
    assert not crc32_mpeg2_holds(bytes(frame))


def test_sums() -> None:
    assert sum8(bytes.fromhex("fe8100aa7f7f7f7f7f7f")) == 0x23
    assert xor8(b"GPZDA,160012.71,11,03,2004,-1,00") == 0x7D
