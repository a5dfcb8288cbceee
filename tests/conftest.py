"""Options of the tests."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Where the rig's cables are; see docs/devices.md."""
    parser.addoption(
        "--rig",
        metavar="[DEVICE=]serial:PORT[,PORT][:BAUD]",
        help="run tests/rig on real serial ports: one with a loopback plug, or two with a cable",
    )
