"""TrackLink TP2: bearing, slant range and XYZ, compatible with the ORE TrackPoint II.

66 characters and CR LF, blank padded; the sentence's X is to starboard and its Y forward.

====== =======================================
column field
====== =======================================
1      target number
3-10   time hh:mm:ss of the program's clock
12-14  reserved (vessel heading at ORE)
16-20  bearing, deg, 0.0 to 359.9 clockwise
22-28  slant range, m
30-37  X, m
39-46  Y, m
48-54  Z, m, positive down
56-63  reserved (telemetry at ORE)
65-66  blank (error code at ORE)
====== =======================================

A line in its columns is read by them, because a reserved field left blank would make another field
out of an error code. Members of the family let values overflow: what the columns make no sense of
is split at its blanks into 9 fields, or 10 with an error code.
"""

from functools import partial

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import number, seconds_of_day
from drivers.framing import LineDecoder, UnreadableError
from drivers.records import Reason, Record, UsblRecord
from drivers.usbl.tracklink.fields import (
    PositionOptions,
    agree,
    elevation,
    fitted,
    fixed_starts,
    hms,
    no_range,
    signed,
    step,
    target,
    unsigned,
)

WIDTH = 66
_SPANS = ((0, 1), (2, 10), (11, 14), (15, 20), (21, 28), (29, 37), (38, 46), (47, 54), (55, 63))
_CODE = (64, 66)


def decoder(options: PositionOptions) -> Decoder:
    """Make a decoder of TP2 lines."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        # MicronNav prints blanks as asterisks.
        line = line.replace("*", " ")
        doubtful: UsblRecord | None = None
        reasons: list[Reason] = []
        for split in (_columns, _tokens):
            try:
                record = _fix(split(line), options, t_rx_ns, line_bytes)
            except UnreadableError as error:
                reasons.append(error.reason)
                continue
            if record.error_code != "inconsistent":
                return record
            doubtful = doubtful or record
        if doubtful is not None:
            return doubtful
        raise UnreadableError("range" if "range" in reasons else "syntax", "no TP2 line")

    return LineDecoder(decode, partial(fixed_starts, WIDTH), shortest=WIDTH)


def encode(record: Record, options: PositionOptions) -> bytes:
    """Write one line.

    Raises
    ------
    ValueError
        If the record lacks a field, or one does not fit.
    """
    if not isinstance(record, UsblRecord):
        raise ValueError(f"tracklink-tp2 cannot say a {type(record).__name__}")
    if record.slant_range_m is None or record.xyz_m is None:
        raise ValueError("tracklink-tp2 needs a slant range and XYZ")
    x, y, z = options.swap(record.xyz_m)
    hours, minutes, seconds = hms(record.t_device_s)
    line = " ".join(
        (
            fitted(int(target(record.beacon)), 1, 0, "target"),
            f"{hours:02d}:{minutes:02d}:{seconds:02d}",
            "0  ",
            fitted(unsigned(record.bearing_deg), 5, 1, "bearing"),
            fitted(record.slant_range_m, 7, 1, "slant range"),
            fitted(x, 8, 1, "X"),
            fitted(y, 8, 1, "Y"),
            fitted(z, 7, 1, "Z"),
            fitted(0.0, 8, 1, "telemetry"),
            f"{_device_code(record.error_code):2}",
        )
    )
    return f"{line}\r\n".encode()


def _tokens(line: str) -> list[str]:
    tokens = line.split()
    if len(tokens) == 9:
        tokens.append("")
    if len(tokens) != 10:
        raise UnreadableError("syntax", "a TP2 line has 9 fields, or 10 with an error code")
    return tokens


def _columns(line: str) -> list[str]:
    spans = (*_SPANS, _CODE)
    gaps = [line[span[0] - 1 : span[0]] for span in spans[1:]]
    if len(line) < _SPANS[7][1] or any(gap.strip() for gap in gaps):
        raise UnreadableError("syntax", "the columns of TP2 do not fit")
    return [line[start:end].strip() for start, end in spans]


def _fix(fields: list[str], options: PositionOptions, t_rx_ns: int, line_bytes: int) -> UsblRecord:
    name, clock, heading, bearing, slant, x, y, z, telemetry, code = fields
    for reserved in (heading, telemetry, code):
        number(reserved or "0")
    bearing_deg = signed(number(bearing, 0.0, 360.0))
    slant_m = number(slant, 0.0)
    xyz_m = options.swap((number(x), number(y), number(z)))
    fault = code if code.strip("0") else no_range(slant_m)
    if fault is None and not agree(bearing_deg, slant_m, xyz_m, step(x, y, z), options):
        fault = "inconsistent"
    return UsblRecord(
        t_rx_ns=t_rx_ns,
        line_bytes=line_bytes,
        beacon=target(name),
        bearing_deg=bearing_deg,
        elevation_deg=elevation(xyz_m),
        slant_range_m=slant_m,
        xyz_m=xyz_m,
        t_device_s=seconds_of_day(clock),
        valid=fault is None,
        error_code=fault,
        axes="north" if options.bearing_reference == "north" else "array",
    )


def _device_code(fault: str | None) -> str:
    """The error code that goes on the wire: faults this decoder found itself do not."""
    return fault if fault and len(fault) <= 2 else ""


TP2 = Codec(
    name="tracklink-tp2",
    kind="usbl",
    devices="LinkQuest TrackLink, TP2-compatible output; ORE TrackPoint STANDARD-EC",
    options=PositionOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=1.0),
)
