"""What every block of a scenario file is made of."""

from typing import Annotated

import msgspec
from msgspec import Meta

Probability = Annotated[float, Meta(ge=0, le=1)]
SoundSpeed = Annotated[float, Meta(ge=1300, le=1700)]


class Block(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A block of the file: unknown keys are errors."""
