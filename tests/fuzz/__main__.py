"""`python -m tests.fuzz CODEC|all --minutes M`: coverage-guided fuzzing, one after the other.

Needs `pip install .[fuzz]`, nothing else. What a hunt found worth keeping joins tests/fuzz/corpus
(`--keep`); an input that shows a fault is printed as a line of that corpus.
"""

import re
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic

from drivers import registry
from tests.fuzz import corpus, seeds
from tests.fuzz.trial import check_flood

INPUT_MAX = 1024
MEMORY_MB = 1500
SLOWEST_S = 20

_EDGES = re.compile(r"cov: (\d+)")
_RUNS = re.compile(r"number_of_executed_units: (\d+)")
_FAULT = re.compile(r"=== Uncaught Python exception: ===\n(.*)|(ERROR: libFuzzer: .*)")


@dataclass(frozen=True)
class Hunt:
    """What a hunt came to."""

    codec: str
    minutes: float
    executions: int
    edges: int
    kept: int
    fault: str | None


def main(words: Sequence[str] | None = None) -> int:
    """Hunt, print a line for each codec; 1 if anything was found."""
    parser = ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("codec", choices=["all", *registry.CODECS], metavar="CODEC|all")
    parser.add_argument("--minutes", type=float, default=10.0, help="for each; 0 tries the seeds")
    parser.add_argument("--keep", action="store_true", help="write the minimised corpus")
    arguments = parser.parse_args(words)
    if arguments.minutes and find_spec("atheris") is None:
        parser.error("atheris is not installed: pip install .[fuzz], or --minutes 0")
    chosen = sorted(registry.CODECS) if arguments.codec == "all" else [arguments.codec]
    print(f"{'codec':16} {'minutes':>8} {'executions':>11} {'edges':>6} {'kept':>5}  finding")
    faults = 0
    for codec in chosen:
        hunt = hunted(codec, arguments.minutes, keep=arguments.keep)
        print(
            f"{codec:16} {hunt.minutes:8.1f} {hunt.executions:11d} {hunt.edges:6d} {hunt.kept:5d}"
            f"  {hunt.fault or 'none'}",
            flush=True,
        )
        faults += hunt.fault is not None
    return 1 if faults else 0


def hunted(codec: str, minutes: float, *, keep: bool) -> Hunt:
    """Hunt in a folder of its own, then see whether what is kept piles up."""
    with TemporaryDirectory(prefix="usblnav-fuzz-") as place:
        folder = Path(place)
        pool = folder / "pool"
        pool.mkdir()
        for n, data in enumerate(seeds.seeds(codec)):
            (pool / f"seed{n:03d}").write_bytes(data)
        begun = monotonic()
        said, fault = _libfuzzer(codec, minutes, folder) if minutes else ("", None)
        hunted_s = monotonic() - begun
        inputs = [path.read_bytes() for path in sorted(pool.iterdir())]
    kept = [] if fault else corpus.minimised(codec, inputs)
    if keep and kept:
        corpus.write(codec, kept)
    return Hunt(
        codec=codec,
        minutes=hunted_s / 60,
        executions=int(_last(_RUNS, said)),
        edges=int(_last(_EDGES, said)),
        kept=len(kept),
        fault=fault or _piled_up(codec, kept),
    )


def _libfuzzer(codec: str, minutes: float, folder: Path) -> tuple[str, str | None]:
    """What it says, and the fault it found; it never gives its process back."""
    (folder / "words").write_text("".join(f'"{_quoted(word)}"\n' for word in seeds.words(codec)))
    options = {
        "max_total_time": max(1, round(minutes * 60)),
        "max_len": INPUT_MAX,
        "rss_limit_mb": MEMORY_MB,
        "timeout": SLOWEST_S,
        "dict": folder / "words",
        "artifact_prefix": f"{folder}/fault-",
        "print_final_stats": 1,
    }
    flags = [f"-{name}={value}" for name, value in options.items()]
    ran = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.hunt", codec, *flags, str(folder / "pool")],
        capture_output=True,
        check=False,
        text=True,
        errors="replace",
    )
    return ran.stderr, _fault(ran, folder) if ran.returncode else None


def _piled_up(codec: str, inputs: list[bytes]) -> str | None:
    for data in inputs:
        try:
            check_flood(codec, data)
        except AssertionError as error:
            return f"{error}\n    {corpus.line(data)}"
    return None


def _fault(ran: subprocess.CompletedProcess[str], folder: Path) -> str:
    said = _FAULT.search(ran.stdout + ran.stderr)
    reason = (said[1] or said[2]) if said else ran.stderr.strip()[-300:]
    inputs = [corpus.line(path.read_bytes()) for path in sorted(folder.glob("fault-*"))]
    return "\n    ".join([reason or "no reason given", *inputs])


def _last(pattern: re.Pattern[str], text: str) -> str:
    return next(reversed(pattern.findall(text)), "0")


def _quoted(word: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in word)


if __name__ == "__main__":
    sys.exit(main())
