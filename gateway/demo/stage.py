"""The processes of the demo: the daemon, then the emulator that speaks to it over loopback."""

import asyncio
import os
import socket
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec
import yaml

from gateway.emulator import twin
from gateway.emulator.scenario import PtyPort, UdpPort
from gateway.errors import UsblnavError

READY_S = 600.0
"""The first start on a machine compiles the filter: minutes on a small one that is busy."""
END_S = 5.0
PLOTTER_PORT = 10110

Say = Callable[[str], None]


class Stage:
    """Where everything of one demo is: files, ports, names.

    Parameters
    ----------
    folder
        An empty folder of its own.
    filter_name
        The filter's error definition.
    """

    def __init__(self, folder: Path, filter_name: str) -> None:
        self.truth = folder / "truth.csv"
        self.nmea_port, imu_port = _free_port(socket.SOCK_DGRAM), _free_port(socket.SOCK_DGRAM)
        self.endpoint = f"tcp/127.0.0.1:{_free_port(socket.SOCK_STREAM)}"
        scenario = twin.load(twin.DEMO)
        devices = dict(scenario.devices)
        for name, model in devices.items():
            port: PtyPort | UdpPort = UdpPort(port=imu_port)
            if isinstance(model.port, PtyPort):
                port = PtyPort(symlink=str(folder / name), baud=model.port.baud)
            devices[name] = msgspec.structs.replace(model, port=port)
        scenario = msgspec.structs.replace(scenario, devices=devices)
        self.vehicle = scenario.vehicle
        self.scenario_file = folder / "scenario.yaml"
        self.config_file = folder / "config.yaml"
        config = twin.gateway_config(scenario) | {
            "filter": {"error": filter_name},
            "outputs": self._outputs(),
        }
        self.scenario_file.write_text(yaml.safe_dump(msgspec.to_builtins(scenario)))
        self.config_file.write_text(yaml.safe_dump(config))
        self.lines = [
            f"{name}: {_where(block['link'])}" for name, block in config["devices"].items()
        ]

    def _outputs(self) -> list[dict[str, Any]]:
        """Sentences for the viewer and for a chart plotter, and a Zenoh session."""
        sentences = ["GGA", "RMC", "HDT", "VTG", "GST", "GBS", "ZDA", "PUNAV"]
        nmea = [
            {"type": "nmea", "link": {"type": "udp", "port": port}, "sentences": sentences}
            for port in (self.nmea_port, PLOTTER_PORT)
        ]
        return [*nmea, {"type": "zenoh", "mode": "peer", "listen": [self.endpoint]}]


@asynccontextmanager
async def playing(stage: Stage, say: Say) -> AsyncIterator[None]:
    """Daemon and emulator running while the body does; both are ended and seen to their end.

    Raises
    ------
    UsblnavError
        If one of them does not start, dies early or does not end as it should.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
        address = str(stage.config_file.with_name("notify"))
        notify.bind(address)
        notify.setblocking(False)
        gateway = ("run", "-c", str(stage.config_file))
        async with _command("gateway", gateway, say, {"NOTIFY_SOCKET": address}) as died:
            await _first(_told_ready(notify), died)
            emulate = ("emulate", "-c", str(stage.scenario_file), "--truth", str(stage.truth))
            async with _command("emulator", emulate, say, {}):
                yield


@asynccontextmanager
async def _command(
    name: str, arguments: tuple[str, ...], say: Say, environment: dict[str, str]
) -> AsyncIterator["asyncio.Task[int]"]:
    """One of our own commands as a process; yields a task that ends when it does."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "gateway", *arguments),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        env=os.environ | environment,
        start_new_session=True,
    )
    listening = asyncio.create_task(_listen(name, process, say))
    died = asyncio.create_task(process.wait())
    try:
        yield died
        if died.done():
            raise UsblnavError(f"the {name} ended too early (exit code {died.result()})")
    finally:
        if process.returncode is None:
            process.terminate()
        try:
            code = await asyncio.wait_for(asyncio.shield(died), END_S)
        except TimeoutError:
            process.kill()
            code = await died
        await listening
    if code != 0:
        raise UsblnavError(f"the {name} ended with exit code {code}")


async def _listen(name: str, process: asyncio.subprocess.Process, say: Say) -> None:
    """Hand on what a process says."""
    assert process.stderr is not None
    async for line in process.stderr:
        say(f"{name}: {line.decode(errors='replace').rstrip().removeprefix('usblnav: ')}")


async def _told_ready(notify: socket.socket) -> None:
    """Wait for the daemon's READY, as systemd does."""
    loop = asyncio.get_running_loop()
    while b"READY=1" not in await loop.sock_recv(notify, 4096):
        pass


async def _first(ready: Coroutine[Any, Any, None], died: "asyncio.Task[int]") -> None:
    """Wait until the daemon is ready; its death or silence is an error."""
    waiting = asyncio.ensure_future(ready)
    await asyncio.wait([waiting, died], timeout=READY_S, return_when=asyncio.FIRST_COMPLETED)
    if waiting.done():
        waiting.result()
        return
    waiting.cancel()
    why = f"ended (exit code {died.result()})" if died.done() else "was not ready in time"
    raise UsblnavError(f"the gateway {why}")


def _free_port(kind: socket.SocketKind) -> int:
    """A port of loopback that nobody uses now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _where(link: dict[str, Any]) -> str:
    """A link in words."""
    if link["type"] == "serial":
        return f"pty at {link['baud']} baud"
    return f"UDP 127.0.0.1:{link['port']}"
