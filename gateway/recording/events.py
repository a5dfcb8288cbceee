"""What a recording is made of, as the daemon hands it to the writer and a reader gives it back."""

from typing import Literal

import msgspec

from gateway.clock.utc import UtcSample
from gateway.config import Config, Recording
from gateway.resume import COLD, Resume

Topic = Literal["nav", "innovation", "calibration", "target", "status"]


class Raw(msgspec.Struct, frozen=True, tag="raw"):
    """A chunk of a device's bytes, as the device's intake was fed with it, and who sent it."""

    device: str
    t_rx_ns: int
    data: bytes
    source: str = ""


class LineEvent(msgspec.Struct, frozen=True, tag="line"):
    """A device's line was opened (``up``), or lost."""

    device: str
    t_ns: int
    up: bool


class Pulse(msgspec.Struct, frozen=True, tag="pulse"):
    """An edge of a device's pulse per second, as the device's intake was told of it."""

    device: str
    t_ns: int


class Report(msgspec.Struct, frozen=True, tag="report"):
    """JSON of a report, as on Zenoh, and the Unix time for which it holds."""

    topic: Topic
    utc_ns: int
    data: bytes


Event = Raw | Pulse | LineEvent | UtcSample | Report


class Run(msgspec.Struct, frozen=True, array_like=True):
    """What is the same for all files of one run of the daemon.

    ``name`` tells runs apart; ``rate_hz`` is that of the solutions; ``resume`` is where it
    began.
    """

    name: str
    software: str
    rate_hz: float
    config: Config
    resume: Resume = COLD


class Orders(msgspec.Struct, frozen=True, array_like=True, tag="orders"):
    """First word to a writer: what to write where; the JSON schema of each report, by topic."""

    run: Run
    settings: Recording
    schemas: dict[Topic, bytes]


class Batch(msgspec.Struct, frozen=True, array_like=True, tag="batch"):
    """Consecutive events; they are numbered through the run, the first one ``first``.

    ``resume`` is the newest, from which a file that is begun now may be replayed by itself.
    """

    first: int
    events: list[Event]
    resume: Resume | None = None


class Saved(msgspec.Struct, frozen=True, array_like=True, tag="saved"):
    """Word of a writer: the events before this number are in the file."""

    end: int


class Fault(msgspec.Struct, frozen=True, array_like=True, tag="fault"):
    """Last word of a writer that cannot go on: one line that names the place and says why."""

    text: str


ToWriter = Orders | Batch
ToRecorder = Saved | Fault

encode = msgspec.msgpack.Encoder().encode
read_in_writer = msgspec.msgpack.Decoder[ToWriter](ToWriter).decode
read_in_recorder = msgspec.msgpack.Decoder[ToRecorder](ToRecorder).decode
