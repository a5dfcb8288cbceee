"""NMEA 0183 sentences: a checked reader, a writer, and latitudes and longitudes both ways.

``$`` address ``,`` field ``,`` ... ``*hh`` CR LF: printable ASCII, hh the exclusive or of what
stands between ``$`` and ``*``. An address is two letters of talker and three of formatter; a
proprietary one is ``P`` and the maker's letters.
"""

import re
from typing import Literal

import msgspec

from drivers.checksums import xor8
from drivers.codec import Codec, Decoder
from drivers.framing import LineDecoder, UnreadableError
from drivers.records import NmeaSentence, Record

LENGTH_MAX = 82
"""Characters of a sentence with ``$`` and CR LF; longer ones are read, as many are sent."""

Checksum = Literal["required", "optional", "forbidden"]

_SENTENCE = re.compile(r"\$([A-Z0-9]{3,})((?:,[^$*!]*)?)(?:\*([0-9A-Fa-f]{2})?)?")
_RESERVED = re.compile(r"[$*!\\^~\r\n]")
_DEGREES = re.compile(r"(\d{1,3})(\d{2}(?:\.\d+)?)")


class NmeaOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether sentences carry a checksum; where it is optional, one that is there must hold."""

    checksum: Checksum = "required"


def parse(line: str, checksum: Checksum = "required") -> tuple[str, str, tuple[str, ...]]:
    """Read one sentence without its CR LF.

    Returns
    -------
    talker, formatter, fields
        ``("GP", "GGA", (...))``; a proprietary ``$PUNAV,...`` gives ``("P", "UNAV", (...))``.

    Raises
    ------
    UnreadableError
        With reason "syntax" or "checksum".
    """
    match = _SENTENCE.fullmatch(line)
    if match is None:
        raise UnreadableError("syntax", "not a sentence of NMEA 0183")
    address, fields, said = match.groups()
    if said is None and checksum == "required":
        raise UnreadableError("syntax", "no checksum")
    if said is not None and checksum == "forbidden":
        raise UnreadableError("syntax", "a checksum where there must be none")
    if said is not None and int(said, 16) != xor8(line[1 : line.index("*")].encode()):
        raise UnreadableError("checksum", "the checksum does not hold")
    if not address.startswith("P") and len(address) != 5:
        raise UnreadableError("syntax", f"address {address} is neither standard nor proprietary")
    split = 1 if address.startswith("P") else 2
    return address[:split], address[split:], tuple(fields.split(",")[1:])


def sentence(address: str, fields: tuple[str, ...] | list[str], longest: int = LENGTH_MAX) -> bytes:
    """Write one sentence with checksum and CR LF.

    Raises
    ------
    ValueError
        If it would be longer than `longest` characters, or a field holds a reserved character.
    """
    body = ",".join((address, *fields))
    if not body.isascii() or body.count(",") != len(fields) or _RESERVED.search(body):
        raise ValueError(f"a field of ${body} holds a reserved character")
    line = f"${body}*{xor8(body.encode()):02X}\r\n".encode()
    if len(line) > longest:
        raise ValueError(f"${body} is longer than {longest} characters")
    return line


def degrees(text: str, hemisphere: str) -> float:
    """Read a latitude or longitude: ``("3322.50", "S")`` -> -33.375.

    Raises
    ------
    UnreadableError
        With reason "syntax", or "range" beyond 90 or 180 degrees or 60 minutes.
    """
    match = _DEGREES.fullmatch(text)
    if match is None or hemisphere not in ("N", "S", "E", "W"):
        raise UnreadableError("syntax", f'"{text},{hemisphere}" is no latitude or longitude')
    whole, minutes = int(match[1]), float(match[2])
    value = whole + minutes / 60
    if minutes >= 60 or value > (90 if hemisphere in "NS" else 180):
        raise UnreadableError("range", f'"{text},{hemisphere}" is not on the Earth')
    return -value if hemisphere in "SW" else value


def latitude(lat_deg: float, decimals: int = 4) -> tuple[str, str]:
    """Write a latitude: -33.375 -> ``("3322.5000", "S")``; `decimals` of a minute."""
    return _ddmm(lat_deg, 2, decimals), "S" if lat_deg < 0 else "N"


def longitude(lon_deg: float, decimals: int = 4) -> tuple[str, str]:
    """Write a longitude, wrapped into -180 to 180: 200.5 -> ``("15930.0000", "W")``."""
    wrapped = lon_deg - 360 if lon_deg > 180 else lon_deg
    return _ddmm(wrapped, 3, decimals), "W" if wrapped < 0 else "E"


def last_start(line: bytes) -> tuple[int, ...]:
    """Where a sentence begins among junk: at the last ``$``, for none stands inside one."""
    return (max(line.rfind(b"$"), 0),)


def decoder(options: NmeaOptions) -> Decoder:
    """Make a decoder of a stream of sentences."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        talker, formatter, fields = parse(line, options.checksum)
        return NmeaSentence(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            talker=talker,
            formatter=formatter,
            fields=fields,
        )

    return LineDecoder(decode, last_start)


def encode(record: Record, options: NmeaOptions) -> bytes:
    """Write an `NmeaSentence`, with its checksum unless the options forbid one."""
    if not isinstance(record, NmeaSentence):
        raise ValueError(f"nmea0183 cannot say a {type(record).__name__}")
    line = sentence(record.talker + record.formatter, record.fields)
    return line[:-5] + b"\r\n" if options.checksum == "forbidden" else line


def _ddmm(value_deg: float, width: int, decimals: int) -> str:
    # In whole units of the last decimal, so that 59.99996 minutes carry into the degrees.
    unit = 10**decimals
    whole, minutes = divmod(round(abs(value_deg) * 60 * unit), 60 * unit)
    digits = f"{minutes:0{decimals + 2}d}"
    fraction = f".{digits[2:]}" if decimals else ""
    return f"{whole:0{width}d}{digits[:2]}{fraction}"


NMEA0183 = Codec(
    name="nmea0183",
    kind="any",
    devices="anything that speaks NMEA 0183",
    options=NmeaOptions,
    decoder=decoder,
    encode=encode,
)
