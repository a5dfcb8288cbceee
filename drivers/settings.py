"""Where bytes come from or go to, as written in a `link:` block of the configuration."""

from typing import Annotated

import msgspec
from msgspec import Meta

Port = Annotated[int, Meta(ge=1, le=65535)]


class SerialLink(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="serial"
):
    """A serial line; ``port`` is a device path, best of /dev/serial/by-id or of the udev rule."""

    port: str
    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 9600


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
    """A TCP client towards ``host``; as an output, a server that listens on ``bind``."""

    port: Port
    host: str = "127.0.0.1"
    bind: str = "127.0.0.1"


class StdioLink(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="stdout"
):
    """Standard output (outputs only)."""


Link = SerialLink | UdpLink | TcpLink
OutputLink = SerialLink | UdpLink | TcpLink | StdioLink
