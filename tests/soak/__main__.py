"""``python -m tests.soak --minutes 30``: the gateway among faults, a table at the end."""

import argparse
import asyncio
import sys
import tempfile
from pathlib import Path

from tests.soak.story import Soak
from tests.soak.table import lines


def main() -> int:
    """Soak, print the table; exit code 1 where something is not as it must be."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=main.__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="soak") as folder:
        soak = Soak(Path(folder), arguments.minutes, arguments.seed)
        asyncio.run(soak.run())
    print(*lines(soak.figures), sep="\n")
    findings = list(soak.figures.findings())
    print("", *findings, f"{len(findings)} findings", sep="\n")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
