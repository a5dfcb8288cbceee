"""The block of an NMEA output, and what its sentences can speak of."""

from typing import Annotated, Literal

from msgspec import Meta

from drivers.settings import OutputLink
from gateway.config.block import Block, Name

Sentence = Literal[
    "GGA", "GLL", "RMC", "VTG", "HDT", "THS", "ZDA",
    "GST", "GBS", "GSA", "DPT", "DBT", "DBS", "TLL", "TTM", "PUNAV",
]  # fmt: skip
DEPTH_SENTENCES: tuple[Sentence, ...] = ("DPT", "DBT", "DBS")
"""They tell the vehicle's own depth below the surface."""
TARGET_SENTENCES: tuple[Sentence, ...] = ("TLL", "TTM")
"""They tell of everything that is followed."""
OWN_SENTENCES: tuple[Sentence, ...] = ("HDT", "THS", "PUNAV", *TARGET_SENTENCES)
"""They tell what of a target is not known."""


class NmeaOutput(Block, frozen=True, kw_only=True, tag_field="type", tag="nmea"):
    """NMEA 0183 for chart plotters: UDP to a host, a TCP server, a line, a pty or stdout."""

    link: OutputLink
    sentences: Annotated[tuple[Sentence, ...], Meta(min_length=1)] = (
        "GGA",
        "RMC",
        "HDT",
        "VTG",
        "GST",
        "GBS",
        "ZDA",
    )
    rate_hz: Annotated[float, Meta(gt=0, le=100)] = 1.0
    talker: Annotated[str, Meta(pattern=r"\A[A-Z]{2}\Z", description="two capital letters")] = "GP"
    surface_height_m: float | None = None
    """Of the water's surface above the ellipsoid (geoid and tide), for sentences with a depth."""
    range_error_m: Annotated[float, Meta(gt=0)] | None = None
    """What a dilution of 1 stands for with readers that take their errors from dilutions alone."""
    target: Name | None = None
    """Name of a target of which the sentences speak as if it were the vessel; once a second."""
