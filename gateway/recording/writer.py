"""The writer of recordings: takes events from the daemon, decodes and writes them.

Run as ``python -m gateway.recording.writer FD``. It gives up at the first fault of the disk: the
daemon starts it again, and hands it again what was not in a file. It ends, and ends its file, when
the daemon closes the channel, or dies; signals are the daemon's.
"""

import os
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import msgspec

from drivers.links.base import reason
from drivers.records import to_json
from drivers.senders import Senders
from gateway.clock.utc import UtcSample
from gateway.config import Config, wire_format
from gateway.filter_process.channel import MAX_MESSAGE
from gateway.machine.subordinate import serve_as
from gateway.outputs.schema import NavReport
from gateway.recording.events import (
    Batch,
    Fault,
    LineEvent,
    Orders,
    Pulse,
    Raw,
    Report,
    Saved,
    encode,
    read_in_writer,
)
from gateway.recording.file import RecordingFile
from gateway.recording.folder import Folder
from gateway.recording.schema import (
    LINE,
    LOCATION,
    LOCATION_FORM,
    PULSE,
    RAW,
    RAW_FORM,
    RECORDS,
    UTC,
    Form,
    json_form,
    location_message,
    raw_message,
)

FLUSH_S = 0.5
"""What no chunk was filled with goes into one after so long: more than this is not lost."""
SYNC_S = 5.0
LOCATION_PERIOD_NS = 200_000_000
NICENESS = 5
MB = 1_000_000


def main(fd: int) -> None:
    """Serve one daemon until it closes the channel."""
    serve_as("usblnav-record")
    with suppress(PermissionError):  # a courtesy, not worth a recording
        os.nice(NICENESS)
    with socket.socket(fileno=fd) as channel:
        orders = read_in_writer(channel.recv(MAX_MESSAGE))
        assert isinstance(orders, Orders)
        tape = Tape(orders)
        try:
            _serve(channel, tape)
        except OSError as error:
            tape.abandon()
            place = orders.settings.folder
            _say(channel, Fault(f"{place}: {reason(error)}"))


def _serve(channel: socket.socket, tape: "Tape") -> None:
    """Write what comes, until nothing more will."""
    flush_at = time.monotonic() + FLUSH_S
    while True:
        channel.settimeout(max(flush_at - time.monotonic(), 0.001))
        with suppress(TimeoutError):
            data = channel.recv(MAX_MESSAGE)
            if not data:
                return tape.close()
            batch = read_in_writer(data)
            assert isinstance(batch, Batch)
            tape.take(batch)
        if time.monotonic() >= flush_at:
            _say(channel, Saved(tape.flush()))
            flush_at = time.monotonic() + FLUSH_S


def _say(channel: socket.socket, word: Saved | Fault) -> None:
    """Tell the daemon, unless it is gone: what it has sent is still to be read."""
    with suppress(BrokenPipeError, ConnectionResetError):
        channel.settimeout(None)
        channel.send(encode(word))


class Tape:
    """Events into files, each begun when the one before is full or old.

    Parameters
    ----------
    clock, wall
        Seconds that only grow; Unix time, for the names of files.
    """

    def __init__(
        self,
        orders: Orders,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        settings = orders.settings
        self._orders = orders
        self._clock, self._wall = clock, wall
        self._folder = Folder(
            Path(settings.folder), orders.run.config.vehicle, round(settings.quota_mb * MB)
        )
        self._max_bytes = settings.max_file_mb * MB
        self._decoders = _decoders(orders.run.config) if settings.records else {}
        self._schemas = {t: msgspec.json.decode(s) for t, s in orders.schemas.items()}
        self._file: RecordingFile | None = None
        self._began = self._synced = 0.0
        self._end = 0
        self._utc: UtcSample | None = None
        self._resume = orders.run.resume
        self._tick: int | None = None

    def take(self, batch: Batch) -> None:
        """Write the events of a batch."""
        file = self._file or self._open(batch.first)
        self._resume = batch.resume or self._resume
        for sequence, event in enumerate(batch.events, batch.first):
            match event:
                case Raw():
                    self._raw(file, sequence, event)
                case Report():
                    self._report(file, sequence, event)
                case UtcSample():
                    self._utc = event
                    self._json(file, UTC, event.t_ns, sequence, event)
                case LineEvent():
                    self._json(file, f"{LINE}{event.device}", event.t_ns, sequence, event)
                case Pulse():
                    self._json(file, f"{PULSE}{event.device}", event.t_ns, sequence, event)
        self._end = batch.first + len(batch.events)

    def flush(self) -> int:
        """Hand everything to the operating system; give the number of the next event."""
        if self._file is not None:
            self._file.flush()
            now = self._clock()
            self._folder.make_room(self._file.size)
            if now - self._synced > SYNC_S:
                self._file.sync()
                self._synced = now
            old = now - self._began >= self._orders.settings.max_file_s
            if old or self._file.size >= self._max_bytes:
                self.close()
        return self._end

    def close(self) -> None:
        """End the file."""
        file, self._file = self._file, None
        if file is not None:
            file.close()

    def abandon(self) -> None:
        """Leave the file as whole as it can be."""
        if self._file is not None:
            with suppress(OSError):
                self._file.abandon()

    def _open(self, sequence: int) -> RecordingFile:
        fd, path = self._folder.create(self._wall())
        try:
            run = msgspec.structs.replace(self._orders.run, resume=self._resume)
            self._file = RecordingFile(fd, path, run, sequence, self._utc)
        except OSError:
            os.close(fd)
            path.unlink()
            raise
        self._began = self._synced = self._clock()
        return self._file

    def _raw(self, file: RecordingFile, sequence: int, raw: Raw) -> None:
        """The bytes, and the records that they complete."""
        topic, utc_ns = f"{RAW}{raw.device}", self._unix(raw.t_rx_ns)
        _begin(file, topic, RAW_FORM)
        file.write(topic, utc_ns, sequence, raw_message(raw.t_rx_ns, raw.data, raw.source))
        decoder = self._decoders.get(raw.device)
        if decoder is None:
            return
        for record in decoder.feed(raw.data, raw.t_rx_ns, raw.source):
            kind = type(record)
            topic = f"{RECORDS}{raw.device}/{kind.__struct_config__.tag}"
            if not file.knows(topic):
                file.begin(topic, json_form(kind.__name__, msgspec.json.schema(kind)))
            file.write(topic, utc_ns, sequence, to_json(record))

    def _report(self, file: RecordingFile, sequence: int, report: Report) -> None:
        """A report, and the place on the map that a solution is."""
        topic = f"/{report.topic}"
        if not file.knows(topic):
            schema, example = self._schemas[report.topic], msgspec.json.decode(report.data)
            file.begin(topic, json_form(report.topic.capitalize(), schema, example))
        file.write(topic, report.utc_ns, sequence, report.data)
        if report.topic == "nav" and report.utc_ns // LOCATION_PERIOD_NS != self._tick:
            self._tick = report.utc_ns // LOCATION_PERIOD_NS
            place = location_message(msgspec.json.decode(report.data, type=NavReport))
            if place is not None:
                _begin(file, LOCATION, LOCATION_FORM)
                file.write(LOCATION, report.utc_ns, sequence, place)

    def _json(
        self,
        file: RecordingFile,
        topic: str,
        t_ns: int,
        sequence: int,
        event: UtcSample | LineEvent | Pulse,
    ) -> None:
        """An event that is its own JSON."""
        if not file.knows(topic):
            kind = type(event)
            file.begin(topic, json_form(kind.__name__, msgspec.json.schema(kind)))
        file.write(topic, self._unix(t_ns), sequence, msgspec.json.encode(event))

    def _unix(self, t_ns: int) -> int:
        return t_ns + (self._utc.offset_ns if self._utc else 0)


def _begin(file: RecordingFile, topic: str, form: Form) -> None:
    if not file.knows(topic):
        file.begin(topic, form)


def _decoders(config: Config) -> dict[str, Senders]:
    """The decoders of each line, by the device that names it."""
    made: dict[str, Senders] = {}
    for name, *_ in config.lines:
        codec, options = wire_format(config.devices[name])
        made[name] = Senders(partial(codec.decoder, options))
    return made


if __name__ == "__main__":
    main(int(sys.argv[1]))
