"""A bus of NMEA 0183 instruments: what nmea-gnss, nmea-heading and nmea-depth read, on one line.

GGA, GNS, RMC, VTG, ZDA; HDT, THS, HDG, HDM, PRDID, PASHR; DPT, DBT: the fields stand in
`drivers.gnss.nmea`, `drivers.heading.nmea` and `drivers.depth.nmea`. Every other sentence comes out
as it is.
"""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from drivers.codec import Codec, Decoder
from drivers.depth import nmea as depth
from drivers.gnss import nmea as gnss
from drivers.heading import nmea as heading
from drivers.nmea0183 import Checksum
from drivers.records import (
    DepthRecord,
    GnssRecord,
    HeadingRecord,
    NmeaSentence,
    Record,
    TimeRecord,
)
from drivers.sentences import Fields, Heard, Reader, table_decoder, written


class BusOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the sentences of the instruments do not say, as with the codec of each.

    ``geoid_m`` of nmea-gnss, ``variation_deg`` and ``prdid_magnetic`` of nmea-heading, ``measures``
    of nmea-depth.
    """

    checksum: Checksum = "required"
    geoid_m: float | None = None
    variation_deg: Annotated[float, Meta(ge=-180, le=180)] | None = None
    prdid_magnetic: bool = False
    measures: Literal["altitude", "depth"] = "altitude"

    @property
    def gnss(self) -> gnss.GnssOptions:
        """Those of the receiver."""
        return gnss.GnssOptions(self.checksum, self.geoid_m)

    @property
    def heading(self) -> heading.HeadingOptions:
        """Those of the compass."""
        return heading.HeadingOptions(self.checksum, self.variation_deg, self.prdid_magnetic)

    @property
    def depth(self) -> depth.DepthOptions:
        """Those of the sounder."""
        return depth.DepthOptions(self.checksum, self.measures)


def decoder(options: BusOptions) -> Decoder:
    """Make a decoder of all that the instruments say."""
    readers = {
        **_with(gnss.READERS, options.gnss),
        **_with(heading.READERS, options.heading),
        **_with(depth.READERS, options.depth),
    }
    return table_decoder(readers, options, options.checksum)


def encode(record: Record, options: BusOptions) -> bytes:
    """Write a record as the codec of its instrument does.

    Raises
    ------
    ValueError
        If none of them can say it.
    """
    match record:
        case GnssRecord() | TimeRecord():
            return gnss.encode(record, options.gnss)
        case HeadingRecord():
            return heading.encode(record, options.heading)
        case DepthRecord():
            return depth.encode(record, options.depth)
        case NmeaSentence():
            return written(record.talker + record.formatter, record.fields, options.checksum)
    raise ValueError(f"nmea-bus cannot say a {type(record).__name__}")


def _with(readers: Mapping[str, Reader], options: msgspec.Struct) -> dict[str, Reader]:
    """The readers of one instrument, by its own options."""
    return {name: _bound(read, options) for name, read in readers.items()}


def _bound(read: Reader, options: msgspec.Struct) -> Callable[[Fields, Any, Heard], Record]:
    return lambda fields, _all, heard: read(fields, options, heard)


NMEA_BUS = Codec(
    name="nmea-bus",
    kind="gnss",
    devices="Receiver, compass and sounder on one line of NMEA 0183, as a multiplexer sends them",
    options=BusOptions,
    decoder=decoder,
    encode=encode,
    also=("heading", "depth"),
)
