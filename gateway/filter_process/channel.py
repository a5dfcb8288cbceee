"""What host, template and worker say to each other: msgpack messages over SOCK_SEQPACKET pairs."""

import socket

import msgspec

from gateway.config import Config
from gateway.messages import Checkpoint, FilterOutput, Measurement, SavedState

MAX_MESSAGE = 1 << 18


class Prepare(msgspec.Struct, frozen=True, array_like=True, tag="prepare"):
    """First word to a template: what its workers will run."""

    config: Config
    rate_hz: float


class Fork(msgspec.Struct, frozen=True, array_like=True, tag="fork"):
    """Order to a template; with it come the worker's ends of its channel and `Progress`."""


class Compiling(msgspec.Struct, frozen=True, array_like=True, tag="compiling"):
    """Word of a template that must compile first: half a minute until `Ready`."""


class Ready(msgspec.Struct, frozen=True, array_like=True, tag="ready"):
    """Word of a template that has compiled and may be forked."""


class Born(msgspec.Struct, frozen=True, array_like=True, tag="born"):
    """Answer to a `Fork`; with it comes a file descriptor of the new process (pidfd)."""

    pid: int


class Ended(msgspec.Struct, frozen=True, array_like=True, tag="ended"):
    """A worker is no more; ``code`` is its exit code, or minus the signal that killed it."""

    pid: int
    code: int


class Many(msgspec.Struct, frozen=True, array_like=True, tag="many"):
    """Measurements that had to wait, in their order."""

    measurements: tuple[Measurement, ...]


class _Encoded(msgspec.Struct, frozen=True, array_like=True, tag="many"):
    """The same while it is written."""

    measurements: list[msgspec.Raw]


class Start(msgspec.Struct, frozen=True, array_like=True, tag="start"):
    """First word to a worker: where to go on from, and how many answers were heard since.

    One that is to go `one_by_one` shows what kills it.
    """

    resume: Checkpoint | SavedState | None = None
    heard: int = 0
    one_by_one: bool = False


ToTemplate = Prepare | Fork
FromTemplate = Compiling | Ready | Born | Ended
ToWorker = Start | Many | Measurement

Message = bytes | memoryview

_room = memoryview(bytearray(MAX_MESSAGE))
_encoder = msgspec.msgpack.Encoder()
_to_template: msgspec.msgpack.Decoder[ToTemplate] = msgspec.msgpack.Decoder(ToTemplate)
_from_template: msgspec.msgpack.Decoder[FromTemplate] = msgspec.msgpack.Decoder(FromTemplate)
_to_worker: msgspec.msgpack.Decoder[ToWorker] = msgspec.msgpack.Decoder(ToWorker)
_from_worker: msgspec.msgpack.Decoder[FilterOutput] = msgspec.msgpack.Decoder(FilterOutput)


def encode(message: ToTemplate | FromTemplate | ToWorker | FilterOutput) -> bytes:
    """Bytes of one message."""
    return _encoder.encode(message)


def receive(channel: socket.socket) -> memoryview:
    """The next message, to be read before the next call; empty when the other end has closed.

    Into the same room each time: 60 us faster than asking for fresh room of that size.
    """
    return _room[: channel.recv_into(_room)]


def encode_many(measurements: list[bytes]) -> bytes:
    """Bytes of one message with some measurements, each of which is encoded already."""
    if len(measurements) == 1:
        return measurements[0]
    return _encoder.encode(_Encoded([msgspec.Raw(data) for data in measurements]))


def read_in_template(data: bytes) -> ToTemplate:
    """A message of the host."""
    return _to_template.decode(data)


def read_of_template(data: bytes) -> FromTemplate:
    """A message of the template."""
    return _from_template.decode(data)


def read_in_worker(data: Message) -> ToWorker:
    """A message of the host."""
    return _to_worker.decode(data)


def read_of_worker(data: Message) -> FilterOutput:
    """A message of the worker."""
    return _from_worker.decode(data)
