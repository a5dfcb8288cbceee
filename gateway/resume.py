"""Where a gateway that was away, or a replay, goes on."""

import msgspec

from gateway.clock import Clocks
from gateway.messages import SavedState


class Resume(msgspec.Struct, frozen=True, array_like=True):
    """The filter's state, None to begin at the configured one, and the devices' clocks."""

    state: SavedState | None = None
    clocks: Clocks = {}


COLD = Resume()
"""As configured, nothing known."""
