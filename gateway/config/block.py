"""What every block of a file is made of: numbers within bounds, names, no unknown key."""

from typing import Annotated

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=360)]
Triple = tuple[float, float, float]
Angle = Annotated[float, Meta(ge=-360, le=360)]
Angles = tuple[Angle, Angle, Angle]
PositiveTriple = tuple[Positive, Positive, Positive]
SigmaTriple = tuple[NonNegative, NonNegative, NonNegative]
Probability = Annotated[float, Meta(ge=0, le=1)]
SoundSpeed = Annotated[float, Meta(ge=1300, le=1700)]
Name = Annotated[
    str,
    Meta(
        pattern=r"\A[A-Za-z0-9][A-Za-z0-9_.-]*\Z",
        max_length=64,
        description="a name of letters, digits and _ . - (at most 64)",
    ),
]


class Block(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A block of the file: unknown keys are errors."""
