"""EvoLogics S2C modems with USBL: notifications as lines, bare or as ``+++AT:length:line``.

``USBLLONG,now,measured,address,x,y,z,e,n,u,roll,pitch,yaw,us,rssi,integrity,accuracy``
    A fix; x to the right, y forward, z up (m) in the modem's axes. Times in s of the modem's
    clock, us the sound's one way, accuracy in rad.
``USBLANGLES,now,measured,address,bearing,elevation,b,e,roll,pitch,yaw,rssi,integrity,accuracy``
    Angles alone (rad), sent where there is no range; the first two in the modem's axes.
``USBLPHYD,now,measured,address,type,d1-5,d2-5,d3-5,d4-5,d1-2,d4-1,d3-2,d3-4``
    How much later sound reached one element than another (ns); 16777215 where not measured.
``RECV,length,from,to,bitrate,rssi,integrity,us,velocity,data``
``RECVIM,length,from,to,flag,us,rssi,integrity,velocity,data``
``RECVIMS,length,from,to,stamp,us,rssi,integrity,velocity,data``
``RECVPBM,length,from,to,us,rssi,integrity,velocity,data``
    A message; velocity (m/s) is relative to its sender, which sign means what is an option. Its
    data may hold any bytes, so these are as long as they say.

Nothing has a check but the length in front of a line.
"""

import re
from collections.abc import Callable
from math import degrees, radians, remainder
from typing import Literal

import msgspec
from msgspec import UNSET

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import number, numbers
from drivers.framing import SyncDecoder, UnreadableError
from drivers.records import OtherFrame, Record, Rejected, TimeDifference, UsblRecord
from drivers.sentences import Heard
from drivers.usbl.geometry import place, polar

LONGEST = 1200
AGE_MAX_S = 60.0
VELOCITY_MAX_M_S = 100.0
ROUNDING_M = 2e-4
"""How far the printed accuracy and the range of printed coordinates may lie apart."""
TURN, RIGHT_ANGLE = 6.2832, 1.5708
GOOD = 150
"""A link's integrity that is good: 100 and less is called weak."""
LEVEL = "0.0000,0.0000,0.0000"
NOT_MEASURED = 16_777_215
PAIRS = ("1-5", "2-5", "3-5", "4-5", "1-2", "4-1", "3-2", "3-4")
VELOCITY = {b"RECV": 8, b"RECVIM": 8, b"RECVIMS": 8, b"RECVPBM": 7}
"""Which field behind the name is the velocity; the data follow it."""

_FRAME = rb"\+\+\+AT(?:\*[!-9;-~]{1,32})?:"
_HEAD = re.compile(rb"(?:" + _FRAME + rb"(\d{1,4}):)?([A-Z]*)")
_IS_MESSAGE = re.compile(rb"(?:" + _FRAME + rb"\d{1,4}:)?(RECV(?:IMS|IM|PBM)?),")
_MESSAGE = {
    name: re.compile(_IS_MESSAGE.pattern + rb"(\d{1,4})" + rb",[^,\r\n]{0,24}" * (at - 1) + rb",")
    for name, at in VELOCITY.items()
}
_OTHER = re.compile(
    rb"(?:SEND(?:START|END)|RECV(?:START|END|FAILED|SRV)|(?:DELIVERED|FAILED|CANCELED|EXPIRED)"
    rb"(?:IM|IMS|PBM)?|PHYON|PHYOFF|BITRATE|SRCLEVEL|RADDR|STATUS|USBLPHYP)(?:,[a-z0-9.\-]*)*"
)
_STARTS = (
    *(b"+++AT", b"USBL", b"RECV", b"SENDSTART", b"SENDEND", b"DELIVERED", b"FAILED", b"CANCELED"),
    *(b"EXPIRED", b"PHYO", b"BITRATE", b"SRCLEVEL", b"RADDR", b"STATUS"),
)


class Told(Heard):
    """What the first three fields tell."""

    beacon: str
    t_device_s: float
    age_s: float


class EvologicsOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is a good fix, what a velocity means, and how lines are written.

    Without ``velocity_positive`` messages come out as they are. Lines are read with and without
    ``+++AT:length:``; ``framed`` ones are written with it.
    """

    velocity_positive: Literal["closing", "opening"] | None = None
    accuracy_max_rad: float = 0.5
    integrity_min: int = 0
    framed: bool = False


def decoder(options: EvologicsOptions) -> Decoder:
    """Make a decoder of what a modem sends."""

    def decode(frame: bytes, t_rx_ns: int, line_bytes: int) -> list[Record | Rejected] | None:
        head = _HEAD.match(frame)
        assert head is not None  # every part of it may be missing
        said, name = head.groups()
        body = frame[head.start(2) :].removesuffix(b"\n").removesuffix(b"\r")
        if said is not None and int(said) != len(body):
            return None
        heard: Heard = {"t_rx_ns": t_rx_ns, "line_bytes": line_bytes}
        try:
            return [_read(name, body, said is not None, options, heard) or _as_it_is(frame, heard)]
        except UnreadableError as error:
            # The length held: it is a whole line, only not one to be made sense of.
            return None if said is None else [Rejected(**heard, reason=error.reason, data=frame)]

    return SyncDecoder(_STARTS, _measure, decode)


def encode(record: Record, options: EvologicsOptions) -> bytes:
    """Write differences as USBLPHYD, a fix as USBLLONG or USBLANGLES, a rate alone as RECVIM.

    Raises
    ------
    ValueError
        If no line can say the record.
    """
    if not isinstance(record, UsblRecord) or record.axes != "array":
        raise ValueError(f"evologics cannot say this {type(record).__name__}")
    line = _line(record, options)
    return f"+++AT:{len(line)}:{line}\r\n".encode() if options.framed else f"{line}\r\n".encode()


def _measure(data: bytes, at: int) -> int | None:
    """A message is as long as it says, anything else a line."""
    message = _IS_MESSAGE.match(data, at)
    header = _MESSAGE[message[1]].match(data, at) if message else None
    if header:
        length = header.end() - at + int(header[2]) + 2
        whole = data[at + length - 2 : at + length] in (b"", b"\r", b"\r\n")
        return length if whole and length <= LONGEST else 0
    end = data.find(b"\n", at, at + LONGEST)
    if end < 0:
        return None if len(data) - at < LONGEST else 0
    return 0 if message else end + 1 - at


def _read(
    name: bytes, body: bytes, framed: bool, options: EvologicsOptions, heard: Heard
) -> Record | None:
    """Give the record of a line; None for one of no use, `UnreadableError` for what is none."""
    if name in VELOCITY and body.startswith(name + b","):
        return _message(body.split(b",", VELOCITY[name] + 1), name, options, heard)
    text = body.decode("latin-1")
    if not (text.isascii() and text.isprintable()):
        raise UnreadableError("syntax", "not a line of printable characters")
    read = _READERS.get(name)
    if read is None:
        if framed or _OTHER.fullmatch(body):
            return None
        raise UnreadableError("unknown", "no line of a modem")
    count, reader = read
    fields = tuple(text.split(",")[1:])
    if len(fields) != count or not fields[2].isdigit():
        raise UnreadableError("syntax", f"not {count} fields with an address")
    now_s, measured_s, _, *values = numbers(fields)
    if not 0 <= now_s - measured_s <= AGE_MAX_S:
        raise UnreadableError("range", f"measured {now_s - measured_s} s before it was said")
    told: Told = {
        **heard,
        "beacon": str(int(fields[2])),
        "t_device_s": measured_s,
        # In whole microseconds, as it was told: the difference of large numbers has noise.
        "age_s": round(now_s - measured_s, 6),
    }
    return reader(values, options, told)


def _long(values: list[float], options: EvologicsOptions, told: Told) -> UsblRecord:
    x, y, z = values[:3]
    xyz_m = (y, x, -z)
    bearing_deg, elevation_deg, slant_m = polar(xyz_m)
    way_us, _, integrity, accuracy = values[9:]
    # The modem gives the range as the accuracy where it found no direction.
    lost = accuracy > options.accuracy_max_rad or abs(accuracy - slant_m) < ROUNDING_M
    fault = _fault(lost, integrity, options) or (None if slant_m > 0 else "no_range")
    return UsblRecord(
        **told,
        bearing_deg=bearing_deg,
        elevation_deg=elevation_deg,
        slant_range_m=slant_m,
        xyz_m=xyz_m,
        one_way_s=way_us / 1e6,
        valid=fault is None,
        error_code=fault,
    )


def _angles(values: list[float], options: EvologicsOptions, told: Told) -> UsblRecord:
    bearing, elevation, *_, integrity, accuracy = values
    if not (abs(bearing) <= TURN and abs(elevation) <= RIGHT_ANGLE):
        raise UnreadableError("range", "no angles in radians")
    fault = _fault(accuracy > options.accuracy_max_rad, integrity, options)
    return UsblRecord(
        **told,
        bearing_deg=remainder(degrees(bearing), 360) + 0.0,
        elevation_deg=degrees(elevation) + 0.0,
        valid=fault is None,
        error_code=fault,
    )


def _differences(values: list[float], _options: EvologicsOptions, told: Told) -> UsblRecord:
    """Not valid where no element was compared with another."""
    differences = tuple(
        TimeDifference(element=pair[0], than=pair[2], delay_s=delay_ns / 1e9)
        for pair, delay_ns in zip(PAIRS, values[1:], strict=True)
        if delay_ns != NOT_MEASURED
    )
    fault = None if differences else "no_differences"
    return UsblRecord(**told, differences=differences, valid=fault is None, error_code=fault)


def _message(
    fields: list[bytes], name: bytes, options: EvologicsOptions, heard: Heard
) -> UsblRecord | None:
    sender, velocity = fields[2].decode("latin-1"), fields[VELOCITY[name]].decode("latin-1")
    if not sender.isdecimal() or int(fields[1]) != len(fields[-1]):
        raise UnreadableError("syntax", "no message of a modem")
    rate_m_s = number(velocity, -VELOCITY_MAX_M_S, VELOCITY_MAX_M_S)
    if options.velocity_positive is None:
        return None
    sign = -1.0 if options.velocity_positive == "closing" else 1.0
    return UsblRecord(**heard, beacon=str(int(sender)), range_rate_m_s=sign * rate_m_s + 0.0)


def _fault(lost: bool, integrity: float, options: EvologicsOptions) -> str | None:
    if lost:
        return "accuracy"
    return "integrity" if integrity < options.integrity_min else None


def _as_it_is(frame: bytes, heard: Heard) -> OtherFrame:
    name = frame.rstrip(b"\r\n").rpartition(b":")[2].partition(b",")[0]
    return OtherFrame(**heard, name=name.decode("latin-1"), data=frame)


def _line(record: UsblRecord, options: EvologicsOptions) -> str:
    measured_s = record.t_device_s or 0.0
    now_s = measured_s + (0.0 if record.age_s is UNSET else record.age_s)
    times = f"{now_s:.6f},{measured_s:.6f},{int(record.beacon)}"
    quality = f"-40,{GOOD if record.error_code != 'integrity' else 0}"
    if record.differences is not UNSET:
        said = {f"{d.element}-{d.than}": round(d.delay_s * 1e9) for d in record.differences}
        if not said.keys() <= set(PAIRS):
            raise ValueError(f"evologics compares the elements {', '.join(PAIRS)}")
        delays = ",".join(str(said.get(pair, NOT_MEASURED)) for pair in PAIRS)
        return f"USBLPHYD,{times},0,{delays}"
    accuracy = f"{options.accuracy_max_rad + 1 if record.error_code == 'accuracy' else 0.0:.4f}"
    xyz_m = place(record)
    if xyz_m is not None:
        y, x, down = xyz_m
        xyz = f"{x:.4f},{y:.4f},{-down:.4f}"
        way_us = 0 if record.one_way_s is UNSET else round(record.one_way_s * 1e6)
        return f"USBLLONG,{times},{xyz},{xyz},{LEVEL},{way_us},{quality},{accuracy}"
    if record.bearing_deg is not None and record.elevation_deg is not None:
        angles = f"{radians(record.bearing_deg):.4f},{radians(record.elevation_deg):.4f}"
        return f"USBLANGLES,{times},{angles},{angles},{LEVEL},{quality},{accuracy}"
    if record.range_rate_m_s is not None and options.velocity_positive is not None:
        velocity = record.range_rate_m_s * (-1 if options.velocity_positive == "closing" else 1)
        return f"RECVIM,0,{int(record.beacon)},1,noack,0,{quality},{velocity:.4f},"
    raise ValueError("evologics needs a place, angles, differences, or a rate and what it means")


Reader = Callable[[list[float], EvologicsOptions, Told], UsblRecord]

_READERS: dict[bytes, tuple[int, Reader]] = {
    b"USBLLONG": (16, _long),
    b"USBLANGLES": (13, _angles),
    b"USBLPHYD": (12, _differences),
}

EVOLOGICS = Codec(
    name="evologics",
    kind="usbl",
    devices="EvoLogics S2C R USBL modems: USBLLONG, USBLANGLES, USBLPHYD and RECV messages",
    options=EvologicsOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_step_s=1e-6),
)
