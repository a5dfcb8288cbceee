"""Framing of NovAtel logs: long and short binary headers and their ASCII twins, one CRC for all.

========= ===================================================== ================================
bytes     long binary                                           short binary
========= ===================================================== ================================
0-2       AA 44 12                                              AA 44 13
3         header length u8 (28)                                 message length u8
4-5       message id u16                                        message id u16
8-9       message length u16                                    6-7: week u16
14-15     week u16                                              8-11: milliseconds of week u32
16-19     milliseconds of week u32
========= ===================================================== ================================

Little-endian; behind the message a CRC-32 (EDB88320 reflected, begun with 0, not inverted). ASCII
logs: ``#NAME,port,...,week,seconds,...;fields*crc`` and ``%NAME,week,seconds;fields*crc`` with CR
LF, the CRC in hex over what stands between the first character and the asterisk.
"""

import re
from struct import Struct
from zlib import crc32

SYNCS = (b"\xaa\x44\x12", b"\xaa\x44\x13", b"#", b"%")
MESSAGE_MAX = 8192
"""Longest long binary log believed (bytes); what says more is taken for damage."""
LONG, SHORT = 0x12, 0x13
LONG_HEADER, SHORT_HEADER = 28, 12

_ONES = 0xFFFFFFFF
_LINE = re.compile(rb"[#%][ -~]{0,500}(?:\r\n|(\r?\Z))")
_LONG = Struct("<3sBHBBHHBBHIIHH")
_SHORT = Struct("<3sBHHI")


def measure(data: bytes, at: int) -> int | None:
    """Length of the log that begins at `at`; 0 if none does, None if it is too early to say."""
    if data[at] != 0xAA:
        line = _LINE.match(data, at)
        if line is None:
            return 0
        return None if line[1] is not None else line.end() - at
    if len(data) < at + 10:
        return None
    if data[at + 2] == SHORT:
        return SHORT_HEADER + data[at + 3] + 4
    length = data[at + 8] | data[at + 9] << 8
    if data[at + 3] < LONG_HEADER or length > MESSAGE_MAX:
        return 0
    return data[at + 3] + length + 4


def crc(data: bytes) -> int:
    """CRC-32 as NovAtel begins and ends it."""
    return crc32(data, _ONES) ^ _ONES


def holds(log: bytes) -> bool:
    """Whether the CRC of a whole log, binary or ASCII, is its own."""
    if log[0] == 0xAA:
        return crc(log[:-4]) == int.from_bytes(log[-4:], "little")
    body, star, said = log[1:-2].rpartition(b"*")
    return star == b"*" and b"%08x" % crc(body) == said.lower()


def short(identifier: int, message: bytes, seconds: float) -> bytes:
    """A log with the short header; the week is 0."""
    log = _SHORT.pack(SYNCS[1], len(message), identifier, 0, round(seconds * 1000)) + message
    return log + crc(log).to_bytes(4, "little")


def long(identifier: int, message: bytes, seconds: float) -> bytes:
    """A log with the long header, from the first serial port; the week is 0."""
    # Port COM1, no sequence, idle time 0, time status "fine steering" (180).
    log = _LONG.pack(
        *(SYNCS[0], LONG_HEADER, identifier, 0, 0x20, len(message), 0),
        *(0, 180, 0, round(seconds * 1000), 0, 0, 0),
    )
    log += message
    return log + crc(log).to_bytes(4, "little")


def ascii_log(header: str, fields: list[str]) -> bytes:
    """A log in ASCII; `header` begins with # or %."""
    body = f"{header};{','.join(fields)}"
    return f"{body}*{crc(body[1:].encode()):08x}\r\n".encode()
