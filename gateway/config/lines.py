"""Lines: settings that contradict each other, names that will not stay, devices that share one."""

import re
from collections.abc import Iterator
from pathlib import Path

from drivers.settings import SerialLink
from gateway.config.blocks import Config
from gateway.config.devices import Device
from gateway.config.drafts import readable_devices, readable_outputs
from gateway.config.zenoh import ZenohOutput
from gateway.schema import known

STABLE_NAMES = (Path("/dev/usblnav"), Path("/dev/serial/by-id"))
"""Where udev keeps names that follow an adapter: our rule's, then the system's."""

_KERNEL_NAME = re.compile(r"/dev/tty(USB|ACM)\d+")


def line_faults(config: Config) -> Iterator[str]:
    """What no port could do."""
    for path, link in _serial_lines(config):
        if not known(link.flow, link.rts, link.rs485):
            continue
        if link.flow == "rts_cts" and not link.rts:
            yield f"{path}.rts: with flow: rts_cts the system sets it"
        if link.rs485 is not None and link.flow == "rts_cts":
            yield f"{path}.flow: with rs485 RTS turns the transmitter on; use none"
        if link.rs485 is not None and not link.rts:
            yield f"{path}.rts: with rs485 the system sets it; see rs485.rts_on_send"


def advice(config: Config, folders: tuple[Path, ...] = STABLE_NAMES) -> Iterator[str]:
    """Names of ports that depend on the order of plugging in, with one that does not.

    Parameters
    ----------
    config
        A sound configuration.
    folders
        Where to look for a name that stays. No port is opened.
    """
    for path, link in _serial_lines(config):
        if _KERNEL_NAME.fullmatch(link.port):
            stable = next(_names_of(link.port, folders), "one of /dev/serial/by-id/")
            yield f"{path}.port: {link.port} depends on the order of plugging in; use {stable}"


def _serial_lines(config: Config) -> Iterator[tuple[str, SerialLink]]:
    for name, device in readable_devices(config).items():
        if isinstance(device.link, SerialLink):
            yield f"devices.{name}.link", device.link
    for path, output in readable_outputs(config):
        if not isinstance(output, ZenohOutput) and isinstance(output.link, SerialLink):
            yield f"{path}.link", output.link


def _names_of(port: str, folders: tuple[Path, ...]) -> Iterator[Path]:
    """Links to the same device; none while it is not plugged in."""
    device = Path(port).resolve()
    for folder in folders:
        if folder.is_dir():
            yield from (name for name in sorted(folder.iterdir()) if name.resolve() == device)


def shares_line(one: Device, other: Device) -> bool:
    """Whether two devices of a draft are heard on one port by one decoder."""
    return known(one.codec, one.link) and (one.codec, one.link) == (other.codec, other.link)


def sharing_faults(config: Config) -> Iterator[str]:
    """Devices on one line of which nobody could tell whose a record is, or how to read it."""
    heard: list[tuple[str, Device]] = []
    for name, device in readable_devices(config).items():
        for other_name, other in heard:
            if not shares_line(device, other):
                continue
            with_whom = f"devices.{other_name}, with which it shares its line"
            if device.kind == other.kind:
                yield f"devices.{name}: of the same kind as {with_whom}; whose would a record be?"
            elif known(device.options, other.options) and device.options != other.options:
                yield f"devices.{name}.options: not those of {with_whom}"
            else:
                continue
            break
        heard.append((name, device))
