"""Recordings as the events they were made of, in the order in which the daemon took them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple, get_args

import msgspec
from mcap.exceptions import EndOfFile, UnsupportedCompressionError
from mcap.records import Attachment, Channel, Message, Metadata
from mcap.writer import MCAP0_MAGIC

from drivers.capture.files import CaptureError
from gateway.clock import Clocks
from gateway.clock.utc import UtcSample
from gateway.config import Config
from gateway.errors import ConfigError
from gateway.messages import SavedState
from gateway.recording.chunks import DAMAGE, Loss, Records, strict
from gateway.recording.events import Event, LineEvent, Pulse, Raw, Report, Topic
from gateway.recording.file import CLOCKS, CONFIG, RESUME, RUN
from gateway.recording.schema import LINE, PULSE, RAW, UTC, read_raw
from gateway.resume import Resume
from gateway.schema import build

SUFFIX = ".mcap"
"""Of the names of recordings, also of one that lost its beginning."""
REPORTS: dict[str, Topic] = {f"/{topic}": topic for topic in get_args(Topic)}


@dataclass(slots=True)
class Damage:
    """A stretch of a file that was passed over: the events that are missing behind it.

    ``events`` is None where nothing behind it tells.
    """

    file: str
    at_byte: int
    bytes: int
    events: int | None = None

    def __str__(self) -> str:
        lost = "its events" if self.events is None else f"{self.events} events"
        return f"{self.file}: damaged at byte {self.at_byte}: {self.bytes} bytes, {lost} lost"


@dataclass(slots=True)
class RecordingCounts:
    """What was found in a recording.

    ``unclosed`` files have no end: their writer was killed, or their disk failed. ``missing``
    events were never written, or are in what is ``damaged``; ``repeated`` ones are in two files.
    """

    file_bytes: int = 0
    """Read so far."""
    files: int = 0
    unclosed: int = 0
    events: int = 0
    missing: int = 0
    repeated: int = 0
    damaged: list[Damage] = field(default_factory=list)


class _Part(NamedTuple):
    """One file and what its beginning says."""

    path: Path
    run: str
    sequence: int
    rate_hz: float
    software: str
    utc: UtcSample | None
    resume: dict[str, bytes]
    config: bytes


def is_recording(path: Path) -> bool:
    """Whether the file begins as MCAP does; OSError where it cannot be read."""
    if not path.is_file():
        return False  # of a pipe what is read is gone
    with path.open("rb") as file:
        return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


class RecordedRun:
    """The recording of one run of the daemon, in one file or several.

    Parameters
    ----------
    paths
        Its files, in any order.

    Raises
    ------
    CaptureError
        For a file that is no recording of the gateway's, and files of several runs, each named;
        and where of no file the beginning can be read, without which it tells nothing.

    Attributes
    ----------
    paths
        Its files in their order.
    rate_hz
        Of the solutions.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        found = [_tried(path) for path in paths]
        self._parts = sorted(
            (part for part in found if isinstance(part, _Part)), key=lambda part: part.sequence
        )
        unread = [error for error in found if isinstance(error, _UnreadableError)]
        if not self._parts:
            raise unread[0]
        first = self._parts[0]
        _refuse_several(self._parts)
        self.paths = [part.path for part in self._parts]
        self.rate_hz = first.rate_hz
        self.counts = RecordingCounts(files=len(found), missing=first.sequence)
        self.counts.damaged += [Damage(str(e.path), 0, e.path.stat().st_size) for e in unread]
        self._behind: Damage | None = None

    def config(self) -> Config:
        """The configuration that the daemon ran with.

        Raises
        ------
        ConfigError
            Where another version wrote it, of which this one does not know every key.
        CaptureError
            Where it is damaged.
        """
        part = self._parts[0]
        faults: list[str] = []
        try:
            plain = msgspec.json.decode(part.config)
        except (msgspec.MsgspecError, ValueError) as error:
            raise CaptureError(f"{part.path}: damaged (its configuration)") from error
        config = build(Config, plain, faults)
        if config is None:
            said = "; ".join(faults)
            raise ConfigError(f"{part.path}: recorded by {part.software}: {said}; give one with -c")
        return config

    def resume(self) -> Resume:
        """Where filter and clocks were at the beginning; recordings of before tell of no clocks.

        Raises
        ------
        CaptureError
            Where another version wrote it.
        """
        part = self._parts[0]
        state, clocks = part.resume.get(RESUME), part.resume.get(CLOCKS)
        try:
            return Resume(
                msgspec.msgpack.decode(state, type=SavedState) if state else None,
                msgspec.msgpack.decode(clocks, type=Clocks) if clocks else {},
            )
        except (msgspec.MsgspecError, ValueError) as error:
            raise CaptureError(
                f"{part.path}: recorded by {part.software}, whose state is another; give a"
                " configuration with -c to begin at its initial state"
            ) from error

    def events(self) -> Iterator[Event]:
        """Every event once, but for those in `counts.damaged`.

        Raises
        ------
        CaptureError
            Where what is whole cannot be understood.
        """
        due = self._parts[0].sequence
        for part in self._parts:
            if part.utc is not None:
                yield part.utc
            for number, event in self._numbered(part):
                ahead = (number - due + (1 << 31)) % (1 << 32) - (1 << 31)
                if ahead < 0:
                    self.counts.repeated += 1
                    continue
                self.counts.missing += ahead
                due += ahead + 1
                self._lost_in_damage(ahead)
                self.counts.events += 1
                yield event

    def _lost_in_damage(self, events: int) -> None:
        """Note what is missing behind the newest damage within a file, once."""
        if self._behind is not None:
            self._behind.events, self._behind = events, None

    def _numbered(self, part: _Part) -> Iterator[tuple[int, Event]]:
        """The events with their numbers modulo 2**32, without what the writer made of them."""
        topics: dict[int, str] = {}
        before = self.counts.file_bytes
        with part.path.open("rb") as file:
            records = Records(file, partial(self._note_damage, part.path))
            try:
                for record in records:
                    if isinstance(record, Message):
                        self.counts.file_bytes = before + file.tell()
                        topic = topics.get(record.channel_id)
                        if topic is not None:
                            yield record.sequence, _event(topic, record)
                    elif isinstance(record, Channel) and _is_of_events(record.topic):
                        topics[record.id] = record.topic
            except UnsupportedCompressionError as error:
                raise CaptureError(f"{part.path}: {error}") from error
            except (msgspec.MsgspecError, ValueError) as error:
                raise CaptureError(f"{part.path}: {_damaged(file.tell(), error)}") from error
        self.counts.unclosed += not records.is_closed

    def _note_damage(self, path: Path, loss: Loss) -> None:
        self._behind = Damage(str(path), *loss)
        self.counts.damaged.append(self._behind)


def _refuse_several(parts: Sequence[_Part]) -> None:
    """Raise with the files of each run, where they are of more than one."""
    runs: dict[str, list[Path]] = {}
    for part in sorted(parts, key=lambda part: part.path):
        runs.setdefault(part.run, []).append(part.path)
    if len(runs) > 1:
        spans = [
            paths[0].name + f" to {paths[-1].name}" * (len(paths) > 1) for paths in runs.values()
        ]
        raise CaptureError(
            f"{parts[0].path.parent}: recordings of {len(runs)} runs of the gateway, each read by"
            f" itself; name the files of one: {'; '.join(spans)}"
        )


class _UnreadableError(CaptureError):
    """A file whose beginning cannot be read."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: {why}")
        self.path = path


def _tried(path: Path) -> "_Part | _UnreadableError":
    """The beginning of a file, or why there is none."""
    try:
        return _begin(path)
    except _UnreadableError as error:
        return error


def _begin(path: Path) -> _Part:
    """What a file says before its first message."""
    about: dict[str, str] | None = None
    resume: dict[str, bytes] = {}
    with path.open("rb") as file:
        try:
            for record in strict(file).records:
                if isinstance(record, Metadata) and record.name == RUN:
                    about = record.metadata
                elif isinstance(record, Attachment) and record.name in (RESUME, CLOCKS):
                    resume[record.name] = record.data
                elif isinstance(record, Attachment) and record.name == CONFIG and about:
                    return _part(path, about, resume, record.data)
                elif isinstance(record, Message):
                    break
        except EndOfFile:
            raise _UnreadableError(path, "cut off before its first event") from None
        except DAMAGE as error:
            if about is None and file.tell() <= len(MCAP0_MAGIC):
                raise _UnreadableError(path, "not a recording (MCAP)") from error
            raise _UnreadableError(path, _damaged(file.tell(), error)) from error
    raise CaptureError(f"{path}: not a recording of usblnav")


def _part(path: Path, about: dict[str, str], resume: dict[str, bytes], config: bytes) -> _Part:
    try:
        utc = None
        if "utc_from_ns" in about:
            utc = UtcSample(int(about["utc_from_ns"]), int(about["utc_offset_ns"]))
        sequence, rate_hz = int(about["sequence"]), float(about["rate_hz"])
        return _Part(path, about["run"], sequence, rate_hz, about["software"], utc, resume, config)
    except (KeyError, ValueError) as error:
        raise _UnreadableError(path, "damaged (what it says of its run)") from error


def _is_of_events(topic: str) -> bool:
    return topic.startswith((RAW, LINE, PULSE)) or topic == UTC or topic in REPORTS


def _event(topic: str, message: Message) -> Event:
    if topic.startswith(RAW):
        return Raw(topic.removeprefix(RAW), *read_raw(message.data))
    if topic == UTC:
        return msgspec.json.decode(message.data, type=UtcSample)
    if topic.startswith(LINE):
        return msgspec.json.decode(message.data, type=LineEvent)
    if topic.startswith(PULSE):
        return msgspec.json.decode(message.data, type=Pulse)
    return Report(REPORTS[topic], message.log_time, message.data)


def _damaged(at_byte: int, error: Exception) -> str:
    return f"damaged before byte {at_byte} ({error or type(error).__name__})"
