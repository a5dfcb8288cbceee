"""One recording being written: whole chunks, each on its way to the disk before it is said."""

import os
from pathlib import Path
from typing import BinaryIO, cast

import msgspec
from mcap.writer import CompressionType, Writer

from gateway.clock.utc import UtcSample
from gateway.recording.events import Run
from gateway.recording.folder import PROFILE
from gateway.recording.schema import Form

CHUNK_BYTES = 96 * 1024
"""Of messages, before compression. Small: all of a chunk is lost with its end."""
RUN = "usblnav.run"
RESUME = "resume.msgpack"
CLOCKS = "clocks.msgpack"
CONFIG = "config.json"
"""Stands last of what a file begins with."""


class RecordingFile:
    """An MCAP file; the caller tells when to put on disk what it was given.

    Parameters
    ----------
    fd, path
        A new file.
    run
        What a replay must know; each file says it.
    sequence
        Number of the first event.
    utc
        The sample in force; None where it is to come.

    Raises
    ------
    OSError
        From every method, where the disk does not take what is written.
    """

    def __init__(self, fd: int, path: Path, run: Run, sequence: int, utc: UtcSample | None) -> None:
        self.path = path
        self._fd = fd
        self._disk = _Disk(fd)
        self._whole = 0
        self._channels: dict[str, int] = {}
        # What the library asks of a stream are write, tell and flush.
        self._writer = Writer(cast("BinaryIO", self._disk), CHUNK_BYTES, CompressionType.ZSTD)
        self._writer.start(PROFILE, run.software)
        about = {
            "run": run.name,
            "software": run.software,
            "rate_hz": repr(run.rate_hz),
            "sequence": str(sequence),
        }
        if utc is not None:
            about |= {"utc_from_ns": str(utc.t_ns), "utc_offset_ns": str(utc.offset_ns)}
        self._writer.add_metadata(RUN, about)
        for name, part in ((RESUME, run.resume.state), (CLOCKS, run.resume.clocks)):
            if part:
                data = msgspec.msgpack.encode(part)
                self._writer.add_attachment(0, 0, name, "application/msgpack", data)
        config = msgspec.json.encode(run.config)
        self._writer.add_attachment(0, 0, CONFIG, "application/json", config)

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._disk.written

    def knows(self, topic: str) -> bool:
        """Whether the topic was begun."""
        return topic in self._channels

    def begin(self, topic: str, form: Form) -> None:
        """Say how the messages of a topic are made."""
        schema = self._writer.register_schema(form.schema_name, form.schema_encoding, form.schema)
        self._channels[topic] = self._writer.register_channel(topic, form.encoding, schema)

    def write(self, topic: str, utc_ns: int, sequence: int, data: bytes) -> None:
        """Add a message of a topic that was begun."""
        t_ns = max(utc_ns, 0)
        self._writer.add_message(
            self._channels[topic], t_ns, data, t_ns, sequence=sequence & 0xFFFFFFFF
        )

    def flush(self) -> None:
        """Hand all messages to the operating system: from now on they outlive this process.

        A file that somebody has removed, or moved away, takes what is written without a word.
        """
        self._writer.flush()
        self._whole = self._disk.written
        if not self._is_there():
            raise OSError(f"{self.path.name} was removed under way")

    def _is_there(self) -> bool:
        """Whether its name still leads to it."""
        try:
            return os.path.samestat(self.path.stat(), os.fstat(self._fd))
        except FileNotFoundError:
            return False

    def sync(self) -> None:
        """See what was flushed onto the disk: from now on it outlives a power failure."""
        os.fdatasync(self._fd)

    def close(self) -> None:
        """End the file with its index."""
        self._writer.finish()
        self.sync()
        os.close(self._fd)

    def abandon(self) -> None:
        """Leave the file, whose disk has failed, at its last whole chunk; remove an empty one."""
        try:
            if self._whole:
                os.ftruncate(self._fd, self._whole)
            elif self._is_there():
                self.path.unlink()
        finally:
            os.close(self._fd)


class _Disk:
    """A file as the library wants it, which keeps nothing back."""

    def __init__(self, fd: int) -> None:
        self.written = 0
        self._fd = fd

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:
            done = os.write(self._fd, rest)
            rest = rest[done:]
            self.written += done
        return len(data)

    def tell(self) -> int:
        return self.written

    def flush(self) -> None:
        pass
