"""Headings by NMEA 0183, with attitude where the sentence has it.

``$--HDT,heading,T*hh``
    True heading.
``$--THS,heading,mode*hh``
    True heading; A is measured, E estimated, M manual, S simulated, V none.
``$--HDG,heading,deviation,E,variation,E*hh``
    Heading of a magnetic sensor; deviation and variation turn it, easterly ones to the right.
``$--HDM,heading,M*hh``
    Magnetic heading.
``$PRDID,pitch,roll,heading*hh``
    Teledyne RDI; which north is meant it does not say.
``$PASHR,hhmmss.sss,heading,T,roll,pitch,heave,sd roll,sd pitch,sd heading,q,i*hh``
    UTC and true heading with attitude; q 0 is none, i (how the IMU is) may be missing.

Roll is positive starboard down, pitch positive bow up, in all of them. Any talker; every other
sentence comes out as it is.
"""

from typing import Annotated

import msgspec
from msgspec import UNSET, Meta

from drivers.codec import Codec, Decoder
from drivers.fields import clock, maybe, number, plain, seconds_of_day
from drivers.framing import UnreadableError
from drivers.nmea0183 import Checksum
from drivers.records import HeadingRecord, NmeaSentence, Record
from drivers.sentences import Fields, Heard, Reader, expect, expect_units, table_decoder, written


class HeadingOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether sentences carry a checksum, and what they do not say of north.

    ``variation_deg`` (positive to the east) makes magnetic headings true where the sentence has no
    variation of its own; ``prdid_magnetic`` says that PRDID means magnetic north.
    """

    checksum: Checksum = "required"
    variation_deg: Annotated[float, Meta(ge=-180, le=180)] | None = None
    prdid_magnetic: bool = False


def decoder(options: HeadingOptions) -> Decoder:
    """Make a decoder of a compass's sentences."""
    return table_decoder(READERS, options, options.checksum)


def encode(record: Record, options: HeadingOptions) -> bytes:
    """Write a `HeadingRecord`: HDT, THS or HDM, with attitude PRDID, with more than that PASHR."""
    if not isinstance(record, HeadingRecord):
        raise ValueError(f"nmea-heading cannot say a {type(record).__name__}")
    return written(*_sentence(record, options), options.checksum)


def _hdt(fields: Fields, _options: HeadingOptions, heard: Heard) -> HeadingRecord:
    expect(fields, 2)
    expect_units(fields, {1: "T"})
    heading_deg = _turn(fields[0])
    return HeadingRecord(**heard, heading_deg=heading_deg, valid=heading_deg is not None)


def _ths(fields: Fields, _options: HeadingOptions, heard: Heard) -> HeadingRecord:
    expect(fields, 2)
    heading_deg = _turn(fields[0])
    if fields[1] not in ("A", "E", "M", "S", "V"):
        raise UnreadableError("syntax", f'"{fields[1]}" is no mode')
    valid = fields[1] == "A" and heading_deg is not None
    return HeadingRecord(**heard, heading_deg=heading_deg, valid=valid)


def _hdg(fields: Fields, options: HeadingOptions, heard: Heard) -> HeadingRecord:
    expect(fields, 5)
    heading, deviation, deviation_side, variation, variation_side = fields
    deviation_deg = _easterly(deviation, deviation_side) or 0.0
    return _magnetic(heading, deviation_deg, _easterly(variation, variation_side), options, heard)


def _hdm(fields: Fields, options: HeadingOptions, heard: Heard) -> HeadingRecord:
    expect(fields, 2)
    expect_units(fields, {1: "M"})
    return _magnetic(fields[0], 0.0, None, options, heard)


def _prdid(fields: Fields, options: HeadingOptions, heard: Heard) -> HeadingRecord:
    expect(fields, 3)
    pitch, roll, heading = fields
    if options.prdid_magnetic:
        record = _magnetic(heading, 0.0, None, options, heard)
        heading_deg, reference = record.heading_deg, record.reference
    else:
        heading_deg, reference = _turn(heading), "true"
    return HeadingRecord(
        **heard,
        heading_deg=heading_deg,
        reference=reference,
        roll_deg=number(roll, -180, 180),
        pitch_deg=number(pitch, -90, 90),
        valid=heading_deg is not None,
    )


def _pashr(fields: Fields, _options: HeadingOptions, heard: Heard) -> Record:
    """Ashtech's own sentences begin with a word (``$PASHR,POS``) and are none of attitude."""
    if fields and fields[0].isalpha():
        return NmeaSentence(**heard, talker="P", formatter="ASHR", fields=fields)
    expect(fields, 11, 10)
    expect_units(fields, {2: "T"})
    time, heading, _, roll, pitch, _, _, _, sd, quality = fields[:10]
    sd_deg = maybe(sd, 0)
    heading_deg = _turn(heading)
    return HeadingRecord(
        **heard,
        heading_deg=heading_deg,
        roll_deg=maybe(roll, -180, 180),
        pitch_deg=maybe(pitch, -90, 90),
        t_device_s=seconds_of_day(time) if time else None,
        valid=number(quality, 0, 9) > 0 and heading_deg is not None,
        sd_deg=sd_deg or UNSET,
    )


def _magnetic(
    heading: str,
    deviation_deg: float,
    variation_deg: float | None,
    options: HeadingOptions,
    heard: Heard,
) -> HeadingRecord:
    """A magnetic heading, or the true one where the variation is known."""
    variation_deg = options.variation_deg if variation_deg is None else variation_deg
    said_deg = _turn(heading)
    if said_deg is None:
        return HeadingRecord(**heard, reference="magnetic", valid=False)
    turned_deg = said_deg + deviation_deg + (variation_deg or 0.0)
    return HeadingRecord(
        **heard,
        heading_deg=round(turned_deg % 360, 6),
        reference="magnetic" if variation_deg is None else "true",
    )


def _turn(text: str) -> float | None:
    return maybe(text, 0, 360)


def _easterly(text: str, side: str) -> float | None:
    """An angle with its side, which both may be empty."""
    value = maybe(text, 0, 180)
    if value is None:
        return None
    if side not in ("E", "W"):
        raise UnreadableError("syntax", f'"{text},{side}" is neither easterly nor westerly')
    return value if side == "E" else -value


def _sentence(record: HeadingRecord, options: HeadingOptions) -> tuple[str, list[str]]:
    """Address and fields of the shortest sentence that says all of a record."""
    heading, true = plain(record.heading_deg, 3), record.reference == "true"
    attitude = record.roll_deg is not None or record.pitch_deg is not None
    known = record.valid and record.t_device_s is None and record.sd_deg is UNSET
    if attitude and known and true is not options.prdid_magnetic:
        return "PRDID", [plain(record.pitch_deg, 3), plain(record.roll_deg, 3), heading]
    if not true:
        if attitude:
            raise ValueError("a magnetic heading with attitude needs the option prdid_magnetic")
        return "HCHDM", [heading, "M"]
    if attitude or record.t_device_s is not None or record.sd_deg is not UNSET:
        return "PASHR", _pashr_fields(record)
    return ("HEHDT", [heading, "T"]) if record.valid else ("HETHS", [heading, "V"])


def _pashr_fields(record: HeadingRecord) -> list[str]:
    sd = "" if record.sd_deg is UNSET else f"{record.sd_deg:.3f}"
    attitude = [plain(record.roll_deg, 3), plain(record.pitch_deg, 3)]
    heading, quality = plain(record.heading_deg, 3), "2" if record.valid else "0"
    return [clock(record.t_device_s), heading, "T", *attitude, "0.00", "", "", sd, quality, "1"]


READERS: dict[str, Reader] = {
    "HDT": _hdt,
    "THS": _ths,
    "HDG": _hdg,
    "HDM": _hdm,
    "PRDID": _prdid,
    "PASHR": _pashr,
}

NMEA_HEADING = Codec(
    name="nmea-heading",
    kind="heading",
    devices="Compasses that send HDT, THS, HDG, HDM, PRDID or PASHR by NMEA 0183",
    options=HeadingOptions,
    decoder=decoder,
    encode=encode,
)
