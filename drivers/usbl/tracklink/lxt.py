"""TrackLink LXT: slant range, bearing and depression angle, the output tight coupling wants.

41 characters and CR LF, blank padded; real lines leave the last four fields blank.

====== =======================================
column field
====== =======================================
1      target number
3-8    slant range, m, 9999.9 is full scale
10-14  bearing, deg, 0.0 to 359.9 clockwise
16-19  depression, deg, 0.0 to 89.9 down
21-25  reserved
27-32  reserved
34-38  reserved
40-41  reserved
====== =======================================
"""

from functools import partial

import msgspec

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import number
from drivers.framing import LineDecoder, UnreadableError
from drivers.records import Record, UsblRecord
from drivers.usbl.tracklink.fields import (
    Reference,
    fitted,
    fixed_starts,
    no_range,
    signed,
    target,
    unsigned,
)

WIDTH = 41
SLANT_MAX = 9999.9
DEPRESSION_MAX = 89.9


class LxtOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the topside program refers bearings to: north when it was given a compass."""

    bearing_reference: Reference = "bow"


def decoder(options: LxtOptions) -> Decoder:
    """Make a decoder of LXT lines."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        tokens = line.split()
        if len(tokens) not in (4, 8) or len(line.rstrip()) > WIDTH:
            raise UnreadableError("syntax", "an LXT line has 4 fields, or 8 with the reserved ones")
        slant_m = number(tokens[1], 0.0, SLANT_MAX)
        fault = "full_scale" if slant_m == SLANT_MAX else no_range(slant_m)
        return UsblRecord(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            beacon=target(tokens[0]),
            bearing_deg=signed(number(tokens[2], 0.0, 359.9)),
            elevation_deg=0.0 - number(tokens[3], 0.0, DEPRESSION_MAX),
            slant_range_m=slant_m,
            valid=fault is None,
            error_code=fault,
            axes="north" if options.bearing_reference == "north" else "array",
        )

    return LineDecoder(decode, partial(fixed_starts, WIDTH), shortest=WIDTH)


def encode(record: Record, options: LxtOptions) -> bytes:
    """Write one line; a depression that rounds to 90 degrees is held at the field's 89.9.

    Raises
    ------
    ValueError
        If the record lacks a field, or one does not fit.
    """
    if not isinstance(record, UsblRecord):
        raise ValueError(f"tracklink-lxt cannot say a {type(record).__name__}")
    if record.slant_range_m is None or record.elevation_deg is None:
        raise ValueError("tracklink-lxt needs a slant range and an elevation")
    depression = min(round(-record.elevation_deg, 1) + 0.0, DEPRESSION_MAX)
    if depression < 0:
        raise ValueError(f"tracklink-lxt cannot say a beacon above ({record.elevation_deg} deg)")
    line = " ".join(
        (
            fitted(int(target(record.beacon)), 1, 0, "target"),
            fitted(record.slant_range_m, 6, 1, "slant range"),
            fitted(unsigned(record.bearing_deg), 5, 1, "bearing"),
            fitted(depression, 4, 1, "depression"),
        )
    )
    return f"{line:{WIDTH}}\r\n".encode()


LXT = Codec(
    name="tracklink-lxt",
    kind="usbl",
    devices="LinkQuest TrackLink, LXT-compatible output",
    options=LxtOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=None),
)
