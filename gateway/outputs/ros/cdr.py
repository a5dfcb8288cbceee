"""Common Data Representation as ROS 2 speaks it: little-endian, each number aligned to its size.

Source: OMG CORBA 3.4 part 2, 9.3 (plain CDR), with the encapsulation header of DDSI-RTPS 2.5, 10.2.
"""

import struct
from collections.abc import Sequence
from typing import Self

_HEADER = b"\x00\x01\x00\x00"
"""CDR_LE, no options. What follows is aligned from its own beginning."""


class CdrWriter:
    """Puts fields one behind the other; each method returns the writer."""

    def __init__(self) -> None:
        self._data = bytearray()

    def number(self, code: str, value: float) -> Self:
        """A number; ``code`` as in `struct`."""
        return self.numbers(code, (value,))

    def numbers(self, code: str, values: Sequence[float]) -> Self:
        """An array of fixed length."""
        self._align(struct.calcsize(f"<{code}"))
        self._data += struct.pack(f"<{len(values)}{code}", *values)
        return self

    def text(self, text: str) -> Self:
        """A string: length with its closing zero, then both."""
        data = text.encode() + b"\0"
        self.number("I", len(data))
        self._data += data
        return self

    def finish(self) -> bytes:
        """The message."""
        return _HEADER + bytes(self._data)

    def _align(self, size: int) -> None:
        self._data += bytes(-len(self._data) % size)
