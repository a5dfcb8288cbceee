"""Where bytes come from or go to, as written in a `link:` block of the configuration."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Port = Annotated[int, Meta(ge=1, le=65535)]


class Rs485(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the port's driver turns a two-wire bus round; RTS switches the transmitter on."""

    rts_on_send: bool = True
    """Level of RTS while sending; the other one while receiving."""
    delay_before_ms: Annotated[int, Meta(ge=0, le=1000)] = 0
    delay_after_ms: Annotated[int, Meta(ge=0, le=1000)] = 0
    hears_itself: bool = False


class SerialLink(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="serial"
):
    """A serial line; ``port`` is a device path, best of /dev/serial/by-id or of the udev rule.

    ``dtr`` and ``rts`` are the levels while it is open: some adapters are powered by them, some
    instruments are reset.
    """

    port: str
    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 9600
    data_bits: Literal[7, 8] = 8
    parity: Literal["none", "even", "odd", "mark", "space"] = "none"
    stop_bits: Literal[1, 2] = 1
    flow: Literal["none", "rts_cts", "xon_xoff"] = "none"
    dtr: bool = True
    rts: bool = True
    rs485: Rs485 | None = None

    @property
    def bits_per_byte(self) -> int:
        """What a byte takes of the line: start, data, parity and stop bits."""
        return 1 + self.data_bits + (self.parity != "none") + self.stop_bits


class UdpLink(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="udp"):
    """Datagrams in (``bind``, optionally joining the multicast ``group``) or out (``host``).

    ``allow`` lists the source addresses or networks that are listened to; empty means all.
    """

    port: Port
    bind: str = "127.0.0.1"
    host: str = "127.0.0.1"
    group: str | None = None
    allow: tuple[str, ...] = ()


class TcpLink(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="tcp"):
    """A TCP client towards ``host``; as an output, a server that listens on ``bind``.

    A server that answers nothing for ``dead_after_s``, not even the kernel's probes, is dead.
    """

    port: Port
    host: str = "127.0.0.1"
    bind: str = "127.0.0.1"
    dead_after_s: Annotated[int, Meta(ge=4, le=3600)] = 10


class PtyLink(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="pty"):
    """A pseudo terminal of this machine, found under ``symlink`` (outputs only)."""

    symlink: Annotated[str, Meta(min_length=1)]


class StdioLink(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="stdout"
):
    """Standard output (outputs only)."""


Link = SerialLink | UdpLink | TcpLink
OutputLink = SerialLink | UdpLink | TcpLink | PtyLink | StdioLink
