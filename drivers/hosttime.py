"""The host's own time (ns): it never steps, and goes on while the host sleeps, as devices do."""

import time
from functools import partial

if hasattr(time, "CLOCK_BOOTTIME"):  # Linux
    now_ns = partial(time.clock_gettime_ns, time.CLOCK_BOOTTIME)
else:
    now_ns = partial(time.clock_gettime_ns, time.CLOCK_MONOTONIC)
