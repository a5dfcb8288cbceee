"""Check values of the wire formats, each at the speed of the C code it leans on."""

from binascii import crc_hqx
from itertools import accumulate
from zlib import crc32

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_ONES = 0xFFFFFFFF


def _arc_entry(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_ARC = tuple(map(_arc_entry, range(256)))


def crc32_mpeg2(data: bytes) -> bytes:
    """Give the CRC-32/MPEG-2 of `data` as the four big-endian bytes that follow it on the wire.

    Polynomial 04C11DB7, initial value FFFFFFFF, not reflected, no final inversion. zlib computes
    the same polynomial with every byte and the result mirrored, and inverts the result; mirroring
    both is much cheaper than a table loop in Python.
    """
    mirrored = crc32(data.translate(_REVERSED)) ^ _ONES
    return mirrored.to_bytes(4, "little").translate(_REVERSED)


def crc32_mpeg2_holds(frame: bytes) -> bool:
    """Tell whether `frame` ends in its own CRC-32/MPEG-2: the division leaves no remainder."""
    return crc32(frame.translate(_REVERSED)) == _ONES


def crc16_xmodem(data: bytes) -> int:
    """CRC-16/XMODEM: polynomial 1021, initial value 0, not reflected."""
    return crc_hqx(data, 0)


def crc16_ccitt_false(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 1021, initial value FFFF, not reflected."""
    return crc_hqx(data, 0xFFFF)


def crc16_kermit(data: bytes) -> int:
    """CRC-16/KERMIT: polynomial 1021 reflected, initial value 0: XMODEM of mirrored bytes."""
    mirrored = crc_hqx(data.translate(_REVERSED), 0)
    return int.from_bytes(mirrored.to_bytes(2, "big").translate(_REVERSED), "little")


def crc16_arc(data: bytes) -> int:
    """CRC-16/ARC: polynomial 8005 reflected, initial value 0."""
    crc = 0
    for byte in data:
        crc = crc >> 8 ^ _ARC[(crc ^ byte) & 0xFF]
    return crc


def fletcher8(data: bytes) -> bytes:
    """Two sums modulo 256: of all bytes, and of that sum after each byte."""
    return bytes((sum(data) & 0xFF, sum(accumulate(data)) & 0xFF))


def sum8(data: bytes) -> int:
    """Sum of all bytes modulo 256."""
    return sum(data) & 0xFF


def xor8(data: bytes) -> int:
    """Exclusive or of all bytes: the checksum of NMEA 0183.

    All bytes as one number, folded in half until one is left: half the time of a byte by byte
    reduction.
    """
    folded = int.from_bytes(data)
    half = 4 << len(data).bit_length()
    while half >= 8:
        folded ^= folded >> half
        half >>= 1
    return folded & 0xFF
