"""What host and worker say to each other: msgpack messages over a SOCK_SEQPACKET pair."""

import socket

import msgspec

from gateway.config import Config
from gateway.messages import Checkpoint, FilterOutput, Measurement, SavedState

MAX_MESSAGE = 1 << 18
BUFFER_BYTES = 1 << 20


class Start(msgspec.Struct, frozen=True, array_like=True, tag="start"):
    """First word to a worker: what to run and where to go on from."""

    config: Config
    rate_hz: float
    resume: Checkpoint | SavedState | None


class Compiling(msgspec.Struct, frozen=True, array_like=True, tag="compiling"):
    """Word of a worker that found no compiled filter in the cache: half a minute until `Ready`."""


class Ready(msgspec.Struct, frozen=True, array_like=True, tag="ready"):
    """First word of a worker otherwise: compiled and waiting for measurements."""


ToWorker = Start | Measurement
ToHost = Compiling | Ready | FilterOutput

_encoder = msgspec.msgpack.Encoder()
_to_worker: msgspec.msgpack.Decoder[ToWorker] = msgspec.msgpack.Decoder(ToWorker)
_to_host: msgspec.msgpack.Decoder[ToHost] = msgspec.msgpack.Decoder(ToHost)


def encode(message: ToWorker | ToHost) -> bytes:
    """Bytes of one message."""
    return _encoder.encode(message)


def read_in_worker(data: bytes) -> ToWorker:
    """A message of the host."""
    return _to_worker.decode(data)


def read_in_host(data: bytes) -> ToHost:
    """A message of the worker."""
    return _to_host.decode(data)


def pair() -> tuple[socket.socket, socket.socket]:
    """Both ends of a channel: the host's, non-blocking, and the worker's."""
    host, worker = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (host, worker):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    host.setblocking(False)
    return host, worker
