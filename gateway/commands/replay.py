"""`usblnav replay`: captured or recorded traffic through the pipeline."""

import json
import sys
from argparse import Namespace
from collections.abc import Iterator
from typing import Any

from gateway.commands import tapes
from gateway.config import load


def run(arguments: Namespace) -> int:
    """Replay the captures and print the summary."""
    config = None if arguments.config is None else load(arguments.config)
    captures = tapes.named(arguments.captures)
    from gateway import replay  # after the checks: it takes a second to import
    from gateway.nav.compiled import told_of_compiling
    from gateway.progress import bars

    compiling = told_of_compiling(lambda: print("compiling the filter, once", file=sys.stderr))
    with compiling, bars() as tell:
        summary = replay.run(
            captures,
            config,
            out=arguments.out,
            rate_hz=arguments.rate,
            filters=arguments.filters,
            smooth=arguments.smooth,
            tell=tell,
        )
    tapes.tell_damage(next(iter(summary.get("filters", {"": summary}).values())))
    if arguments.json:
        print(json.dumps(summary, indent=2))
    elif "filters" in summary:
        for line in _comparison(summary["filters"]):
            print(line)
        print(f"results in {', '.join(str(arguments.out / name) for name in summary['filters'])}")
    else:
        for line in _lines(summary):
            print(line)
        print(f"results in {arguments.out}")
    return 0


def _comparison(summaries: dict[str, dict[str, Any]]) -> Iterator[str]:
    """A row for each filter; NIS beside what a consistent filter has in the mean."""
    yield (
        f"{'filter':16}{'used':>8}{'refused':>9}{'mean NIS':>10}{'expected':>10}"
        f"{'sd horiz.':>12}{'sd vert.':>11}{'sd heading':>14}"
    )
    for name, summary in summaries.items():
        counts, sigma = summary["filter"], summary["final_sigma"]
        refused = counts["gated"] + counts["too_late"]
        nis = "".join(
            f"{'-' if counts[key] is None else f'{counts[key]:.2f}':>10}"
            for key in ("mean_nis", "expected_nis")
        )
        units = (
            ("horizontal_m", ".3f", " m"),
            ("vertical_m", ".3f", " m"),
            ("heading_deg", ".4f", " deg"),
        )
        sds = [f"{sigma[key]:{form}}{unit}" if sigma else "-" for key, form, unit in units]
        yield (
            f"{name:16}{counts['fixes_used']:8d}{refused:9d}{nis}"
            f"{sds[0]:>12}{sds[1]:>11}{sds[2]:>14}"
        )


def _lines(block: dict[str, Any], indent: str = "") -> Iterator[str]:
    for key, value in block.items():
        match value:
            case {"value": float(mean), "sigma": float(sigma)}:
                yield f"{indent}{key}: {mean:.4g} (sigma {sigma:.2g})"
            case dict() if value:
                yield f"{indent}{key}:"
                yield from _lines(value, indent + "  ")
            case list():
                yield f"{indent}{key}: {len(value)}"
            case float():
                yield f"{indent}{key}: {value:.6g}"
            case _:
                yield f"{indent}{key}: {value or 0}"
