"""Reading a YAML file so that it means what it shows: YAML 1.2 scalars, text keys, no key twice."""

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from gateway.errors import ConfigError, cause

_INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_DECIMAL = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_ENDLESS = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
MAX_BYTES = 1_000_000
"""More is not written by hand: a capture or a recording given by mistake."""

_TAG = "tag:yaml.org,2002:"


def read_yaml(path: Path) -> Any:
    """Read one YAML (or JSON) document as plain data.

    Scalars follow the YAML 1.2 core schema, so that a file says what it shows: ``on`` and ``12:30``
    are text, ``010`` is ten and ``1e-3`` is a number. Keys are text as written (``1:`` is ``"1"``).

    Raises
    ------
    ConfigError
        With one line naming the file: missing, unreadable, too large, not UTF-8, not YAML (line
        and column); one line for each key given twice.
    """
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES + 1)
        if len(text) > MAX_BYTES:
            raise ConfigError(f"larger than {MAX_BYTES // 1_000_000} MB", path)
        loader = _Loader(text.decode("utf-8-sig"))
        data = loader.get_single_data()
    except OSError as error:
        raise ConfigError(cause(error), path) from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"not UTF-8 text (byte {error.start + 1})", path) from error
    except yaml.reader.ReaderError as error:
        raise ConfigError(f"not text (character {error.position + 1})", path) from error
    except yaml.MarkedYAMLError as error:
        raise ConfigError(
            _place(error.problem_mark) + (error.problem or "not YAML").removeprefix("but "), path
        ) from error
    except RecursionError as error:
        raise ConfigError("nested too deeply", path) from error
    if loader.repeated:
        raise ConfigError(loader.repeated, path)
    return data


def read_value(text: str) -> Any:
    """What a text would be as a value in a file; the text itself where it is no YAML."""
    try:
        return _Loader(text).get_single_data()
    except (yaml.YAMLError, RecursionError):
        return text


def reads_as_number(text: str) -> bool:
    """Whether the text, unquoted in a file, would be a number."""
    return _INTEGER.fullmatch(text) is not None or _DECIMAL.fullmatch(text) is not None


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader without the surprises of YAML 1.1."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.repeated: list[str] = []

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        first: dict[str, int] = {}
        for key, _ in node.value:
            name = str(key.value)
            if name in first:
                place = _place(key.start_mark)
                self.repeated.append(f"{place}{name} is given twice (first in line {first[name]})")
            first.setdefault(name, key.start_mark.line + 1)
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        self.flatten_mapping(node)
        return {self._key(key): self.construct_object(value, deep) for key, value in node.value}

    def _key(self, node: yaml.Node) -> str:
        if not isinstance(node, yaml.ScalarNode):
            raise yaml.MarkedYAMLError(
                problem="a key must be a plain name", problem_mark=node.start_mark
            )
        return str(node.value)

    def _boolean(self, node: yaml.ScalarNode) -> bool:
        return str(node.value).lower() == "true"

    def _number(self, node: yaml.ScalarNode) -> int | float:
        text = str(node.value)
        try:
            if len(text) > 100:
                raise ValueError(text)
            if _INTEGER.fullmatch(text):
                return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
            return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
        except ValueError as error:
            raise yaml.MarkedYAMLError(
                problem=f"not a number: {text[:20]}", problem_mark=node.start_mark
            ) from error


_Loader.yaml_implicit_resolvers = {}
_Loader.yaml_constructors = {
    tag: yaml.SafeLoader.yaml_constructors[tag]
    for tag in (_TAG + "null", _TAG + "str", _TAG + "seq", _TAG + "map", None)
}
_DIGITS = list("-+.0123456789")
_Loader.add_implicit_resolver(_TAG + "merge", re.compile(r"<<$"), ["<"])
_Loader.add_implicit_resolver(_TAG + "null", re.compile(r"(~|null|Null|NULL|)$"), [*"~nN", ""])
_Loader.add_implicit_resolver(
    _TAG + "bool", re.compile(r"(true|True|TRUE|false|False|FALSE)$"), list("tTfF")
)
for _pattern in (_INTEGER, _DECIMAL, _ENDLESS):
    _whole = re.compile(rf"({_pattern.pattern})$")
    _Loader.add_implicit_resolver(_TAG + "float", _whole, _DIGITS)
_Loader.add_constructor(_TAG + "bool", _Loader._boolean)
_Loader.add_constructor(_TAG + "float", _Loader._number)
_Loader.add_constructor(_TAG + "int", _Loader._number)


def _place(mark: yaml.Mark | None) -> str:
    return f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
