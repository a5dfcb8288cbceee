"""From plain data to typed blocks, with every fault named by its path in the file."""

import difflib
import functools
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from msgspec import UNSET, inspect

from gateway.yamlfile import read_yaml, reads_as_number

__all__ = ["build", "draft", "known", "phrase", "read_yaml", "shown", "suggest"]

T = TypeVar("T")

_description: Callable[[Any], inspect.Type] = functools.cache(inspect.type_info)
"""Of a type: it does not change, and takes longer to make than to read."""


def build(type_: type[T], data: Any, faults: list[str], path: str = "") -> T | None:
    """Turn plain data into `type_`, collecting every fault.

    Parameters
    ----------
    type_
        A msgspec Struct or anything its fields may hold.
    data
        Dicts, lists and scalars as `read_yaml` gives them.
    faults
        Each fault found is appended as ``path: what is wrong``.
    path
        Where `data` stands in the file, e.g. ``devices.imu0.options``.

    Returns
    -------
    The value, or None when a fault was found.
    """
    before = len(faults)
    value = draft(type_, data, faults, path)
    return value if len(faults) == before else None


def draft(type_: type[T], data: Any, faults: list[str], path: str = "") -> T:
    """Like `build`, but give what could be read, with `msgspec.UNSET` in place of each fault.

    For checks across blocks that must be reported together with the faults inside them; ask `known`
    before using a value.
    """
    value: T = _Builder(faults).value(_description(type_), data, path)
    return value


def known(*values: object) -> bool:
    """Whether none of the values of a `draft` is a hole left by a fault."""
    return all(value is not UNSET for value in values)


def suggest(wrong: str, right: Iterable[str]) -> str:
    """``did you mean x?`` for the name closest to `wrong`, else ``one of: ...``."""
    names = list(right)
    close = difflib.get_close_matches(wrong, names, 1)
    if close:
        return f"did you mean {close[0]}?"
    return f"one of: {', '.join(names)}" if names else "none is expected here"


def shown(value: Any) -> str:
    """A value as the file would show it, short and on one line."""
    match value:
        case None:
            return "nothing"
        case bool() | int() | float():
            return str(value).lower()[:40]
        case str():
            short = value if len(value) <= 60 else value[:57] + "..."
            return json.dumps(short, ensure_ascii=not short.isprintable())
        case dict():
            return "a block of keys"
        case _:
            return "a list" if isinstance(value, list) else f"a {type(value).__name__}"


class _Builder:
    """One walk over a type and its data. Each method returns the value or UNSET after a fault."""

    def __init__(self, faults: list[str]) -> None:
        self._faults = faults

    def value(self, kind: inspect.Type, data: Any, path: str) -> Any:
        match kind:
            case inspect.AnyType():
                return data
            case inspect.Metadata():
                return self._described(kind, data, path)
            case inspect.StructType():
                return self._struct(kind, data, path)
            case inspect.UnionType():
                return self._union(kind, data, path)
            case inspect.DictType():
                return self._dict(kind, data, path)
            case inspect.TupleType() | inspect.VarTupleType() | inspect.ListType():
                return self._list(kind, data, path)
            case _:
                return self._scalar(kind, data, path)

    def _fault(self, path: str, what: str) -> Any:
        self._faults.append(f"{path}: {what}" if path else what)
        return UNSET

    def _expected(self, kind: inspect.Type, data: Any, path: str) -> Any:
        return self._fault(path, f"expected {phrase(kind)}, got {shown(data)}{_hint(kind, data)}")

    def _described(self, kind: inspect.Metadata, data: Any, path: str) -> Any:
        trial = _Builder([])
        value = trial.value(kind.type, data, path)
        return self._expected(kind, data, path) if trial._faults else value

    def _struct(self, kind: inspect.StructType, data: Any, path: str) -> Any:
        if not isinstance(data, Mapping):
            return self._expected(kind, data, path)
        given = {str(key): value for key, value in data.items()}
        if kind.tag_field is not None and given.pop(kind.tag_field, kind.tag) != kind.tag:
            return self._fault(_join(path, kind.tag_field), f"expected {kind.tag}")
        values = {}
        for field in kind.fields:
            place = _join(path, field.encode_name)
            if field.encode_name in given:
                values[field.name] = self.value(field.type, given.pop(field.encode_name), place)
            elif field.required:
                values[field.name] = self._fault(place, "missing")
        names = [field.encode_name for field in kind.fields]
        for key in given:
            self._fault(_join(path, key), f"unknown key; {suggest(key, names)}")
        return kind.cls(**values)

    def _union(self, kind: inspect.UnionType, data: Any, path: str) -> Any:
        if data is None and any(isinstance(member, inspect.NoneType) for member in kind.types):
            return None
        structs = [member for member in kind.types if isinstance(member, inspect.StructType)]
        others = [m for m in kind.types if not isinstance(m, inspect.StructType | inspect.NoneType)]
        if isinstance(data, Mapping) and len(structs) > 1:
            return self._tagged(structs, data, path)
        candidates = structs + others
        if len(candidates) == 1:
            return self.value(candidates[0], data, path)
        for member in candidates:
            trial = _Builder([])
            value = trial.value(member, data, path)
            if not trial._faults:
                return value
        return self._expected(kind, data, path)

    def _tagged(self, structs: list[inspect.StructType], data: Mapping[Any, Any], path: str) -> Any:
        field = structs[0].tag_field or "type"
        tags = {member.tag: member for member in structs}
        tag = data.get(field)
        place, names = _join(path, field), ", ".join(str(name) for name in tags)
        meant = next((m for m in structs if getattr(m.cls, "is_meant_untagged", False)), None)
        if field not in data and meant is not None:
            return self._struct(meant, data, path)
        if field not in data:
            return self._fault(place, f"missing; one of: {names}")
        if not isinstance(tag, str | int) or tag not in tags:
            return self._fault(place, f"unknown {field} {shown(tag)}; one of: {names}")
        return self._struct(tags[tag], data, path)

    def _dict(self, kind: inspect.DictType, data: Any, path: str) -> Any:
        if not isinstance(data, Mapping):
            return self._expected(kind, data, path)
        values = {}
        for key, item in data.items():
            place = _join(path, str(key))
            name = str(key) if isinstance(_bare(kind.key_type), inspect.StrType) else key
            value = self.value(kind.value_type, item, place)
            if known(self.value(kind.key_type, name, place)):
                values[name] = value
        return values

    def _list(
        self,
        kind: inspect.TupleType | inspect.VarTupleType | inspect.ListType,
        data: Any,
        path: str,
    ) -> Any:
        if not isinstance(data, list | tuple):
            return self._expected(kind, data, path)
        if isinstance(kind, inspect.TupleType):
            if len(data) != len(kind.item_types):
                return self._fault(path, f"expected {phrase(kind)}, got {len(data)}")
            kinds = kind.item_types
        else:
            kinds = (kind.item_type,) * len(data)
            least, most = kind.min_length or 0, kind.max_length
            if len(data) < least or (most is not None and len(data) > most):
                return self._fault(path, f"expected {phrase(kind)}, got {len(data)}")
        items = [
            self.value(item_kind, item, f"{path}[{n}]")
            for n, (item_kind, item) in enumerate(zip(kinds, data, strict=True))
        ]
        return items if isinstance(kind, inspect.ListType) else tuple(items)

    def _scalar(self, kind: inspect.Type, data: Any, path: str) -> Any:
        value = _SCALARS[type(kind)](kind, data)
        return value if known(value) else self._expected(kind, data, path)


def _boolean(_: Any, data: Any) -> Any:
    return data if isinstance(data, bool) else UNSET


def _integer(kind: inspect.IntType, data: Any) -> Any:
    whole = isinstance(data, int) and not isinstance(data, bool)
    return data if whole and _within(kind, data) else UNSET


def _number(kind: inspect.FloatType, data: Any) -> Any:
    if isinstance(data, bool) or not isinstance(data, int | float):
        return UNSET
    try:
        value = float(data)
    except OverflowError:
        return UNSET
    return value if math.isfinite(value) and _within(kind, value) else UNSET


def _text(kind: inspect.StrType, data: Any) -> Any:
    fits = (
        isinstance(data, str)
        and len(data) >= (kind.min_length or 0)
        and (kind.max_length is None or len(data) <= kind.max_length)
        and (kind.pattern is None or re.search(kind.pattern, data) is not None)
    )
    return data if fits else UNSET


def _literal(kind: inspect.LiteralType, data: Any) -> Any:
    # 1 == True in Python, not in a file.
    return next((v for v in kind.values if type(v) is type(data) and v == data), UNSET)


def _enumerated(kind: inspect.EnumType, data: Any) -> Any:
    return next((v for v in kind.cls if type(v.value) is type(data) and v.value == data), UNSET)


def _nothing(_: Any, data: Any) -> Any:
    return None if data is None else UNSET


_SCALARS: dict[type[inspect.Type], Callable[[Any, Any], Any]] = {
    inspect.BoolType: _boolean,
    inspect.IntType: _integer,
    inspect.FloatType: _number,
    inspect.StrType: _text,
    inspect.LiteralType: _literal,
    inspect.EnumType: _enumerated,
    inspect.NoneType: _nothing,
}


def _within(kind: inspect.IntType | inspect.FloatType, value: float) -> bool:
    return (
        (kind.gt is None or value > kind.gt)
        and (kind.ge is None or value >= kind.ge)
        and (kind.lt is None or value < kind.lt)
        and (kind.le is None or value <= kind.le)
        and (kind.multiple_of is None or value % kind.multiple_of == 0)
    )


def phrase(kind: inspect.Type) -> str:
    """What a value of this type is called in a message: ``a number > 0``, ``one of a, b``."""
    match kind:
        case inspect.Metadata():
            return str((kind.extra_json_schema or {}).get("description", phrase(kind.type)))
        case inspect.BoolType():
            return "true or false"
        case inspect.IntType():
            return "an integer" + _range(kind)
        case inspect.FloatType():
            return "a number" + _range(kind)
        case inspect.StrType():
            return "text" + (f" matching {kind.pattern}" if kind.pattern else "")
        case inspect.LiteralType():
            return _choice([str(value) for value in kind.values])
        case inspect.EnumType():
            return _choice([str(member.value) for member in kind.cls])
        case inspect.TupleType():
            numeric = all(isinstance(item, inspect.FloatType) for item in kind.item_types)
            return f"a list of {len(kind.item_types)}" + (" numbers" if numeric else "")
        case inspect.VarTupleType() | inspect.ListType():
            return "a list" + (f" of at least {kind.min_length}" if kind.min_length else "")
        case inspect.UnionType():
            return " or ".join(dict.fromkeys(phrase(member) for member in kind.types))
        case inspect.NoneType():
            return "nothing"
        case _:
            return "a block of keys"


def _choice(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"


def _range(kind: inspect.IntType | inspect.FloatType) -> str:
    if kind.ge is not None and kind.le is not None:
        limits = [f"from {kind.ge:.12g} to {kind.le:.12g}"]
    else:
        bounds = [(">", kind.gt), (">=", kind.ge), ("<", kind.lt), ("<=", kind.le)]
        limits = [f"{sign} {bound:.12g}" for sign, bound in bounds if bound is not None]
    steps = f" in steps of {kind.multiple_of:.12g}" if kind.multiple_of is not None else ""
    return (" " + " and ".join(limits) if limits else "") + steps


def _hint(kind: inspect.Type, data: Any) -> str:
    """How to write what was probably meant."""
    bare = _bare(kind)
    if isinstance(bare, inspect.StrType) and isinstance(data, bool | int | float):
        return " (put it in quotes)"
    numeric = isinstance(bare, inspect.IntType | inspect.FloatType)
    if numeric and isinstance(data, str) and reads_as_number(data.strip()):
        return " (take away the quotes)"
    return ""


def _bare(kind: inspect.Type) -> inspect.Type:
    return kind.type if isinstance(kind, inspect.Metadata) else kind


def _join(path: str, key: str) -> str:
    name = key if key.isprintable() and key else shown(key)
    return f"{path}.{name}" if path else name
