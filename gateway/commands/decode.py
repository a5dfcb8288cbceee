"""`usblnav decode`: raw bytes to JSON lines."""

import os
import stat
import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from io import FileIO
from pathlib import Path

from msgspec import Struct, inspect

from drivers import registry
from drivers.codec import Codec
from drivers.hosttime import now_ns
from drivers.links.base import Chunk, reason
from drivers.records import Record, Rejected, to_json
from drivers.senders import SenderCounts, Senders
from drivers.settings import UdpLink
from gateway.commands.linktext import read_link
from gateway.commands.tap import listen
from gateway.errors import ConfigError, UsblnavError, cause
from gateway.schema import build
from gateway.yamlfile import read_value

CHUNK = 65536


def run(arguments: Namespace) -> int:
    """Decode the file to its end, or a line until told to stop; the totals go to standard error."""
    try:
        codec = registry.lookup(arguments.codec)
    except (registry.UnknownCodecError, registry.CodecImportError) as error:
        raise ConfigError(f"--codec: {error}") from error
    options = _options(codec, arguments.options)
    printer = _Printer(Senders(partial(codec.decoder, options)))
    if arguments.link is not None:
        return _line(arguments, printer)
    if arguments.file is None or arguments.raw is not None:
        raise ConfigError("--raw: only with --link" if arguments.raw else "FILE or --link: missing")
    try:
        for data, t_rx_ns in _arrivals(arguments.file, as_hex=arguments.hex):
            printer.take(data, t_rx_ns)
    except KeyboardInterrupt:
        return 130
    finally:
        printer.close()
    return 0


def _line(arguments: Namespace, printer: "_Printer") -> int:
    """Listen to a line."""
    if arguments.file is not None or arguments.hex:
        raise ConfigError("--link: not together with FILE or --hex")
    settings = read_link(arguments.link, "--link")
    told = isinstance(settings, UdpLink)  # of others there is one sender
    with ExitStack() as stack:
        keep = None if arguments.raw is None else stack.enter_context(_kept(arguments.raw))

        def take(chunk: Chunk) -> None:
            if keep is not None:
                keep(chunk.data)
            printer.take(chunk.data, chunk.t_rx_ns, chunk.source if told else "")

        try:
            counts = listen(settings, take, _say)
        finally:
            printer.close()
    lost = f", {counts.kernel_dropped} datagrams lost in between" if counts.kernel_dropped else ""
    refused = f", {counts.refused} datagrams refused" if counts.refused else ""
    _say(f"{counts.bytes} bytes in {counts.chunks} chunks{lost}{refused}")
    for name, sender in printer.senders.items() if told else ():
        rejected = f"{sender.rejected_bytes} rejected"
        _say(f"{name}: {sender.bytes} bytes, of which {rejected}; {sender.records} records")
    return 0


@contextmanager
def _kept(path: Path) -> Iterator[Callable[[bytes], object]]:
    """Write bytes to a new file as they come."""
    try:
        with path.open("xb", buffering=0) as file:

            def write(data: bytes) -> None:
                try:
                    file.write(data)
                except OSError as error:
                    raise UsblnavError(f"{path}: {reason(error)}") from error

            yield write
    except FileExistsError as error:
        raise ConfigError(f"--raw: {path}: is there already") from error
    except OSError as error:
        raise ConfigError(f"--raw: {path}: {reason(error)}") from error


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
        raise ConfigError(f"{name}: {cause(error)}") from error
    with stream:
        at_rest = stat.S_ISREG(os.fstat(stream.fileno()).st_mode)
        chunks = iter(lambda: stream.read(CHUNK), b"")
        for data in _from_hex(chunks, name) if as_hex else chunks:
            yield data, 0 if at_rest else now_ns()


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


class _Printer:
    """Records as JSON lines, and what they amount to."""

    def __init__(self, senders: Senders) -> None:
        self._senders = senders
        self._totals: Counter[str] = Counter()

    @property
    def senders(self) -> dict[str, SenderCounts]:
        """What became of the bytes of each."""
        others = self._senders.others
        return self._senders.counts | ({"others": others} if others.bytes else {})

    def take(self, data: bytes, t_rx_ns: int, source: str = "") -> None:
        """Print what a chunk completes; of one of several senders, with who it was."""
        self._print(self._senders.feed(data, t_rx_ns, source), source)

    def close(self) -> None:
        """Print what waits, and the totals to standard error."""
        self._print(self._senders.close(), "")
        totals = (f"{n} {kind}" for kind, n in sorted(self._totals.items()))
        _say(", ".join(totals) or "no records")

    def _print(self, records: Iterable[Record | Rejected], source: str) -> None:
        of = f',"source":"{source}"}}'.encode() if source else b"}"
        for record in records:
            kind = str(record.__struct_config__.tag)
            if isinstance(record, Rejected):
                kind = f"rejected ({record.reason})"
            self._totals[kind] += 1
            sys.stdout.buffer.write(to_json(record)[:-1] + of + b"\n")
        sys.stdout.buffer.flush()


def _say(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
