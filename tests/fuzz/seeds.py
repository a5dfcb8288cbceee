"""What a hunt begins with: golden frames, those of the tests, and the words they are made of."""

import re
from pathlib import Path

from tests.drivers.streams import FRAMES
from tests.fuzz import corpus
from tests.fuzz.trial import trial_of
from tests.shared_data import SHARED

GOLDEN = {
    "kvh1750": "imu/kvh1775*.hex",
    "stim300": "imu/stim300*.hex",
    "novatel-span": "imu/novatel*.hex",
    "vectornav": "imu/vectornav*.hex",
    "xsens-mtdata2": "imu/xsens*.hex",
    "mip": "imu/mip*.hex",
    "anpp": "imu/anpp*.hex",
    "stdbin": "imu/ixblue*.hex",
    "phins": "imu/phins*.hex",
    "tracklink-lxt": "usbl/tracklink_lxt.txt",
    "tracklink-tp2": "usbl/tracklink_tp2.txt",
    "tracklink-gll": "usbl/tracklink_gll.txt",
    "evologics": "usbl/evologics*.txt",
    "psimssb": "usbl/psimssb*.txt",
    "gaps": "usbl/ixblue*.txt",
    "psonlld": "usbl/sonardyne*.txt",
    "usrth": "usbl/cerulean*.txt",
    "micronnav": "usbl/tritech*.txt",
}
"""Where in the shared vectors the frames of a codec are, if they are here."""

_WORD = re.compile(rb"[A-Za-z]{2,}|[+$#%:*]+[A-Za-z+]*")


def seeds(codec: str) -> list[bytes]:
    """Inputs: every known frame alone, all those of the tests together, and the kept corpus."""
    frames = FRAMES[codec] + golden(codec)
    streams = [*frames, b"".join(FRAMES[codec]), b"".join(FRAMES[codec][:2])]
    cuts = (1, 0, 5, 6)
    return [trial_of(s, n, cuts[n % 4]) for n, s in enumerate(streams)] + corpus.read(codec)


def golden(codec: str) -> list[bytes]:
    """Frames of the shared vectors."""
    if codec not in GOLDEN:
        return []
    return [
        frame for path in sorted(SHARED.glob(f"vectors/{GOLDEN[codec]}")) for frame in _in(path)
    ]


def _in(path: Path) -> list[bytes]:
    if path.suffix == ".hex":
        return [bytes.fromhex(line) for line in path.read_text().split()]
    lines = path.read_bytes().splitlines()
    return [line + b"\r\n" for line in lines if line and not line.startswith(b"#")]


def words(codec: str) -> list[bytes]:
    """How frames begin, and the words in those that are text."""
    found: set[bytes] = {b"\r\n"}
    for frame in FRAMES[codec] + golden(codec):
        found |= {frame[:length] for length in (1, 2, 3, 4, 6)}
        if frame.strip().isascii():
            found |= {word[:24] for word in _WORD.findall(frame)}
            found |= {b"," + field[:24] + b"," for field in frame.strip().split(b",")[1:4]}
    return sorted(found)
