"""WHOI Micro-Modem: travel times of a long baseline, of a two-way ping, and Doppler.

``$SNTTA,ta,tb,tc,td,hhmmss.ss*hh``
    One-way travel times (s) to transponders A to D, empty where none answered, and when the
    interrogation left by the modem's clock. Sent once all have answered or a time-out has passed.
``$CAMPR,source,destination,time*hh``
    One-way travel time (s) to another modem, `source`, that replied to a ping.
``$CADOP,speed*hh``
    Relative speed (m/s) by the Doppler of the last packet; neither whose nor which sign it says.

Every other sentence comes out as it is.
"""

from typing import Literal

import msgspec

from drivers.codec import Codec, Decoder
from drivers.fields import clock, maybe, number, seconds_of_day
from drivers.framing import UnreadableError
from drivers.nmea0183 import Checksum
from drivers.records import LblRecord, LblReply, NmeaSentence, Record
from drivers.sentences import Fields, Heard, Reader, expect, table_decoder, written

TRAVEL_MAX_S = 60.0


class MicromodemOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whose the times and the speeds are.

    ``transponders`` names those of SNTTA in its order. Without ``doppler_beacon`` nothing is known
    of whose speed CADOP tells, and it comes out as it is; ``doppler_positive`` is what a positive
    one means.
    """

    checksum: Checksum = "required"
    transponders: tuple[str, str, str, str] = ("A", "B", "C", "D")
    doppler_beacon: str | None = None
    doppler_positive: Literal["closing", "opening"] = "closing"


def decoder(options: MicromodemOptions) -> Decoder:
    """Make a decoder of a modem's sentences."""
    return table_decoder(_READERS, options, options.checksum)


def encode(record: Record, options: MicromodemOptions) -> bytes:
    """Write an `LblRecord`: with the time of its ping SNTTA, else one reply as CAMPR or CADOP."""
    match record:
        case LblRecord(t_ping_s=float()):
            return written("SNTTA", _tta_fields(record, options), options.checksum)
        case LblRecord(replies=(LblReply(one_way_s=float(one_way_s), beacon=beacon),)):
            return written("CAMPR", (beacon, "0", f"{one_way_s:.6f}"), options.checksum)
        case LblRecord(replies=(LblReply(range_rate_m_s=float(rate_m_s)),)):
            return written("CADOP", (f"{_sign(options) * rate_m_s:.3f}",), options.checksum)
    raise ValueError(f"micromodem cannot say this {type(record).__name__}")


def _tta(fields: Fields, options: MicromodemOptions, heard: Heard) -> LblRecord:
    expect(fields, 5)
    *times, ping = fields
    replies = tuple(
        LblReply(beacon=beacon, one_way_s=number(text, 0, TRAVEL_MAX_S))
        for beacon, text in zip(options.transponders, times, strict=True)
        if text
    )
    return LblRecord(**heard, replies=replies, t_ping_s=seconds_of_day(ping))


def _mpr(fields: Fields, _options: MicromodemOptions, heard: Heard) -> LblRecord:
    expect(fields, 3)
    source, destination, time = fields
    if not (source.isdigit() and destination.isdigit()):
        raise UnreadableError("syntax", f'"{source}" and "{destination}" are no modems')
    one_way_s = maybe(time, 0, TRAVEL_MAX_S)
    replied = () if one_way_s is None else (LblReply(beacon=source, one_way_s=one_way_s),)
    return LblRecord(**heard, replies=replied)


def _dop(fields: Fields, options: MicromodemOptions, heard: Heard) -> Record:
    expect(fields, 1)
    speed_m_s = number(fields[0], -100, 100)
    if options.doppler_beacon is None:
        return NmeaSentence(**heard, talker="CA", formatter="DOP", fields=fields)
    reply = LblReply(beacon=options.doppler_beacon, range_rate_m_s=_sign(options) * speed_m_s)
    return LblRecord(**heard, replies=(reply,))


def _sign(options: MicromodemOptions) -> float:
    """Of the rate of the distance, which grows when positive."""
    return -1.0 if options.doppler_positive == "closing" else 1.0


def _tta_fields(record: LblRecord, options: MicromodemOptions) -> list[str]:
    times = {reply.beacon: reply.one_way_s for reply in record.replies}
    if not times.keys() <= set(options.transponders):
        raise ValueError("a reply of SNTTA must be one of the transponders")
    known = (times.get(beacon) for beacon in options.transponders)
    texts = ("" if time_s is None else f"{time_s:.6f}" for time_s in known)
    return [*texts, clock(record.t_ping_s)]


_READERS: dict[str, Reader] = {"TTA": _tta, "MPR": _mpr, "DOP": _dop}

MICROMODEM = Codec(
    name="micromodem",
    kind="lbl",
    devices="WHOI Micro-Modem: SNTTA, CAMPR and CADOP",
    options=MicromodemOptions,
    decoder=decoder,
    encode=encode,
)
