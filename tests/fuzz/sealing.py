"""Check values set right again in a damaged stream, so that what they guard is reached too."""

import re
from collections.abc import Callable

from drivers.checksums import (
    crc16_arc,
    crc16_ccitt_false,
    crc16_kermit,
    crc16_xmodem,
    crc32_mpeg2,
    fletcher8,
    sum8,
    xor8,
)
from drivers.framing import SyncDecoder
from drivers.imu.novatel.frames import crc
from tests.drivers.streams import decoder

Seal = Callable[[bytes], bytes]
"""A frame, and the same with its check values right."""

NMEA = re.compile(rb"\$([^$*\r\n]*)\*[^\r\n]{0,2}")
FRAMED = re.compile(rb"(\+\+\+AT(?:\*[!-9;-~]{1,32})?:)\d{0,4}:([^\r\n]*)")
COUNTED = re.compile(rb"%D[0-9A-F]{0,4}([^%\r\n]*)(?=\r\n)")
HEX = re.compile(rb"\$((?:[0-9A-Fa-f]{2}){3,512})[0-9A-Fa-f]{4}(?=\r?\n)")


def sealed(codec: str, stream: bytes) -> bytes:
    """A stream whose frames, wherever they seem to begin, have the check values they need."""
    stream = NMEA.sub(lambda found: b"$%s*%02X" % (found[1], xor8(found[1])), stream)
    if codec == "evologics":
        return FRAMED.sub(lambda found: b"%s%d:%s" % (found[1], len(found[2]), found[2]), stream)
    if codec == "seatrac":
        return HEX.sub(_sealed_hex, stream)
    if codec == "micronnav":
        return COUNTED.sub(lambda found: b"%%D%04X%s" % (len(found[1]) + 8, found[1]), stream)
    seal = BINARY.get(codec)
    return stream if seal is None else _sealed_frames(codec, seal, stream)


def _sealed_frames(codec: str, seal: Seal, stream: bytes) -> bytes:
    reader = decoder(codec)
    assert isinstance(reader, SyncDecoder)
    out, at = b"", 0
    while candidate := reader._candidate(stream, at):
        out += stream[at : candidate.start()]
        at = candidate.start()
        length = 1
        if at < len(stream):
            length = reader._measure(stream, at) or 1
        frame = stream[at : at + length]
        out += seal(frame) if 1 < length == len(frame) else frame
        at += length
        if not length or not frame:
            break
    return out + stream[at:]


def _sealed_hex(found: re.Match[bytes]) -> bytes:
    content = bytes.fromhex(found[1].decode())
    return b"$" + (content + crc16_arc(content).to_bytes(2, "little")).hex().upper().encode()


def _kvh(frame: bytes) -> bytes:
    if frame[2] == 0xFF:
        return frame[:-4] + crc32_mpeg2(frame[:-4])
    return frame[:-1] + bytes([sum8(frame[:-1])])


def _stim300(frame: bytes) -> bytes:
    end = b"\r\n" if frame.endswith(b"\r\n") else b""
    body = frame[: len(frame) - len(end) - 4]
    return body + crc32_mpeg2(body + bytes(-len(body) % 4)) + end


def _novatel(frame: bytes) -> bytes:
    if frame[0] == 0xAA:
        return frame[:-4] + crc(frame[:-4]).to_bytes(4, "little")
    body, star, _ = frame.rpartition(b"*")
    return b"%s*%08x\r\n" % (body, crc(body[1:])) if star else frame


def _anpp(frame: bytes) -> bytes:
    header = frame[1:3] + crc16_ccitt_false(frame[5:]).to_bytes(2, "little")
    return bytes([-sum(header) & 0xFF]) + header + frame[5:]


def _hg4930(frame: bytes) -> bytes:
    words = [int.from_bytes(frame[at : at + 2], "little") for at in range(0, len(frame) - 2, 2)]
    return frame[:-2] + (sum(words) & 0xFFFF).to_bytes(2, "little")


BINARY: dict[str, Seal] = {
    "kvh1750": _kvh,
    "stim300": _stim300,
    "novatel-span": _novatel,
    "vectornav": lambda f: f[:-2] + crc16_xmodem(f[1:-2]).to_bytes(2, "big"),
    "xsens-mtdata2": lambda f: f[:-1] + bytes([-sum(f[1:-1]) & 0xFF]),
    "mip": lambda f: f[:-2] + fletcher8(f[:-2]),
    "sbg-ecom": lambda f: f[:-3] + crc16_kermit(f[2:-3]).to_bytes(2, "little") + b"\x33",
    "anpp": _anpp,
    "hg4930": _hg4930,
    "stdbin": lambda f: f[:-4] + (sum(f[:-4]) & 0xFFFFFFFF).to_bytes(4, "big"),
    "pd0": lambda f: f[:-2] + (sum(f[:-2]) & 0xFFFF).to_bytes(2, "little"),
}
