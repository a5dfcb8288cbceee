"""The wires that instruments use."""

from typing import Annotated

from msgspec import Meta

from drivers.settings import Port
from gateway.config.block import Block


class UdpPort(Block, frozen=True, tag_field="type", tag="udp"):
    """One datagram a frame to ``host``:``port``."""

    port: Port
    host: str = "127.0.0.1"


class TcpServerPort(Block, frozen=True, tag_field="type", tag="tcp-server"):
    """A TCP server; every client gets the bytes sent while it is connected."""

    port: Port
    bind: str = "127.0.0.1"


class PtyPort(Block, frozen=True, tag_field="type", tag="pty"):
    """A pseudo terminal found under ``symlink``; bytes leave at the line rate."""

    symlink: str
    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 9600


class SerialPort(Block, frozen=True, tag_field="type", tag="serial"):
    """A real serial port, for hardware in the loop through a cable."""

    port: str
    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 9600


AnyPort = UdpPort | TcpServerPort | PtyPort | SerialPort
