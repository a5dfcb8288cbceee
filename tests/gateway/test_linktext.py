"""Links written on one line."""

import pytest

from drivers.settings import Link, SerialLink, TcpLink, UdpLink
from gateway.commands.linktext import FORMS, read_link
from gateway.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "link"),
    [
        ("serial:/dev/ttyUSB0", SerialLink("/dev/ttyUSB0")),
        ("serial:/dev/ttyUSB0:115200", SerialLink("/dev/ttyUSB0", 115_200)),
        (
            "serial:/dev/serial/by-path/pci-0:1:1.0-port0",
            SerialLink("/dev/serial/by-path/pci-0:1:1.0-port0"),
        ),
        ("udp:7001", UdpLink(7001, bind="0.0.0.0")),
        ("udp:192.168.1.10:7001", UdpLink(7001, bind="192.168.1.10")),
        ("udp:239.192.7.1:7001", UdpLink(7001, group="239.192.7.1")),
        ("udp:[::1]:7001", UdpLink(7001, bind="::1")),
        ("tcp:moxa:4001", TcpLink(4001, host="moxa")),
        ("tcp:[fd00::1]:4001", TcpLink(4001, host="fd00::1")),
        ("{type: udp, port: 7001, allow: [10.0.0.7]}", UdpLink(7001, allow=("10.0.0.7",))),
        ("{type: serial, port: /dev/ttyS1, parity: even}", SerialLink("/dev/ttyS1", parity="even")),
    ],
)
def test_every_form(text: str, link: Link) -> None:
    assert read_link(text, "--link") == link


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", f"--link: expected {FORMS}"),
        ("usb:7", f"--link: expected {FORMS}"),
        ("serial:", f"--link: expected {FORMS}"),
        ("udp:port", f"--link: expected {FORMS}"),
        ("tcp:4001", f"--link: expected {FORMS}"),
        ("{type: serial", f"--link: expected {FORMS}"),
        ("{port: 7001}", f"--link: expected {FORMS}"),
        ("udp:70000", "--link.port: expected an integer from 1 to 65535, got 70000"),
        ("{type: tcp, port: 1, hots: x}", "--link.hots: unknown key; did you mean host?"),
        ("serial:/dev/ttyUSB0:9", "--link.baud: expected an integer from 50 to 4000000, got 9"),
    ],
)
def test_what_is_none_is_one_clear_line(text: str, fault: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read_link(text, "--link")
    assert list(refused.value.faults) == [fault]
