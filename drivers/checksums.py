"""Check values of the wire formats, each at the speed of the C code it leans on."""

from zlib import crc32

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_ONES = 0xFFFFFFFF


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
