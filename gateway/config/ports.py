"""Ports and addresses: what only one can have, what a device of ours would hear, what is none."""

from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import ip_address, ip_network

from drivers.settings import PtyLink, SerialLink, StdioLink, TcpLink, UdpLink
from gateway.config.blocks import Config
from gateway.config.devices import Device
from gateway.config.drafts import readable_devices, readable_outputs
from gateway.config.lines import shares_line
from gateway.config.zenoh import ZenohOutput
from gateway.schema import known

_ANYWHERE = {"0.0.0.0", "::", ""}
_HERE = {"127.0.0.1", "::1", "localhost"}


def port_faults(config: Config) -> Iterator[str]:
    """Ports that two want, or on which the gateway would hear itself."""
    yield from _collisions(config)
    yield from _echoes(config)


def address_faults(config: Config) -> Iterator[str]:
    """What is no address where one is expected."""
    for name, device in readable_devices(config).items():
        if not isinstance(device.link, UdpLink):
            continue
        path, link = f"devices.{name}.link", device.link
        for n, source in enumerate(link.allow if known(link.allow) else ()):
            if known(source) and not _is_network(source):
                yield f'{path}.allow[{n}]: expected an address or network, got "{source}"'
        if known(link.group) and link.group is not None and not _is_multicast(link.group):
            yield f'{path}.group: expected a multicast address, got "{link.group}"'


@dataclass(frozen=True)
class _Claim:
    """Something only one device or output can have."""

    owner: str
    what: str
    address: str = ""
    senders: tuple[str, ...] = ()
    device: Device | None = None

    def clashes(self, other: "_Claim") -> bool:
        if self.device and other.device and shares_line(self.device, other.device):
            return False
        same = self.address == other.address
        meet = same or _ANYWHERE & {self.address, other.address}
        return self.what == other.what and bool(meet) and not (same and self._is_apart(other))

    def _is_apart(self, other: "_Claim") -> bool:
        """Whether each names its senders, and none is named by both."""
        try:
            ours, theirs = ([ip_network(n, strict=False) for n in c.senders] for c in (self, other))
        except ValueError:
            return True  # which is a fault of its own
        overlap = any(a.version == b.version and a.overlaps(b) for a in ours for b in theirs)
        return bool(ours and theirs) and not overlap


def _claims(config: Config) -> Iterator[_Claim]:
    for name, device in readable_devices(config).items():
        match device.link:
            case SerialLink(port=port) if known(port):
                yield _Claim(f"devices.{name}", f"serial port {port}", device=device)
            case UdpLink(port=port, bind=bind, group=group, allow=allow) if known(
                port, bind, group, allow, *(allow if known(allow) else ())
            ):
                yield _Claim(f"devices.{name}", f"UDP port {port}", group or bind, allow, device)
    for owner, output in readable_outputs(config):
        if isinstance(output, ZenohOutput):
            yield _Claim(owner, "the Zenoh session")
        else:
            match output.link:
                case SerialLink(port=port) if known(port):
                    yield _Claim(owner, f"serial port {port}")
                case TcpLink(port=port, bind=bind) if known(port, bind):
                    yield _Claim(owner, f"TCP port {port}", bind)
                case PtyLink(symlink=symlink) if known(symlink):
                    yield _Claim(owner, f"the pty {symlink}")
                case StdioLink():
                    yield _Claim(owner, "standard output")


def _collisions(config: Config) -> Iterator[str]:
    earlier: list[_Claim] = []
    for claim in _claims(config):
        taken = next((other for other in earlier if claim.clashes(other)), None)
        if taken is not None:
            ways_out = _ways_out(claim, taken)
            yield f"{claim.owner}: {claim.what} is already used by {taken.owner}{ways_out}"
        earlier.append(claim)


def _ways_out(claim: _Claim, taken: _Claim) -> str:
    """How two could have the same port after all."""
    if not (claim.device and taken.device):
        return ""
    alike = claim.device.link == taken.device.link
    unlike = f"for codec {taken.device.codec}" if alike else "with other settings"
    apart = ", or let allow of each name its own senders" if claim.what[:3] == "UDP" else ""
    return f" {unlike}; to share its line let link and codec be the same{apart}"


def _echoes(config: Config) -> Iterator[str]:
    """Outputs that a device of ours would hear."""
    for path, output in readable_outputs(config):
        if isinstance(output, ZenohOutput) or not isinstance(output.link, UdpLink):
            continue
        if not known(output.link.host, output.link.port):
            continue
        for name, device in readable_devices(config).items():
            if isinstance(device.link, UdpLink) and _hears(device.link, output.link):
                port = output.link.port
                yield f"{path}: devices.{name} listens on UDP port {port}; it would hear this"


def _hears(heard: UdpLink, said: UdpLink) -> bool:
    """Whether what is said to a host of this machine, or its group, comes in on a port."""
    if not known(heard.port, heard.bind, heard.group, heard.allow) or heard.port != said.port:
        return False
    if heard.group is not None:
        return said.host == heard.group
    is_here = said.host == "localhost" or _is_loopback(said.host)
    admits = not heard.allow or any(str(source).startswith("127.") for source in heard.allow)
    return said.host == heard.bind or (is_here and heard.bind in _ANYWHERE | _HERE and admits)


def _is_loopback(text: str) -> bool:
    try:
        return ip_address(text).is_loopback
    except ValueError:
        return False


def _is_network(text: str) -> bool:
    try:
        ip_network(text, strict=False)
    except ValueError:
        return False
    return True


def _is_multicast(text: str) -> bool:
    try:
        return ip_address(text).is_multicast
    except ValueError:
        return False
