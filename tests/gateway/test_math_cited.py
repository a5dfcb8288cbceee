"""Every equation that the code cites stands in docs/math.md, once, in order."""

import re
from itertools import chain
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CITED = re.compile(r"\(M\.(\d+)\)(?:-\(M\.(\d+)\))?")
STATED = re.compile(r"^\*\*\(M\.(\d+)\)\*\*", re.MULTILINE)


def cited():
    """Number of each equation cited, with a place that cites it."""
    found = {}
    for path in chain((ROOT / "gateway").rglob("*.py"), (ROOT / "drivers").rglob("*.py")):
        for first, last in CITED.findall(path.read_text(encoding="utf-8")):
            for number in range(int(first), int(last or first) + 1):
                found.setdefault(number, path.relative_to(ROOT).as_posix())
    return found


def stated():
    return [int(n) for n in STATED.findall((ROOT / "docs/math.md").read_text(encoding="utf-8"))]


def test_the_code_cites_equations():
    assert {1, 16, 21, 33, 43, 50, 60} <= set(cited())


def test_every_cited_equation_is_stated():
    there = set(stated())
    assert {f"(M.{n}) in {where}" for n, where in cited().items() if n not in there} == set()


def test_no_equation_is_stated_twice():
    numbers = stated()
    assert sorted(set(numbers)) == sorted(numbers)
