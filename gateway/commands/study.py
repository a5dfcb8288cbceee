"""`usblnav study`: the Monte Carlo reproduction of a published table."""

import json
import time
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.errors import UsblnavError

if TYPE_CHECKING:
    from gateway.studies.table import Study

_WIDTH = 100
"""Columns that no row of a table needs more of, for a pipe and for a narrow terminal."""


def run(arguments: Namespace) -> int:
    """Make the runs, print the table, and write it with its figures if a folder is given."""
    from gateway import studies  # not before: `--help` needs no numpy
    from gateway.studies.montecarlo import Workers

    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)  # better told now than after the runs
    begin = time.monotonic()
    study = studies.load(arguments.name)(
        arguments.runs or studies.RUNS, Workers(arguments.jobs, arguments.dask)
    )
    plain = study.plain(round(time.monotonic() - begin, 1))
    text = json.dumps(plain, indent=2)
    if arguments.out is not None:
        _write(study, text, arguments.out)
    if arguments.json:
        print(text)
    else:
        _print(study, plain["seconds"])
    return 0


def _write(study: "Study", text: str, out: Path) -> None:
    """Write ``study.json`` and a picture of every figure."""
    try:
        (out / f"{study.name}.json").write_text(text + "\n", encoding="utf-8")
        for name, draw in study.figures.items():
            draw().savefig(out / f"{study.name}-{name}.png", dpi=120)
    except OSError as error:
        raise UsblnavError(f"{out}: cannot write: {error.strerror}") from error


def _print(study: "Study", seconds: float) -> None:
    from rich.console import Console

    Console(width=max(Console().width, _WIDTH)).print(study.shown())
    print(f"{study.runs} runs in {seconds:g} s")
