"""What the gateway costs, as a table of medians: ``python -m tests.bench [WHAT ...]``."""

import argparse
import os
import tempfile
from collections.abc import Callable, Iterable
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
from tests.bench.replayed import Row

Measure = Callable[[Path, Path], Iterable[Row]]

ON_ONE_CORE: dict[str, Measure] = {
    "replayed": replayed.measure,
    "steps": lambda source, _: steps.measure(source),
    "late": lambda source, _: late.measure(source),
    "against_c": lambda *_: against_c.measure(),
    "decoding": lambda *_: decoding.measure(),
}
ON_ALL: dict[str, Measure] = {
    "roundtrip": lambda source, _: roundtrip.measure(source),
    "live": lambda *_: live.measure(),
    "recording": lambda source, _: recording.measure(source),
    "starting": lambda source, _: starting.measure(source),
}


def main() -> None:
    """Measure on one core, but for what needs two processes, and print."""
    known = [*ON_ONE_CORE, *ON_ALL]
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("what", nargs="*", help=f"of {', '.join(known)}; nothing: all")
    chosen = parser.parse_args().what or known
    if unknown := set(chosen) - set(known):
        parser.error(f"{', '.join(sorted(unknown))}: none of {', '.join(known)}")
    cores = os.sched_getaffinity(0)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        source = replayed.source(folder)
        for measures, on in ((ON_ONE_CORE, {min(cores)}), (ON_ALL, cores)):
            os.sched_setaffinity(0, on)
            for name, measure in measures.items():
                if name in chosen:
                    rows += measure(source, folder)
    print(f"{source.name}, {len(cores)} cores, load {os.getloadavg()[0]:.1f}")
    width = max(len(name) for name, _, _ in rows)
    for name, value, unit in rows:
        print(f"{name:{width}}  {value:9.2f} {unit}")


if __name__ == "__main__":
    main()
