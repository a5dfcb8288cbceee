"""A link as an argument: ``serial:/dev/ttyUSB0:9600``, ``udp:7001``, ``tcp:HOST:PORT``."""

from contextlib import suppress
from ipaddress import ip_address
from typing import Any

from drivers.settings import Link, SerialLink, TcpLink, UdpLink
from gateway.errors import ConfigError
from gateway.schema import build
from gateway.yamlfile import read_value

FORMS = "serial:DEVICE[:BAUD], udp:[ADDRESS:]PORT, tcp:HOST:PORT or {type: …} as in the file"

_KINDS: dict[str, type[Link]] = {"serial": SerialLink, "udp": UdpLink, "tcp": TcpLink}


def read_link(text: str, option: str) -> Link:
    """Read a link.

    Parameters
    ----------
    text
        One of `FORMS`. An address of a multicast group is joined; without one, UDP comes by any.
    option
        What the user calls it, for the faults.

    Raises
    ------
    ConfigError
        Where it is none, with every fault of its settings.
    """
    data = _block(text, option) if text.lstrip().startswith("{") else _short(text, option)
    kind = _KINDS.get(str(data.pop("type", None)))
    if kind is None:
        raise ConfigError(f"{option}: expected {FORMS}")
    faults: list[str] = []
    link = build(kind, data, faults, option)
    if link is None:
        raise ConfigError(faults)
    return link


def _block(text: str, option: str) -> dict[str, Any]:
    data = read_value(text)
    if not isinstance(data, dict):
        raise ConfigError(f"{option}: expected {FORMS}")
    return dict(data)


def _short(text: str, option: str) -> dict[str, Any]:
    kind, _, place = text.partition(":")
    # Paths of /dev/serial/by-path have colons of their own.
    head, _, tail = place.rpartition(":")
    if kind == "serial" and place:
        if head and tail.isdecimal():
            return {"type": kind, "port": head, "baud": int(tail)}
        return {"type": kind, "port": place}
    if kind not in _KINDS or not tail.isdecimal() or (kind == "tcp" and not head):
        raise ConfigError(f"{option}: expected {FORMS}")
    host, port = head.removeprefix("[").removesuffix("]"), int(tail)
    if kind == "tcp":
        return {"type": kind, "host": host, "port": port}
    with suppress(ValueError):
        if ip_address(host).is_multicast:
            return {"type": kind, "group": host, "port": port}
    return {"type": kind, "bind": host or "0.0.0.0", "port": port}
