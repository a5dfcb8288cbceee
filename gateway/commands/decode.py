"""`usblnav decode`: raw bytes to JSON lines."""

import os
import stat
import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterable, Iterator
from io import FileIO

from msgspec import Struct, inspect

from drivers import registry
from drivers.codec import Codec
from drivers.records import Record, Rejected, to_json
from gateway.errors import ConfigError, UsblnavError
from gateway.schema import build
from gateway.yamlfile import read_value

CHUNK = 65536


def run(arguments: Namespace) -> int:
    """Decode the file to its end; the totals go to standard error."""
    try:
        codec = registry.lookup(arguments.codec)
    except (registry.UnknownCodecError, registry.CodecImportError) as error:
        raise ConfigError(f"--codec: {error}") from error
    decoder = codec.decoder(_options(codec, arguments.options))
    totals: Counter[str] = Counter()
    try:
        for data, t_rx_ns in _arrivals(arguments.file, as_hex=arguments.hex):
            _print(decoder.feed(data, t_rx_ns), totals)
    except KeyboardInterrupt:
        return 130
    finally:
        _print(decoder.close(), totals)
        sys.stderr.write(_summary(totals) + "\n")
    return 0


def _options(codec: Codec, pairs: list[str]) -> Struct:
    kind = inspect.type_info(codec.options)
    fields = kind.fields if isinstance(kind, inspect.StructType) else ()
    texts = {field.encode_name for field in fields if isinstance(field.type, inspect.StrType)}
    given: dict[str, object] = {}
    faults: list[str] = []
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals:
            faults.append(f"{pair}: expected key=value")
        elif key in given:
            faults.append(f"{key}: given twice")
        else:
            given[key] = text if key in texts else read_value(text)
    options = build(codec.options, given, faults)
    if options is None or faults:
        raise ConfigError([f"-o {fault}" for fault in faults])
    return options


def _arrivals(file: str, *, as_hex: bool) -> Iterator[tuple[bytes, int]]:
    """Chunks as they come, each with its time; a file at rest has none."""
    name = "standard input" if file == "-" else file
    try:
        stream = FileIO(sys.stdin.fileno(), closefd=False) if file == "-" else FileIO(file)
    except OSError as error:
        raise ConfigError(f"{name}: {(error.strerror or str(error)).lower()}") from error
    with stream:
        at_rest = stat.S_ISREG(os.fstat(stream.fileno()).st_mode)
        chunks = iter(lambda: stream.read(CHUNK), b"")
        for data in _from_hex(chunks, name) if as_hex else chunks:
            yield data, 0 if at_rest else time.monotonic_ns()


def _from_hex(chunks: Iterable[bytes], name: str) -> Iterator[bytes]:
    half = b""
    line = 1
    for chunk in chunks:
        for number, text in enumerate(chunk.split(b"\n"), line):
            digits = half + b"".join(text.split())
            whole = len(digits) & ~1
            try:
                data = bytes.fromhex(digits[:whole].decode("ascii"))
                int(digits[whole:] or b"0", 16)
            except ValueError as error:
                raise UsblnavError(f"{name}: line {number}: not hexadecimal") from error
            half = digits[whole:]
            if data:
                yield data
        line += chunk.count(b"\n")
    if half:
        raise UsblnavError(f"{name}: ends in half a byte")


def _print(records: Iterable[Record | Rejected], totals: Counter[str]) -> None:
    for record in records:
        kind = str(record.__struct_config__.tag)
        totals[f"rejected ({record.reason})" if isinstance(record, Rejected) else kind] += 1
        sys.stdout.buffer.write(to_json(record) + b"\n")
    sys.stdout.buffer.flush()


def _summary(totals: Counter[str]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in sorted(totals.items())) or "no records"
