"""From one timeline to another: a moment of the past that nothing can change any more."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.order import OrderCounts


@dataclass
class Note:
    """A moment at which another timeline can take over, given all that came after it.

    Attributes
    ----------
    count, t_ns
        Samples consumed, and the time of the last.
    began_ns
        Moment before the first sample of all.
    known
        Measurements that had come by then and may still come again or wait: time, key, itself.
    order
        The counts of then.
    told
        Verdicts given since on measurements that lie before it: their effect is in `state`, so
        that the other timeline takes them in silence.
    state
        The engine's, once nothing can change it; None before.
    past
        Track before ``t_ns`` as far as measurements after it asked for it.
    """

    count: int
    t_ns: int
    began_ns: int
    known: tuple[tuple[int, str, Any], ...]
    order: OrderCounts
    told: int = 0
    state: Any = None
    past: dict[int, NDArray[np.float64]] = field(default_factory=dict)
