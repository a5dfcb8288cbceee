"""The table of what each format was checked against has all codecs and pages, and their tests."""

import re

import pytest

from drivers import registry
from tests.shared_data import ROOT

PAGES = ROOT / "docs" / "protocols"
TABLE = (PAGES / "README.md").read_text(encoding="utf-8").partition("## Known, not decoded")[0]
ROWS = {
    name: (page, [cell.strip() for cell in cells.split("|")])
    for name, page, cells in re.findall(r"^\| \[([\w-]+)\]\((\S+)\) \|(.*)\|$", TABLE, re.MULTILINE)
}
TESTS = {
    path.stem.removeprefix("test_"): path
    for folder in ("golden", "drivers")
    for path in (ROOT / "tests" / folder).glob("test_*.py")
}


def reads(test: str, codec: str) -> bool:
    """Whether a test speaks of a codec, by its name or by that of its module's constant."""
    name, constant = codec, registry.CODECS[codec].partition(":")[2]
    words = {f'"{name}"', f'f"{name.partition("-")[0]}-{{name}}"'}
    text = TESTS[test].read_text()
    return any(word in text for word in words) or bool(re.search(rf"\b{constant}\b", text))


def test_every_codec_has_one_row_and_every_page_is_linked() -> None:
    assert sorted(ROWS) == sorted(registry.CODECS)
    linked = {page for page, _ in ROWS.values()}
    assert linked == {page.name for page in PAGES.iterdir()} - {"README.md"}


@pytest.mark.parametrize("codec", sorted(registry.CODECS))
def test_a_row_says_what_and_names_the_tests(codec: str) -> None:
    _, (real, document, own, tests) = ROWS[codec]
    assert real or document or own
    named = tests.split(", ")
    assert [test for test in named if not reads(test, codec)] == []
    # What is there of golden bytes is read by one of those in tests/golden, and all are named.
    golden = {test for test, path in TESTS.items() if path.parent.name == "golden"}
    assert {test for test in golden if reads(test, codec)} <= set(named)
