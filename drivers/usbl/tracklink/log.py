"""TrackLink tracking log hp326.txt: one fix a line, 31 fields between blanks, for replay.

======= ==================================================
field   what
======= ==================================================
1, 2    target number, error code (0: good)
3-8     year, month, day, hour, minute, second (UTC assumed)
9, 10   horizontal range m, bearing deg
11-13   X m, Y m, depth m (as TP2: X to starboard, Y forward)
14      option
15, 16  latitude, longitude of the ship, signed ddmm.mmmm
17      option
18      heading of the ship, deg
19      option
20, 21  latitude, longitude of the target, signed ddmm.mmmm
22      slant range, cm
23, 24  reserved, option
25, 26  pitch, roll
27-31   reserved
======= ==================================================
"""

from datetime import UTC, datetime
from functools import lru_cache

from msgspec import UNSET, UnsetType

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import number
from drivers.framing import LineDecoder, UnreadableError
from drivers.nmea0183 import degrees, latitude, longitude
from drivers.records import Record, UsblRecord
from drivers.usbl.tracklink.fields import (
    PositionOptions,
    agree,
    elevation,
    no_range,
    signed,
    step,
    target,
    unsigned,
)

FIELDS = 31


def decoder(options: PositionOptions) -> Decoder:
    """Make a decoder of the log's lines."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        fields = line.split()
        if len(fields) != FIELDS:
            raise UnreadableError("syntax", f"{len(fields)} fields instead of {FIELDS}")
        code, (x, y, depth) = fields[1], fields[10:13]
        bearing_deg = signed(number(fields[9], 0.0, 360.0))
        slant_m = number(fields[21], 0.0) / 100
        xyz_m = options.swap((number(x), number(y), number(depth)))
        fault = code if number(code) else no_range(slant_m)
        if fault is None and not agree(bearing_deg, slant_m, xyz_m, step(x, y, depth), options):
            fault = "inconsistent"
        return UsblRecord(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            beacon=target(fields[0]),
            bearing_deg=bearing_deg,
            elevation_deg=elevation(xyz_m),
            slant_range_m=slant_m,
            xyz_m=xyz_m,
            t_device_s=_minute_unix_s(*fields[2:7]) + number(fields[7], 0.0, 60.999),
            valid=fault is None,
            error_code=fault,
            axes="north" if options.bearing_reference == "north" else "array",
            lat_deg=_degrees(fields[19], "NS"),
            lon_deg=_degrees(fields[20], "EW"),
            depth_m=number(depth),
        )

    return LineDecoder(decode, _starts)


def encode(record: Record, options: PositionOptions) -> bytes:
    """Write one line; what a record does not carry is 0."""
    if not isinstance(record, UsblRecord):
        raise ValueError(f"tracklink-log cannot say a {type(record).__name__}")
    if record.slant_range_m is None or record.xyz_m is None:
        raise ValueError("tracklink-log needs a slant range and XYZ")
    x, y, z = options.swap(record.xyz_m)
    moment = datetime.fromtimestamp(round(record.t_device_s or 0.0), UTC)
    code = record.error_code if record.error_code and record.error_code.isdigit() else "0"
    fields = (
        f"{target(record.beacon)} {code}",
        moment.strftime("%Y %m %d %H %M %S"),
        f"{(x * x + y * y) ** 0.5:.1f} {unsigned(record.bearing_deg):.1f}",
        f"{x:.2f} {y:.2f} {z:.2f} 0",
        "0.0000 0.0000 0 0.0 0",
        f"{_ddmm(*latitude(_or_zero(record.lat_deg)))}",
        f"{_ddmm(*longitude(_or_zero(record.lon_deg)))}",
        f"{record.slant_range_m * 100:.0f} 0 0 0.0 0.0 0 0 0 0 0",
    )
    return f"{' '.join(fields)}\r\n".encode()


def _starts(line: bytes) -> tuple[int, ...]:
    """At the front, or behind a CR whose LF was lost or damaged."""
    at = line.rfind(b"\r")
    return (0, at + 1, at + 2) if at >= 0 else (0,)


@lru_cache(maxsize=64)  # of a line each second, sixty say the same
def _minute_unix_s(*fields: str) -> float:
    year, month, day, hour, minute = (int(number(field, 0.0, 9999.0)) for field in fields)
    try:
        whole = datetime(year, month, day, hour, minute, tzinfo=UTC)
    except ValueError as error:
        raise UnreadableError("range", str(error)) from error
    return whole.timestamp()


def _degrees(text: str, hemispheres: str) -> float:
    """Read a signed ddmm.mmmm, whose leading zeros are left out."""
    number(text)
    whole, point, fraction = text.lstrip("+-").partition(".")
    return degrees(f"{int(whole):03d}{point}{fraction}", hemispheres[text.startswith("-")])


def _ddmm(text: str, hemisphere: str) -> str:
    return f"-{text}" if hemisphere in "SW" else text


def _or_zero(value: float | UnsetType) -> float:
    return 0.0 if value is UNSET else value


LOG = Codec(
    name="tracklink-log",
    kind="usbl",
    devices="LinkQuest TrackLink, tracking log hp326.txt",
    options=PositionOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=1.0),
)
