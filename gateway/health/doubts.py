"""What a device says that cannot well be, as the status tells it."""

import msgspec


class Doubt(msgspec.Struct, frozen=True):
    """Something that a device says and that cannot well be."""

    of: str
    text: str
