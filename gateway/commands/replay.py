"""`usblnav replay`: captured traffic through the pipeline."""

import json
from argparse import Namespace
from collections.abc import Iterator
from typing import Any

from gateway.config import load
from gateway.errors import ConfigError


def run(arguments: Namespace) -> int:
    """Replay the captures and print the summary."""
    config = load(arguments.config)
    absent = [str(capture) for capture in arguments.captures if not capture.exists()]
    if absent:
        raise ConfigError([f"{capture}: no such file" for capture in absent])
    from gateway import replay  # after the checks: it takes a second to import

    summary = replay.run(
        arguments.captures,
        config,
        out=arguments.out,
        rate_hz=arguments.rate,
        origin=arguments.origin,
    )
    if arguments.json:
        print(json.dumps(summary, indent=2))
    else:
        for line in _lines(summary):
            print(line)
        print(f"results in {arguments.out}")
    return 0


def _lines(block: dict[str, Any], indent: str = "") -> Iterator[str]:
    for key, value in block.items():
        match value:
            case {"value": float(mean), "sigma": float(sigma)}:
                yield f"{indent}{key}: {mean:.4g} (sigma {sigma:.2g})"
            case dict() if value:
                yield f"{indent}{key}:"
                yield from _lines(value, indent + "  ")
            case float():
                yield f"{indent}{key}: {value:.6g}"
            case _:
                yield f"{indent}{key}: {value or 0}"
