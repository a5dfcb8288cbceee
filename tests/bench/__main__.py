"""What the gateway costs, as a table of medians: ``python -m tests.bench``."""

import os
import tempfile
from pathlib import Path

from tests.bench import (
    against_c,
    decoding,
    late,
    live,
    recording,
    replayed,
    roundtrip,
    starting,
    steps,
)


def main() -> None:
    """Measure on one core, but for what needs two processes, and print."""
    cores = os.sched_getaffinity(0)
    with tempfile.TemporaryDirectory() as folder:
        source = replayed.source(Path(folder))
        os.sched_setaffinity(0, {min(cores)})
        rows = [
            *replayed.measure(source, Path(folder)),
            *steps.measure(source),
            *late.measure(source),
            *against_c.measure(),
            *decoding.measure(),
        ]
        os.sched_setaffinity(0, cores)
        rows += [*roundtrip.measure(source), *live.measure()]
        rows += [*recording.measure(source), *starting.measure(source)]
    print(f"{source.name}, {len(cores)} cores, load {os.getloadavg()[0]:.1f}")
    width = max(len(name) for name, _, _ in rows)
    for name, value, unit in rows:
        print(f"{name:{width}}  {value:9.2f} {unit}")


if __name__ == "__main__":
    main()
