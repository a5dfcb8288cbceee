"""`usblnav codecs`: the wire formats, their devices and options."""

import json
import sys
import textwrap
from argparse import Namespace
from typing import Any

from msgspec import NODEFAULT, inspect

from drivers import registry
from drivers.codec import Codec
from gateway.schema import phrase, shown


def run(arguments: Namespace) -> int:
    """Print every codec, built in or installed beside the program; what is amiss goes to stderr."""
    codecs, broken = [], registry.conflicts()
    for name in registry.names():
        try:
            codecs.append(registry.lookup(name))
        except registry.CodecImportError as error:
            broken.append(str(error))
    if arguments.json:
        print(json.dumps([_entry(codec) for codec in codecs], indent=2))
    else:
        for codec in codecs:
            _print_entry(codec)
    for fault in broken:
        sys.stderr.write(f"usblnav: {fault}\n")
    return 0


def _print_entry(codec: Codec) -> None:
    also = f", with {', '.join(codec.also)}" if codec.also else ""
    print(f"{codec.name}  ({codec.kind}{also})")
    print(textwrap.fill(codec.devices, 96, initial_indent="    ", subsequent_indent="    "))
    for field in _fields(codec):
        print(f"    -o {field.encode_name}=  {phrase(field.type)}; {_default(field)}")


def _entry(codec: Codec) -> dict[str, Any]:
    options = {
        field.encode_name: {
            "expects": phrase(field.type),
            "required": field.required,
            **({} if field.required or field.default is NODEFAULT else {"default": field.default}),
        }
        for field in _fields(codec)
    }
    about = {"name": codec.name, "kind": codec.kind, "also": codec.also}
    return {**about, "devices": codec.devices, "options": options}


def _fields(codec: Codec) -> tuple[inspect.Field, ...]:
    kind = inspect.type_info(codec.options)
    return kind.fields if isinstance(kind, inspect.StructType) else ()


def _default(field: inspect.Field) -> str:
    if field.required:
        return "required"
    default = field.default if field.default is not NODEFAULT else field.default_factory()
    if isinstance(default, str):
        return f"default {default}"
    if isinstance(default, tuple):
        return f"default [{', '.join(map(str, default))}]"
    return f"default {shown(default)}"
