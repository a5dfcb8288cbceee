"""The rig's option for real ports, with ptys that stand for adapters and their cable."""

import asyncio
import sys
from asyncio.subprocess import PIPE, STDOUT

import pytest

from tests.integration.cables import PtyWire
from tests.rig.wiring import Ports, ports
from tests.shared_data import ROOT


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("serial:/dev/ttyUSB0", Ports("usbl0", "/dev/ttyUSB0", "/dev/ttyUSB0", 115_200)),
        ("serial:/dev/a,/dev/b", Ports("usbl0", "/dev/b", "/dev/a", 115_200)),
        ("imu0=serial:/dev/a,/dev/b:921600", Ports("imu0", "/dev/b", "/dev/a", 921_600)),
    ],
)
def test_the_option_is_read(text: str, read: Ports) -> None:
    assert ports(text) == read


@pytest.mark.parametrize("text", ["", "serial:", "udp:7001", "gyro0=serial:/dev/a"])
def test_what_is_no_option_is_named(text: str) -> None:
    with pytest.raises(ValueError, match="--rig: expected"):
        ports(text)


async def rig(option: str, *arguments: str) -> str:
    """What pytest says of the rig on some ports."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "pytest", "tests/rig/test_rig.py", f"--rig={option}"),
        *("-vv", "-p", "no:cacheprovider", "--no-cov", *arguments),
        stdout=PIPE,
        stderr=STDOUT,
        cwd=ROOT,
    )
    said, _ = await process.communicate()
    assert process.returncode == 0, said.decode()
    return said.decode()


@pytest.mark.live
async def test_an_array_on_a_cable_between_two_ports() -> None:
    with PtyWire() as wire:
        option = f"serial:{wire.ports[0]},{wire.ports[1]}"
        said = await rig(option, "-k", "array")
    assert f"test_the_array_is_pulled_and_put_back[{option}] PASSED" in said


@pytest.mark.slow
@pytest.mark.live
@pytest.mark.parametrize("ends", [1, 2])
@pytest.mark.parametrize("device", ["imu0", "usbl0"])
async def test_everything_on_a_cable_and_on_a_loopback_plug(ends: int, device: str) -> None:
    """``pytest -m slow tests/rig/test_option.py``."""
    with PtyWire(ends) as wire:
        said = await rig(f"{device}=serial:{','.join(wire.ports)}:921600")
    assert said.count("PASSED") == 5
