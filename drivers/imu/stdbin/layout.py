"""Where the blocks of a STDBIN telegram stand: headers, masks and sizes of versions 2 to 5.

Big-endian: 49 58 ("IX"), version u8, mask of navigation blocks u32, from version 3 on that of
extended navigation blocks u32, mask of external blocks u32, from version 4 on the size of both
kinds of navigation blocks u16, size of the telegram u16, time of validity u32 (100 us of the day),
counter u32; the blocks of the three masks, each from bit 0 up; the sum of all bytes before it u32.
Answers to commands: 41 4E ("AN"), version u8, size of the telegram u16, text, sum.
"""

from enum import IntEnum
from struct import Struct
from typing import NamedTuple

TELEGRAM, ANSWER = b"IX", b"AN"
VERSIONS = (2, 3, 4, 5)
SUM = 4

_FIRST = (12, 12, 16, 8, 12, 12, 12, 21, 16, 12, 12, 8, 8, 4, 8, 16)
_SECOND = (12, 4, 4, 12, 4, 12, 12, 12, 8, 12, 16, 12, 12, 12, 12)
NAVIGATION = dict(enumerate((*_FIRST, *_SECOND)))
EXTENDED = dict(enumerate((12, 12, 12, 12, 12, 21, 16)))
EXTERNAL = {
    0: 5,
    **dict.fromkeys((1, 2, 3), 46),
    **dict.fromkeys((4, 5), 13),
    **dict.fromkeys((6, 7, 8), 49),
    9: 12,
    **dict.fromkeys((10, 21), 37),
    **dict.fromkeys((11, 22), 33),
    **dict.fromkeys((12, 13), 8),
    **dict.fromkeys((14, 15, 16, 17), 41),
    **dict.fromkeys((18, 19, 20), 9),
    24: 16,
    **dict.fromkeys((25, 26), 17),
    27: 40,
}
"""Bytes of each block by its bit."""

_HEADERS = {
    2: Struct(">2sBIIHII"),
    3: Struct(">2sBIIIHII"),
    4: Struct(">2sBIIIHHII"),
    5: Struct(">2sBIIIHHII"),
}
_VALIDITY = Struct(">II")
_MASKS_END = {2: 11, 3: 15, 4: 17, 5: 17}
"""Where the masks, with the size of the navigation blocks, end and the telegram's size stands."""


class Kind(IntEnum):
    """The three masks; a block's key is its kind times 32 plus its bit."""

    NAVIGATION = 0
    EXTENDED = 32
    EXTERNAL = 64


class Layout(NamedTuple):
    """Where in a telegram each block stands that can be found, by its key.

    ``size`` is that of the telegram; at least that where a block of unknown size stands in it.
    """

    places: dict[int, int]
    size: int
    is_whole: bool

    def fits(self, telegram: bytes) -> bool:
        """Whether the telegram is as long as its masks say."""
        return len(telegram) == self.size or (not self.is_whole and len(telegram) > self.size)


LONGEST = 4096
"""Bytes that are waited for: all known blocks together take 1.2 kB."""


def measure(data: bytes, at: int) -> int | None:
    """Bytes of the telegram or answer that begins at `at`; a length beyond belief is none."""
    if len(data) < at + 5:
        return None
    version = data[at + 2]
    if version not in VERSIONS:
        return 0
    if data[at] == ANSWER[0]:
        size = data[at + 3] << 8 | data[at + 4]
        return size if 5 + SUM <= size <= LONGEST else 0
    place = at + _MASKS_END[version]
    if len(data) < place + 2:
        return None
    size = data[place] << 8 | data[place + 1]
    return size if _HEADERS[version].size + SUM <= size <= LONGEST else 0


def holds(telegram: bytes) -> bool:
    """Whether the sum at the end is that of all bytes before it."""
    return sum(telegram[:-SUM]) & 0xFFFFFFFF == int.from_bytes(telegram[-SUM:], "big")


def head(telegram: bytes) -> bytes:
    """Version and masks, on which the layout depends."""
    return telegram[2 : _MASKS_END[telegram[2]]]


def validity_counter(telegram: bytes) -> tuple[int, int]:
    """Time of validity (100 us of the day) and counter of a telegram."""
    validity, counter = _VALIDITY.unpack_from(telegram, _MASKS_END[telegram[2]] + 2)
    return validity, counter


def write(version: int, validity: int, counter: int, blocks: dict[int, bytes]) -> bytes:
    """Write a telegram of blocks by their keys.

    Raises
    ------
    ValueError
        For an extended block in version 2, which has none.
    """
    masks = [0, 0, 0]
    for key in blocks:
        masks[key // 32] |= 1 << key % 32
    if version == 2 and masks[1]:
        raise ValueError("version 2 has no extended blocks: no raw rotation rate")
    content = b"".join(blocks[key] for key in sorted(blocks))
    inner = sum(len(block) for key, block in blocks.items() if key < Kind.EXTERNAL)
    masked: list[int] = [version, masks[0], *([masks[1]] if version > 2 else []), masks[2]]
    masked += [inner] if version > 3 else []
    header = _HEADERS[version]
    size = header.size + len(content) + SUM
    telegram = header.pack(TELEGRAM, *masked, size, validity, counter) + content
    return telegram + sum(telegram).to_bytes(SUM, "big")


def layout_of(head: bytes) -> Layout:
    """Work out version and masks, as `head` gives them."""
    version, size_at = head[0], len(head)
    navigation = int.from_bytes(head[1:5], "big")
    extended = int.from_bytes(head[5:9], "big") if version > 2 else 0
    external_at = 9 if version > 2 else 5
    external = int.from_bytes(head[external_at : external_at + 4], "big")
    places: dict[int, int] = {}
    at = _HEADERS[version].size
    at, is_whole = _place(places, Kind.NAVIGATION, navigation, NAVIGATION, at)
    if is_whole:
        at, is_whole = _place(places, Kind.EXTENDED, extended, EXTENDED, at)
    if version > 3:
        is_whole = True
        at = max(at, _HEADERS[version].size + int.from_bytes(head[size_at - 2 : size_at], "big"))
    if is_whole:
        at, is_whole = _place(places, Kind.EXTERNAL, external, EXTERNAL, at)
    return Layout(places, at + SUM, is_whole)


def _place(
    places: dict[int, int], kind: Kind, mask: int, sizes: dict[int, int], at: int
) -> tuple[int, bool]:
    """Add the blocks of one mask; give where they end, and whether all their sizes are known."""
    for bit in (b for b in range(32) if mask >> b & 1):
        if bit not in sizes:
            return at, False
        places[kind + bit] = at
        at += sizes[bit]
    return at, True
