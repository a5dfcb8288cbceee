"""The picture of the house in docs/architecture.md names what is there and what contracts place."""

import re
import tomllib

import pytest

from tests.shared_data import ROOT

PICTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
LINES = re.findall(r"(?m)^\| (`[^|]*) \| [^|]*\|$", PICTURE[: PICTURE.index("## Processes")])
"""The first column of the table, from the top of the house down."""
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
    "contracts"
]


def floors(package: str) -> list[str]:
    """Modules and rooms of a package, from its contract of layers down."""
    (contract,) = (c for c in CONTRACTS if c.get("containers") == [package])
    return [name for layer in contract["layers"] for name in layer.split(" | ")]


def drawn(package: str) -> list[str]:
    """The same from the picture."""
    lines = [line for line in LINES if ("drivers." in line) == (package == "drivers")]
    names = re.findall(r"`([^`]+)`", " ".join(lines))
    return [name.removeprefix(f"{package}.").removesuffix(".*") for name in names]


@pytest.mark.parametrize("package", ["gateway", "drivers"])
def test_the_picture_names_every_room(package: str) -> None:
    assert sorted(drawn(package)) == sorted(set(floors(package)) - {"__main__"})


@pytest.mark.parametrize("package", ["gateway", "drivers"])
def test_every_room_is_there(package: str) -> None:
    for name in floors(package):
        there = ROOT / package / name
        assert there.with_suffix(".py").is_file() != (there / "__init__.py").is_file(), name
