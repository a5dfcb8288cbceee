"""The seam between bytes and records: what every wire format provides."""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import wraps
from typing import Any, Literal, Protocol

import msgspec

from drivers.records import OtherFrame, Record, Rejected

Kind = Literal["imu", "usbl", "lbl", "gnss", "depth", "dvl", "heading", "any"]


class Decoder(Protocol):
    """Turns bytes into records. Holds a buffer, does no I/O, never raises on bad input.

    Every input byte ends in exactly one record (or waits in the bounded buffer); after a bad check
    one byte is dropped and the search goes on, so that a corrupted frame costs only itself.
    """

    def feed(self, data: bytes, t_rx_ns: int) -> Iterable[Record | Rejected]:
        """Take one chunk as it arrived, with its receive stamp; give the records it completes."""
        ...

    def close(self) -> Iterable[Record | Rejected]:
        """End of the stream: what still waits in the buffer, as rejected bytes."""
        ...


class NoOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Options of a codec that has none."""


@dataclass(frozen=True)
class Counting:
    """What an instrument's counts mean, which its frames cannot say.

    Attributes
    ----------
    sequence_modulus
        ``sequence`` is 0 .. modulus-1; None where the frames are not counted.
    sequence_s
        Seconds from one count to the next; None where it counts the frames themselves.
    time_modulus_s
        ``t_device_s`` begins anew at 0 when it gets there; None if it never does.
    time_step_s
        How coarsely ``t_device_s`` is told (s); None where no frame tells a time.
    """

    sequence_modulus: int | None = None
    sequence_s: float | None = None
    time_modulus_s: float | None = None
    time_step_s: float | None = 0.0


@dataclass(frozen=True)
class Codec:
    """A wire format: data, not a class to derive from.

    Attributes
    ----------
    options
        msgspec Struct (frozen, unknown fields forbidden) of what the frame itself does not say.
    decoder
        Makes a fresh decoder for an instance of `options`.
    encode
        Pure ``(record, options) -> bytes`` of one frame; emulator and tests speak through it. An
        `OtherFrame` is written as it is, by any codec; ValueError is raised for what the format
        cannot say, a number too large for its field included.
    counting
        How its sequence numbers and its time run.
    also
        The kinds of what else is in its stream, for devices that share the line.
    powered_up
        Pure ``(options) -> bytes`` of what the instrument says of itself when it is switched on.
    """

    name: str
    kind: Kind
    devices: str
    options: type[msgspec.Struct]
    decoder: Callable[[Any], Decoder]
    encode: Callable[[Any, Any], bytes]
    counting: Counting = Counting()
    also: tuple[Kind, ...] = ()
    powered_up: Callable[[Any], bytes] = lambda _options: b""

    def __post_init__(self) -> None:
        object.__setattr__(self, "encode", _writing(self.name, self.encode))

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """What kinds of device it speaks for."""
        return (self.kind, *self.also)


def _writing(name: str, encode: Callable[[Any, Any], bytes]) -> Callable[[Any, Any], bytes]:
    @wraps(encode)
    def writing(record: Any, options: Any) -> bytes:
        if isinstance(record, OtherFrame):
            return record.data
        try:
            return encode(record, options)
        except (struct.error, OverflowError) as error:
            raise ValueError(f"{name} cannot say this {type(record).__name__}: {error}") from error

    return writing
