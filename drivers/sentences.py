"""A codec of NMEA 0183 as a table: which reader for which sentence, the rest as it is."""

from collections.abc import Callable, Mapping
from typing import Any, TypedDict

from drivers.codec import Decoder
from drivers.framing import LineDecoder, UnreadableError
from drivers.nmea0183 import LENGTH_MAX, Checksum, last_start, parse, sentence
from drivers.records import NmeaSentence, Record

Fields = tuple[str, ...]


class Heard(TypedDict):
    """When the first byte of a sentence was seen, as every record begins with it."""

    t_rx_ns: int
    line_bytes: int


Reader = Callable[[Fields, Any, Heard], Record]
"""``(fields, options, heard)`` -> the record; raises `UnreadableError`."""


def table_decoder(readers: Mapping[str, Reader], options: Any, checksum: Checksum) -> Decoder:
    """Make a decoder of the sentences in a table.

    Parameters
    ----------
    readers
        By formatter whatever the talker (``GGA``), or by a maker's whole address (``PRDID``).
        Sentences that are not named come out as an `NmeaSentence`.
    options
        Handed to every reader.
    """

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        talker, formatter, fields = parse(line, checksum)
        read = readers.get("P" + formatter if talker == "P" else formatter)
        if read is None:
            return NmeaSentence(
                t_rx_ns=t_rx_ns,
                line_bytes=line_bytes,
                talker=talker,
                formatter=formatter,
                fields=fields,
            )
        return read(fields, options, {"t_rx_ns": t_rx_ns, "line_bytes": line_bytes})

    return LineDecoder(decode, last_start)


def written(
    address: str, fields: Fields | list[str], checksum: Checksum, longest: int = LENGTH_MAX
) -> bytes:
    """Write a sentence, with its checksum unless that is forbidden."""
    line = sentence(address, fields, longest)
    return line[: line.index(b"*")] + b"\r\n" if checksum == "forbidden" else line


def expect(fields: Fields, *counts: int) -> None:
    """Raise `UnreadableError` unless there are as many fields as one of `counts`."""
    if len(fields) not in counts:
        raise UnreadableError("syntax", f"{len(fields)} fields, not {counts[0]}")


def expect_units(fields: Fields, units: Mapping[int, str]) -> None:
    """Raise `UnreadableError` unless the letters stand where the sentence has them."""
    for place, unit in units.items():
        if fields[place] != unit:
            raise UnreadableError("syntax", f'"{fields[place]}" where {unit} must stand')
