"""Reading files: they mean what they show, and what cannot be read is said in one line."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.errors import ConfigError
from gateway.yamlfile import read_value, read_yaml

TEXT = st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]), max_size=20)
SCALARS = st.none() | st.booleans() | st.integers(-(10**15), 10**15) | TEXT
SCALARS |= st.floats(allow_nan=False, allow_infinity=False)
DOCUMENTS = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner)
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("on", "on"),
        ("yes", "yes"),
        ("true", True),
        ("False", False),
        ("12:30", "12:30"),
        ("12:30:45.5", "12:30:45.5"),
        ("010", 10),
        ("0o10", 8),
        ("0x10", 16),
        ("1e-3", 1e-3),
        ("-.5", -0.5),
        ("2.", 2.0),
        ("+7", 7),
        ("1_000", "1_000"),
        ("-.inf", float("-inf")),
        ("2026-01-01", "2026-01-01"),
        ("/dev/ttyUSB0", "/dev/ttyUSB0"),
        ("", None),
        ("~", None),
        ("'5'", "5"),
        ("[1, x]", [1, "x"]),
        ("[1", "[1"),
        ("9" * 200, "9" * 200),
    ],
)
def test_a_value_means_what_it_shows(text: str, value: Any) -> None:
    made = read_value(text)
    assert made == value
    assert type(made) is type(value)


def test_keys_are_text_as_written(tmp_path: Path) -> None:
    assert parsed(tmp_path, b"1: a\n007: b\non: c\n1.50: d\n~: e\n") == {
        "1": "a",
        "007": "b",
        "on": "c",
        "1.50": "d",
        "~": "e",
    }


def test_merge_keys_and_byte_order_mark(tmp_path: Path) -> None:
    text = b"\xef\xbb\xbfbase: &b {x: 1, y: 2}\nmore: {<<: *b, y: 3}\n"
    assert parsed(tmp_path, text)["more"] == {"x": 1, "y": 3}


@given(DOCUMENTS)
def test_json_is_yaml(document: Any) -> None:
    assert read_value(json.dumps(document)) == document


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"a: 1\nb: 2\na: 3\n", "line 3, column 1: a is given twice (first in line 1)"),
        (b'{"a": 1, "a": 2}', "line 1, column 10: a is given twice (first in line 1)"),
        (b"a: \xff\n", "not UTF-8 text (byte 4)"),
        (b"a: \x00\n", "not text (character 4)"),
        (b"a: b: c\n", "line 1, column 5: mapping values are not allowed here"),
        (b"a:\n\t- 1\n", "line 2, column 1: found character '\\t' that cannot start any token"),
        (b"a: 1\n---\nb: 2\n", "line 2, column 1: found another document"),
        (b"? [a]\n: 1\n", "line 1, column 3: a key must be a plain name"),
        (b"a: *b\n", "line 1, column 4: found undefined alias 'b'"),
        (b"a: !!int x\n", "line 1, column 4: not a number: x"),
        (b"[" * 10_000, "nested too deeply"),
    ],
)
def test_what_is_not_yaml_is_one_line(tmp_path: Path, content: bytes, fault: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parsed(tmp_path, content)
    assert caught.value.faults == [fault]
    assert str(caught.value) == f"{tmp_path / 'x.yaml'}: {fault}"


def test_no_python_objects(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="line 1, column 4: could not determine a constructor"):
        parsed(tmp_path, b"a: !!python/object/apply:os.getcwd []\n")


@pytest.mark.parametrize(
    ("name", "fault"), [("absent", "no such file or directory"), ("", "is a directory")]
)
def test_what_is_no_file_is_one_line(tmp_path: Path, name: str, fault: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_yaml(tmp_path / name)
    assert str(caught.value) == f"{tmp_path / name}: {fault}"


def parsed(folder: Path, content: bytes) -> Any:
    path = folder / "x.yaml"
    path.write_bytes(content)
    return read_yaml(path)


def test_what_is_too_large_for_a_configuration_is_not_parsed(tmp_path: Path) -> None:
    file = tmp_path / "capture.yaml"
    file.write_bytes(b"x: " + b"a" * 10_000_000)
    with pytest.raises(ConfigError, match="larger than 1 MB"):
        read_yaml(file)
