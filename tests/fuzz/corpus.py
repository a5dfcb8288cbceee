"""Inputs that hunts found worth keeping, as text: one a line, what is not printable escaped."""

import sys
from collections.abc import Iterable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from tests.fuzz.trial import HEAD, check

FOLDER = Path(__file__).parent / "corpus"
SIZE_MAX = 8_000
"""Bytes of the file of one codec."""

Edge = tuple[CodeType, int, int]
"""Two lines of a function, run one after the other."""


def read(codec: str) -> list[bytes]:
    """Inputs kept for a codec."""
    path = FOLDER / f"{codec}.txt"
    return [parse(line) for line in path.read_text().splitlines()] if path.exists() else []


def write(codec: str, inputs: Iterable[bytes]) -> None:
    """Keep these instead."""
    text = "".join(sorted(f"{line(data)}\n" for data in inputs))
    (FOLDER / f"{codec}.txt").write_text(text)


def line(data: bytes) -> str:
    """``options cut stream``; the same as `parse` backwards."""
    head = data[:HEAD].ljust(HEAD, b"\0")
    stream = data[HEAD:].decode("latin-1").encode("unicode_escape").decode()
    return f"{head[:2].hex()} {head[2:].hex()} {stream}"


def parse(text: str) -> bytes:
    """An input of the file."""
    options, cut, stream = text.split(" ", 2)
    raw = stream.encode().decode("unicode_escape").encode("latin-1")
    return bytes.fromhex(options + cut) + raw


def minimised(codec: str, inputs: Iterable[bytes]) -> list[bytes]:
    """Few short inputs that run all the edges these do, as far as their file has room."""
    kept: list[bytes] = []
    seen: set[Edge] = set()
    size = 0
    for data in sorted(set(inputs), key=lambda data: len(line(data))):
        edges = traced(codec, data)
        if not edges <= seen and size + len(line(data)) < SIZE_MAX:
            kept.append(data)
            seen |= edges
            size += len(line(data)) + 1
    return kept


def traced(codec: str, data: bytes) -> set[Edge]:
    """Edges of the drivers that an input runs."""
    edges: set[Edge] = set()
    last: dict[int, int] = {}

    def local(frame: FrameType, event: str, _argument: Any) -> Any:
        if event == "line":
            edges.add((frame.f_code, last.get(id(frame), 0), frame.f_lineno))
            last[id(frame)] = frame.f_lineno
        return local

    def called(frame: FrameType, _event: str, _argument: Any) -> Any:
        if "/drivers/" not in frame.f_code.co_filename or "/tests/" in frame.f_code.co_filename:
            return None
        last[id(frame)] = 0
        return local

    before = sys.gettrace()
    sys.settrace(called)
    try:
        check(codec, data)
    finally:
        sys.settrace(before)
    return edges
