"""Depth below the surface or height above the bottom by NMEA 0183.

``$--DPT,metres,offset,range*hh``
    Depth below the transducer; ``offset`` to the waterline or keel and ``range`` (version 3.0) are
    not read.
``$--DBT,feet,f,metres,M,fathoms,F*hh``
    Depth below the transducer.

By the standard, that of an echo sounder: the water below it. Pressure sensors send their own depth
below the surface in the same sentences; which of the two it is, is an option. Any talker; every
other sentence comes out as it is.
"""

from typing import Literal

import msgspec

from drivers.codec import Codec, Decoder
from drivers.fields import maybe
from drivers.nmea0183 import Checksum
from drivers.records import DepthRecord, Record
from drivers.sentences import Fields, Heard, expect, expect_units, table_decoder, written

FOOT_M = 0.3048


class DepthOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether sentences carry a checksum, and what their number is.

    ``measures``: the sensor's ``depth`` below the surface or its ``altitude`` above the bottom.
    """

    checksum: Checksum = "required"
    measures: Literal["altitude", "depth"] = "altitude"


def decoder(options: DepthOptions) -> Decoder:
    """Make a decoder of a sounder's or depth sensor's sentences."""
    return table_decoder(READERS, options, options.checksum)


def encode(record: Record, options: DepthOptions) -> bytes:
    """Write a `DepthRecord` as DPT: the one of its numbers that the options name."""
    if not isinstance(record, DepthRecord):
        raise ValueError(f"nmea-depth cannot say a {type(record).__name__}")
    value = record.depth_m if options.measures == "depth" else record.altitude_m
    metres = f"{value:.3f}" if isinstance(value, float) and record.valid else ""
    return written("SDDPT", [metres, "0.0"], options.checksum)


def _dpt(fields: Fields, options: DepthOptions, heard: Heard) -> DepthRecord:
    expect(fields, 2, 3)
    return _measured(maybe(fields[0], 0), options, heard)


def _dbt(fields: Fields, options: DepthOptions, heard: Heard) -> DepthRecord:
    """Metres where there are any, else feet: their step is the smallest."""
    expect(fields, 6)
    expect_units(fields, {1: "f", 3: "M", 5: "F"})
    metres, feet = maybe(fields[2], 0), maybe(fields[0], 0)
    if metres is None and feet is not None:
        metres = feet * FOOT_M
    return _measured(metres, options, heard)


def _measured(metres: float | None, options: DepthOptions, heard: Heard) -> DepthRecord:
    """A sounder without an echo leaves the field empty."""
    if metres is None:
        return DepthRecord(**heard, valid=False)
    if options.measures == "depth":
        return DepthRecord(**heard, depth_m=metres)
    return DepthRecord(**heard, altitude_m=metres)


READERS = {"DPT": _dpt, "DBT": _dbt}

NMEA_DEPTH = Codec(
    name="nmea-depth",
    kind="depth",
    devices="Echo sounders and depth sensors that send DPT or DBT by NMEA 0183",
    options=DepthOptions,
    decoder=decoder,
    encode=encode,
)
