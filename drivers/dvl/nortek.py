"""Nortek Doppler logs by NMEA 0183: bottom track of data formats 356 to 359.

``$PNORBT7,time,dt1,dt2,vx,vy,vz,fom,d1,d2,d3,d4*hh``
    Unix time of the ping (s); time to the bottom echo from the trigger and from this sentence's
    beginning (ms, the latter negative); velocity (m/s); figure of merit, its 1-sigma (m/s);
    vertical distance of each beam (m).
``$PNORBT9,...,d4,battery,sound speed,pressure,temperature,status*hh``
    The same and volts, m/s, bar, degrees Celsius, hexadecimal bits.
``$PNORBT6`` and ``$PNORBT8``
    These with tags: ``TIME=``, ``DT1=``, ``DT2=``, ``VX=``, ``VY=``, ``VZ=``, ``FOM=``, ``D1=`` ...

A velocity of -32.768 and a figure of merit of 10 stand for none, a distance of 0 for no echo. Axes
are forward, starboard, down. Every other sentence comes out as it is.
"""

import msgspec
from msgspec import UNSET

from drivers.codec import Codec, Decoder
from drivers.fields import number, numbers
from drivers.framing import UnreadableError
from drivers.nmea0183 import Checksum
from drivers.records import DvlRecord, Record
from drivers.sentences import Fields, Heard, Reader, expect, table_decoder, written

NONE_M_S = -32.768
NO_MERIT = 10.0
MILLI = 1e-3
AGE_MAX_MS = 10_000.0
TAGS = ("TIME", "DT1", "DT2", "VX", "VY", "VZ", "FOM", "D1", "D2", "D3", "D4")
MORE_TAGS = ("BATT", "SS", "PRESS", "TEMP", "STAT")
LONGEST = 256


class NortekOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether sentences carry a checksum."""

    checksum: Checksum = "required"


def decoder(options: NortekOptions) -> Decoder:
    """Make a decoder of a log's sentences."""
    return table_decoder(_READERS, options, options.checksum)


def encode(record: Record, options: NortekOptions) -> bytes:
    """Write a `DvlRecord` as PNORBT7, with a speed of sound as PNORBT9."""
    if not isinstance(record, DvlRecord) or record.axes != "sensor":
        raise ValueError(f"nortek-dvl cannot say this {type(record).__name__}")
    age_ms = 0.0 if record.age_s is UNSET else -record.age_s / MILLI
    velocity = record.velocity_m_s or (NONE_M_S,) * 3
    merit = NO_MERIT if record.sd_m_s is UNSET else max(record.sd_m_s)
    fields = [f"{record.t_device_s or 0.0:.4f}", "0.000", f"{age_ms:.3f}"]
    fields += [f"{v:.5f}" for v in velocity]
    fields += [f"{merit:.5f}", *[f"{record.altitude_m or 0.0:.2f}"] * 4]
    if record.sound_speed_m_s is UNSET:
        return written("PNORBT7", fields, options.checksum, longest=LONGEST)
    fields += ["24.0", f"{record.sound_speed_m_s:.1f}", "0.0", "0.0", "0x000FFFFF"]
    return written("PNORBT9", fields, options.checksum, longest=LONGEST)


def _untagged(fields: Fields, _options: NortekOptions, heard: Heard) -> DvlRecord:
    expect(fields, len(TAGS), len(TAGS) + len(MORE_TAGS))
    return _bottom_track(fields, heard)


def _tagged(fields: Fields, _options: NortekOptions, heard: Heard) -> DvlRecord:
    """Tags are what they are called by, but they stand in the order of the others too."""
    expect(fields, len(TAGS), len(TAGS) + len(MORE_TAGS))
    tags, _, values = zip(*(field.partition("=") for field in fields), strict=True)
    if tags != (TAGS + MORE_TAGS)[: len(fields)]:
        raise UnreadableError("syntax", f"{', '.join(tags)} are not the tags")
    return _bottom_track(values, heard)


def _bottom_track(values: Fields, heard: Heard) -> DvlRecord:
    time_s, _, dt2, x, y, z, merit, *vertical = numbers(values[:11])
    distances = [distance for distance in vertical if distance > 0.0]
    bad = NONE_M_S in (x, y, z) or not 0.0 <= merit < NO_MERIT
    return DvlRecord(
        **heard,
        age_s=-dt2 * MILLI if -AGE_MAX_MS < dt2 < 0.0 else UNSET,
        velocity_m_s=None if bad else (x, y, z),
        t_device_s=time_s,
        valid=not bad,
        error_code="no_lock" if bad else None,
        altitude_m=sum(distances) / len(distances) if distances else None,
        sd_m_s=UNSET if bad else (merit, merit, merit),
        sound_speed_m_s=number(values[12]) if len(values) > 12 else UNSET,
    )


_READERS: dict[str, Reader] = {
    "PNORBT6": _tagged,
    "PNORBT7": _untagged,
    "PNORBT8": _tagged,
    "PNORBT9": _untagged,
}

NORTEK = Codec(
    name="nortek-dvl",
    kind="dvl",
    devices="Nortek DVL 500 and 1000: PNORBT6 to PNORBT9",
    options=NortekOptions,
    decoder=decoder,
    encode=encode,
)
