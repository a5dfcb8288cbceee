r"""Paroscientific Digiquartz pressure sensors in their own serial protocol.

``*ddssvalue`` CR LF: an asterisk, two digits of destination (00 is the computer), two of source (01
to 98), and the pressure as a number with a decimal point. It has no checksum, and neither the unit
nor the difference between pressure (P1 to P7) and temperature (Q1 to Q7) is in it: let the sensor
send pressure only. Whatever else a sensor answers (``*0001UN=1``) is an `OtherFrame`.
"""

import re
from typing import Literal

from msgspec import UNSET

from drivers.codec import Codec, Decoder
from drivers.depth.pressure import WaterColumn
from drivers.fields import number
from drivers.framing import LineDecoder, UnreadableError, other_line
from drivers.records import DepthRecord, Record

PSI_PA = 6894.757293168
UNITS_PA = {
    "psi": PSI_PA,
    "hpa": 100.0,
    "bar": 1e5,
    "kpa": 1e3,
    "mpa": 1e6,
    "in_hg": 3386.389,
    "mm_hg": 133.322387415,
    "m_h2o": 9806.65,
}
PRESSURE_MAX_PA = 2e8
"""Nowhere in the sea is it more; a larger number means another unit than the option says."""

_ANSWER = re.compile(r"\*00(\d\d)(?:([+-]?\d+\.\d+)|([A-Z0-9]{2}=.*))")


class ParoscientificOptions(WaterColumn, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The unit (its command UN: 1 psi to 8 m_h2o), and how pressure becomes depth."""

    unit: Literal["psi", "hpa", "bar", "kpa", "mpa", "in_hg", "mm_hg", "m_h2o"] = "psi"


def decoder(options: ParoscientificOptions) -> Decoder:
    """Make a decoder of a sensor's answers."""

    def decode(line: str, t_rx_ns: int, line_bytes: int) -> Record:
        match = _ANSWER.fullmatch(line)
        if match is None:
            raise UnreadableError("syntax", "not an answer of a Digiquartz sensor")
        value, other = match.group(2, 3)
        if other is not None:
            return other_line(other[:2], line, t_rx_ns, line_bytes)
        pressure_pa = number(value, 0, PRESSURE_MAX_PA / unit_pa) * unit_pa
        return DepthRecord(
            t_rx_ns=t_rx_ns,
            line_bytes=line_bytes,
            pressure_pa=pressure_pa,
            depth_m=options.depth_m(pressure_pa),
        )

    unit_pa = UNITS_PA[options.unit]
    return LineDecoder(decode, _last_asterisk, longest=80)


def encode(record: Record, options: ParoscientificOptions) -> bytes:
    """Write a `DepthRecord` as the answer of sensor 01: its pressure, or that of its depth."""
    if not isinstance(record, DepthRecord):
        raise ValueError(f"paroscientific cannot say a {type(record).__name__}")
    pressure_pa = record.pressure_pa
    if pressure_pa is UNSET:
        if record.depth_m is None:
            raise ValueError("paroscientific needs a pressure or a depth")
        pressure_pa = options.pressure_pa(record.depth_m)
    return f"*0001{pressure_pa / UNITS_PA[options.unit]:.7f}\r\n".encode()


def _last_asterisk(line: bytes) -> tuple[int]:
    return (max(line.rfind(b"*"), 0),)


PAROSCIENTIFIC = Codec(
    name="paroscientific",
    kind="depth",
    devices="Paroscientific Digiquartz (series 8000, 6000, 1000) in continuous output of pressure",
    options=ParoscientificOptions,
    decoder=decoder,
    encode=encode,
)
