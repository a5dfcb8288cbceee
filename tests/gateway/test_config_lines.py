"""Serial lines of a configuration: contradictions, time of a byte, names that will not stay."""

import copy
from pathlib import Path
from typing import Any

import pytest

from drivers.settings import Rs485, SerialLink
from gateway.config import Config
from gateway.config.checks import cross_faults
from gateway.config.lines import advice
from gateway.schema import build
from tests.gateway.configurations import GOOD


def configured(**link: Any) -> Config:
    """The good configuration with other settings of the array's line."""
    data = copy.deepcopy(GOOD)
    data["devices"]["usbl0"]["link"] |= link
    faults: list[str] = []
    config = build(Config, data, faults)
    assert config is not None, faults
    return config


@pytest.mark.parametrize(
    ("link", "fault"),
    [
        ({"flow": "rts_cts", "rts": False}, "rts: with flow: rts_cts the system sets it"),
        (
            {"rs485": {}, "flow": "rts_cts"},
            "flow: with rs485 RTS turns the transmitter on; use none",
        ),
        (
            {"rs485": {"rts_on_send": False}, "rts": False},
            "rts: with rs485 the system sets it; see rs485.rts_on_send",
        ),
    ],
)
def test_settings_that_contradict_each_other(link: dict[str, Any], fault: str) -> None:
    assert list(cross_faults(configured(**link))) == [f"devices.usbl0.link.{fault}"]


def test_settings_of_every_kind_are_read() -> None:
    link = (
        configured(data_bits=7, parity="even", stop_bits=2, flow="xon_xoff", dtr=False, rs485={})
        .usbl["usbl0"]
        .link
    )
    assert link == SerialLink(
        port="/dev/ttyUSB1",
        data_bits=7,
        parity="even",
        stop_bits=2,
        flow="xon_xoff",
        dtr=False,
        rs485=Rs485(),
    )


@pytest.mark.parametrize(
    ("bits", "link"),
    [(10, {}), (11, {"parity": "odd"}), (11, {"stop_bits": 2}), (9, {"data_bits": 7})],
)
def test_bits_of_a_byte(bits: int, link: dict[str, Any]) -> None:
    assert SerialLink(port="x", **link).bits_per_byte == bits


def test_a_kernel_name_is_advised_against(tmp_path: Path) -> None:
    config = configured(port="/dev/ttyUSB7")
    said = "devices.usbl0.link.port: /dev/ttyUSB7 depends on the order of plugging in; use "
    assert list(advice(config, (tmp_path / "absent",))) == [said + "one of /dev/serial/by-id/"]
    (tmp_path / "usb-FTDI_FT4ABCDE-if00").symlink_to("/dev/ttyUSB7")
    (tmp_path / "usb-Other-if00").symlink_to("/dev/ttyUSB8")
    assert list(advice(config, (tmp_path,))) == [said + str(tmp_path / "usb-FTDI_FT4ABCDE-if00")]


@pytest.mark.parametrize(
    "port", ["/dev/serial/by-id/usb-FTDI-if00", "/dev/ttyS0", "/dev/usblnav/a"]
)
def test_a_name_that_stays_needs_no_advice(port: str, tmp_path: Path) -> None:
    assert not list(advice(configured(port=port), (tmp_path,)))
