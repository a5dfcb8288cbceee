"""From the cable to the chart, as docs/wiring.md has it: its commands in its order, on ptys.

``pytest -m slow tests/integration/test_wiring.py``. The emulator writes increments where a STIM300
would be set to integrated outputs; nothing else is changed but the names of ports and endpoints.
"""

import asyncio
import json
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
import yaml

from tests.gateway.emulated import demo_data
from tests.gateway.test_docs import blocks, commands
from tests.integration.test_readme import environment
from tests.loopback import free_endpoint
from tests.shared_data import ROOT

pytestmark = [pytest.mark.live, pytest.mark.slow]

PAGE = ROOT / "docs" / "wiring.md"
BY_ID = "/dev/serial/by-id"
PORTS = {
    "imu0": "usb-FTDI_USB-COM422_FT0A-if00-port0",
    "usbl0": "usb-Prolific_USB-Serial-if00-port0",
}


def scenario(ports: Path) -> dict[str, object]:
    """The packaged one with the page's instruments."""
    data = demo_data() | {"vehicle": "auv1", "start": "now", "duration_s": 600}
    imu, usbl = data["devices"]["imu0"], data["devices"]["usbl0"]
    imu |= {"codec": "stim300", "rate_hz": 500}
    imu["options"] = {"gyro": "increment", "accel": "increment"}
    for name, device in (("imu0", imu), ("usbl0", usbl)):
        baud = 921600 if name == "imu0" else 9600
        device["port"] = {"type": "pty", "symlink": str(ports / PORTS[name]), "baud": baud}
    return data


@asynccontextmanager
async def running(command: str, folder: Path) -> AsyncIterator[asyncio.subprocess.Process]:
    """A command that runs on, in a group of its own, and is interrupted in the end."""
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        *command.split(), cwd=folder, env=environment(), stdout=pipe, stderr=pipe
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGINT)
        await asyncio.wait_for(process.communicate(), 20)


async def said(command: str, folder: Path) -> str:
    """What a command says that ends by itself, and well."""
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_shell(
        command, cwd=folder, env=environment(), stdout=pipe, stderr=pipe
    )
    out, err = await asyncio.wait_for(process.communicate(), 60)
    assert process.returncode == 0, (command, err.decode())
    return out.decode()


async def line_with(words: str, stream: asyncio.StreamReader | None) -> str:
    """The first line with these words."""
    assert stream is not None
    async with asyncio.timeout(60):
        async for line in stream:
            if words in line.decode():
                return line.decode()
    pytest.fail(f"ended without {words}")


async def test_the_page_leads_from_the_cable_to_the_chart(tmp_path: Path) -> None:
    endpoint, ports = free_endpoint(), tmp_path / "by-id"
    ports.mkdir()

    def here(text: str) -> str:
        text = text.replace("{type: zenoh}", f"{{type: zenoh, listen: [{endpoint}]}}")
        return text.replace(BY_ID, str(ports)).replace("integrated", "increment")

    (config,) = blocks(PAGE, "yaml")
    (tmp_path / "auv1.yaml").write_text(here(config))
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(scenario(ports)))
    plugged, imu, usbl, check, run, monitor = map(here, commands(PAGE))
    async with running("usblnav emulate -c scenario.yaml", tmp_path) as emulator:
        await line_with("start: ", emulator.stderr)
        listed = await said(plugged, tmp_path)
        assert [name for name in PORTS.values() if name not in listed] == []
        for command, kind in ((imu, "imu"), (usbl, "usbl")):
            async with running(command, tmp_path) as decode:
                record = json.loads(await line_with(f'"record":"{kind}"', decode.stdout))
                assert record["valid"]
        await said(check, tmp_path)
        async with running(run, tmp_path) as gateway:
            await line_with("ready: imu0, usbl0", gateway.stderr)
            shown = await said(f"{monitor} --connect {endpoint}", tmp_path)
    assert shown.startswith("auv1 ")
    assert "stim300" in shown
    assert "tracklink-lxt" in shown
