"""One fuzzed input: options and a stream cut into chunks, and what must hold for any decoder."""

import gc
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from itertools import product
from math import isfinite
from random import Random
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any, NamedTuple, Self

import msgspec
from msgspec import inspect

from drivers import registry
from drivers.codec import Decoder
from drivers.records import OtherFrame, Record, Rejected
from tests.drivers.streams import bare, check_tiling, decoder, run

HEAD = 3
"""Bytes before the stream: which options (u16), how it is cut."""
REMEMBERS = frozenset({"stim300", "anpp", "pd6"})
"""Codecs to which a frame alone may say less than among those before it."""
FLOOD = 24
"""How many chunks of what an input says over and over are fed to see that nothing piles up."""
FLOOD_BYTES = 4096
"""Of each of them; all together more than a decoder may hold."""
WEIGHT_MAX = 40_000
"""Bytes a decoder may come to hold: a frame of eight thousand, twice, and what it notes of it."""


class Trial(NamedTuple):
    """What an input says to do."""

    codec: str
    options: msgspec.Struct
    chunks: list[bytes]

    @classmethod
    def of(cls, codec: str, data: bytes) -> Self:
        """Any bytes are a trial."""
        head = data[:HEAD].ljust(HEAD, b"\0")
        choices = every_options(codec)
        cut = head[2]
        chunks = list(cut_up(data[HEAD:], cut))
        options = choices[int.from_bytes(head[:2], "little") % len(choices)]
        return cls(codec, options, chunks)


def trial_of(stream: bytes, options: int = 0, cut: int = 1) -> bytes:
    """The input that feeds a stream; cut 0 is byte by byte, 1 as a whole."""
    return options.to_bytes(2, "little") + bytes([cut]) + stream


def cut_up(stream: bytes, cut: int) -> Iterator[bytes]:
    """Chunks, as many different ways as a byte can name."""
    longest = (3, 17, 90)[cut % 3]
    lengths = Random(cut)
    at = 0
    while at < len(stream):
        length = (1, len(stream))[cut] if cut < 2 else lengths.randint(1, longest)
        yield stream[at : at + length]
        at += length


@cache
def every_options(codec: str) -> tuple[msgspec.Struct, ...]:
    """Options of a codec in all their combinations, those that it takes; the default first."""
    kind = registry.lookup(codec).options
    info = inspect.type_info(kind)
    assert isinstance(info, inspect.StructType)
    default = msgspec.to_builtins(kind())
    names = [field.encode_name for field in info.fields]
    values = [_distinct([default[f.encode_name], *_others(f.type)]) for f in info.fields]
    taken: list[msgspec.Struct] = []
    for combination in product(*values):
        try:
            taken.append(msgspec.convert(dict(zip(names, combination, strict=True)), kind))
        except msgspec.ValidationError:
            continue
    return tuple(taken)


def _distinct(values: list[Any]) -> list[Any]:
    return [value for at, value in enumerate(values) if value not in values[:at]]


def _others(kind: inspect.Type) -> list[Any]:
    match kind:
        case inspect.LiteralType():
            return list(kind.values)
        case inspect.BoolType():
            return [False, True]
        case inspect.IntType():
            return [100]
        case inspect.FloatType():
            return [0.01, 45.0]
        case inspect.StrType():
            return ["a b"]
        case inspect.UnionType():
            return [other for part in kind.types for other in _others(part)]
        case inspect.NoneType():
            return [None]
    return []


def check(codec: str, data: bytes) -> None:
    """Raise AssertionError, or whatever the decoder raises, if the input shows a fault."""
    trial = Trial.of(codec, data)
    records = run(codec, trial.chunks, trial.options)
    for record in records:
        assert not isinstance(record, Rejected) or record.data, "nothing was rejected"
        assert _is_finite(record), f"not a number in {record}"
        if not isinstance(record, Rejected):
            with suppress(ValueError):
                registry.lookup(codec).encode(record, trial.options)
    whole = run(codec, [b"".join(trial.chunks)], trial.options)
    assert bare(records) == bare(whole), "chunking changes the records"
    check_tiling(codec, trial.chunks, records, trial.options, alone=codec not in REMEMBERS)


def check_flood(codec: str, data: bytes) -> None:
    """Raise AssertionError if an input said over and over piles up in the decoder.

    Apart from `check`, for it takes as long as a hundred of them.
    """
    trial = Trial.of(codec, data)
    reader = decoder(codec, trial.options)
    fresh = weight(reader)
    stream = b"".join(trial.chunks)
    chunk = bytearray(stream * (FLOOD_BYTES // max(1, len(stream)) + 1))
    for i in range(FLOOD):
        list(reader.feed(bytes(chunk), i))
    grown = weight(reader) - fresh
    assert grown <= WEIGHT_MAX, f"holds {grown} bytes more than a fresh decoder"


def _is_finite(record: Record | Rejected) -> bool:
    if isinstance(record, Rejected | OtherFrame):
        return True
    waiting: list[object] = [msgspec.to_builtins(record)]
    while waiting:
        match waiting.pop():
            case float(value) if not isfinite(value):
                return False
            case dict(held):
                waiting += held.values()
            case list(held) | tuple(held):
                waiting += held
    return True


def weight(decoder: Decoder) -> int:
    """Bytes of all that a decoder holds: its own state, not the code it shares."""
    seen: set[int] = set()
    waiting: list[object] = [decoder]
    total = 0
    while waiting:
        held = waiting.pop()
        if id(held) in seen or isinstance(held, type | ModuleType | BuiltinFunctionType):
            continue
        seen.add(id(held))
        total += sys.getsizeof(held)
        if isinstance(held, FunctionType):
            waiting += held.__closure__ or ()
        else:
            waiting += gc.get_referents(held)
    return total
