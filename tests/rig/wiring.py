"""Which cables the rig has: memory, the sockets and ptys of this machine, or real ports."""

import re
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from tests.integration.cables import Cable, End, PtyEnd, SerialEnd, TcpEnd, UdpEnd

DEVICES = ("imu0", "usbl0")
BAUD = 115_200

_FORM = re.compile(r"(?:(\w+)=)?serial:([^,]+?)(?:,([^,]+?))?(?::(\d+))?")


class Ports(NamedTuple):
    """Real ports of one device's cable; the other devices go by UDP."""

    device: str
    near: str
    far: str
    baud: int


def ports(text: str) -> Ports:
    """Read the option: the emulator writes to the last port, the gateway reads the first.

    Raises
    ------
    ValueError
        For what is none.
    """
    found = _FORM.fullmatch(text)
    if found is None or found[1] not in (None, *DEVICES):
        raise ValueError(f"--rig: expected [imu0=|usbl0=]serial:PORT[,PORT][:BAUD], got {text!r}")
    device, far, near, baud = found.groups()
    return Ports(device or "usbl0", near or far, far, int(baud or BAUD))


def cables(kind: str | Ports, folder: Path, stack: ExitStack) -> dict[str, Cable]:
    """A cable for each device, plugged in."""
    made: dict[str, Callable[[str], End]] = {
        "udp": lambda _name: UdpEnd(),
        "tcp": lambda _name: TcpEnd(),
        "pty": lambda name: PtyEnd(folder / name),
    }

    def end(name: str) -> End:
        if isinstance(kind, Ports):
            if name == kind.device:
                return SerialEnd(kind.near, kind.far, kind.baud)
            return UdpEnd()
        return made[kind](name)

    wired = {name: stack.enter_context(Cable(end(name))) for name in DEVICES}
    for cable in wired.values():
        cable.end.plug()
    return wired
