"""Orders and batches for a writer of recordings, and what other people's reader finds in a file."""

from pathlib import Path
from typing import Any

import msgspec
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from gateway.clock.utc import UtcSample
from gateway.config import Config, Recording
from gateway.emulator import twin
from gateway.outputs.schema import NavReport, nav_report
from gateway.recording.events import Batch, Event, Orders, Raw, Report, Run
from gateway.recording.host import TYPES
from gateway.recording.reader import RecordedRun
from gateway.recording.writer import Tape
from gateway.schema import build
from tests.gateway.emulated import demo_data, make
from tests.gateway.test_outputs_schema import OFFSET_NS, solution

T0_NS = 5_000_000_000
NAV: NavReport = nav_report(solution(), OFFSET_NS)


def config() -> Config:
    """That of the packaged scenario."""
    faults: list[str] = []
    built = build(Config, twin.gateway_config(make(demo_data())), faults)
    assert built is not None, faults
    return built


def orders(folder: Path, run: str = "run", **settings: Any) -> Orders:
    """What a writer is told first."""
    schemas = {topic: msgspec.json.encode(msgspec.json.schema(t)) for topic, t in TYPES.items()}
    about = Run(run, "usblnav 1.2.3", 10.0, config())
    return Orders(about, Recording(folder=str(folder), **settings), schemas)


def utc(n: int = 0) -> UtcSample:
    return UtcSample(T0_NS + n, OFFSET_NS)


def raw(n: int, size: int = 40) -> Raw:
    """A chunk of its own kind, one every ms."""
    return Raw("usbl0", T0_NS + n * 1_000_000, n.to_bytes(8, "little") * (size // 8))


def nav(n: int) -> Report:
    report = msgspec.structs.replace(NAV, utc_ns=NAV.utc_ns + n * 1_000_000, fixes_used=n)
    return Report("nav", report.utc_ns, msgspec.json.encode(report))


def batches(events: list[Event], per_batch: int = 10) -> list[Batch]:
    return [Batch(k, events[k : k + per_batch]) for k in range(0, len(events), per_batch)]


def files(folder: Path) -> list[Path]:
    """The recordings in the order of their names."""
    return sorted(folder.glob("*.mcap"))


def events_in(*paths: Path) -> list[Event]:
    return list(RecordedRun(paths).events())


def topics(path: Path) -> dict[str, int]:
    """Messages of each topic, by the index of a file that was closed."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counts = summary.statistics.channel_message_counts
        return {summary.channels[channel].topic: n for channel, n in counts.items()}


def records_in(path: Path) -> list[Any]:
    """Everything in a file that was closed, one record after the other, with its checksums."""
    with path.open("rb") as file:
        return list(StreamReader(file, validate_crcs=True).records)


class Watch:
    """Clocks in the test's hand: one that only grows, one that is set."""

    now = 0.0
    unix = 1_780_000_000.0


def tape(watch: Watch, folder: Path, **settings: object) -> Tape:
    return Tape(orders(folder, **settings), lambda: watch.now, lambda: watch.unix)


def write(to: Tape, events: list[Event], part: slice = slice(None)) -> None:
    for batch in batches(events)[part]:
        to.take(batch)
        assert to.flush() == batch.first + len(batch.events)
