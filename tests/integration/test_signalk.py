"""Signal K, the real server, on UDP, TCP and pty: what its model of the vessel holds."""

import asyncio
import json
import math
import os
import shutil
import socket
import urllib.request
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from tests.integration.cables import Cable, UdpEnd
from tests.integration.rig import Rig, brisk
from tests.loopback import free_port

SERVER = shutil.which("signalk-server")
pytestmark = [
    pytest.mark.live,
    pytest.mark.slow,
    pytest.mark.skipif(not SERVER, reason="no signalk-server in PATH (docs/outputs.md)"),
]

SURFACE_M = 12.5
START_S = 120.0
"""On a busy machine node takes its time."""
QUALITY = "navigation.gnss.methodQuality"
RECKONED = {"Estimated (DR) mode"}
PATHS = (
    "navigation.position",
    "navigation.headingTrue",
    "navigation.speedOverGround",
    "navigation.courseOverGroundTrue",
    QUALITY,
    "environment.depth.belowTransducer",
    "environment.depth.belowSurface",
)


class Model:
    """The server's model of the vessel, by its web interface."""

    def __init__(self, port: int, log: Path) -> None:
        self._log = log
        self._url = f"http://127.0.0.1:{port}/signalk/v1/api/vessels/self"

    async def until(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The tree, once it is so."""
        tree: dict[str, Any] = {}
        try:
            async with asyncio.timeout(START_S):
                while not (tree and condition(tree)):
                    await asyncio.sleep(0.2)
                    with suppress(OSError):
                        tree = await asyncio.to_thread(self._tree)
        except TimeoutError:
            pytest.fail(
                f"the server has {sorted(tree.get('sources', {}))}\n{self._log.read_text()}"
            )
        return tree

    def _tree(self) -> dict[str, Any]:
        with urllib.request.urlopen(self._url, timeout=10) as answer:
            tree: dict[str, Any] = json.load(answer)
        return tree


def value(tree: dict[str, Any], path: str, source: str) -> dict[str, Any]:
    """What a source has said of a path, with its time; empty where it has not."""
    for key in path.split("."):
        tree = tree.get(key, {})
    told: dict[str, Any] = tree.get("values", {}).get(source, {})
    return told


@asynccontextmanager
async def signalk(folder: Path, ways: dict[str, dict[str, Any]]) -> AsyncIterator[Model]:
    """Run a server with nothing but these connections."""
    port = free_port(socket.SOCK_STREAM)
    write_settings(folder, port, ways)
    assert SERVER is not None
    log = folder / "server.log"
    with log.open("wb") as file:
        process = await asyncio.create_subprocess_exec(
            *(SERVER, "-c", str(folder)),
            stdout=file,
            stderr=file,
            env=os.environ | {"HOME": str(folder)},
        )
    try:
        yield Model(port, log)
    finally:
        process.terminate()
        await process.wait()


def write_settings(folder: Path, port: int, ways: dict[str, dict[str, Any]]) -> None:
    """Settings as the server's own admin page writes them, with all that is not needed left out."""
    providers = []
    for name, way in ways.items():
        options = {"type": "NMEA0183", "subOptions": way | {"validateChecksum": True}}
        element = {"type": "providers/simple", "options": options}
        providers.append({"id": name, "enabled": True, "pipeElements": [element]})
    unused = ("appstore", "nmea-tcp", "tcp", "plugins", "webapps", "logfiles")
    settings = {
        "port": port,
        "mdns": False,
        "interfaces": dict.fromkeys(unused, False),
        "pipedProviders": providers,
    }
    folder.mkdir()
    (folder / "settings.json").write_text(json.dumps(settings))


@pytest.mark.timeout(300)
async def test_signal_k_holds_the_solution(tmp_path: Path) -> None:
    usbl = Cable(UdpEnd())
    rig = Rig(tmp_path, brisk(tmp_path) | {"duration_s": 240}, {"usbl0": usbl})
    udp, tcp = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    says = {
        "type": "nmea",
        # Without VTG, which tells no time, the speed has that of RMC.
        "sentences": ["GGA", "RMC", "HDT", "DPT", "DBS", "ZDA"],
        "rate_hz": 5,
        "surface_height_m": SURFACE_M,
    }
    pty = str(tmp_path / "nmea")
    outputs = [
        says | {"link": {"type": "udp", "port": udp}},
        says | {"link": {"type": "tcp", "port": tcp}, "talker": "IN"},
        says | {"link": {"type": "pty", "symlink": pty}},
    ]
    rig.write({"outputs": [*rig.config["outputs"], *outputs]})
    ways = {
        "by_udp": {"type": "udp", "port": str(udp)},
        "by_tcp": {"type": "tcp", "host": "127.0.0.1", "port": str(tcp)},
        "by_pty": {"type": "serial", "device": pty, "baudrate": 115200},
    }
    sources = ("by_udp.GP", "by_tcp.IN", "by_pty.GP")
    with usbl:
        async with rig.gateway(), rig.emulator():
            rig.hear_zenoh()
            await rig.until("a true position", rig.is_right)
            async with signalk(tmp_path / "signalk", ways) as model:
                tree = await model.until(
                    lambda now: all(
                        value(now, path, source) for path in PATHS for source in sources
                    )
                )
                usbl.cut = True
                await model.until(
                    lambda now: (
                        {value(now, QUALITY, source)["value"] for source in sources} == RECKONED
                    )
                )
            seen = len(rig.navs)
            await rig.until("the solutions of that time", lambda: rig.navs[seen + 5 :])
    for source in sources:
        judge(rig, tree, source)


def judge(rig: Rig, tree: dict[str, Any], source: str) -> None:
    """The model is the solution, to the last digit that NMEA carries."""
    navs = {(nav.utc_ns + 5_000_000) // 10_000_000: nav for nav in rig.navs}

    def told(path: str) -> tuple[Any, float]:
        said = value(tree, path, source)
        return said["value"], datetime.fromisoformat(said["timestamp"]).timestamp()

    position, t_s = told("navigation.position")
    nav = navs[round(t_s * 100)]
    assert position["latitude"] == pytest.approx(nav.lat_deg, abs=1e-7)
    assert position["longitude"] == pytest.approx(nav.lon_deg, abs=1e-7)
    speed, t_s = told("navigation.speedOverGround")
    nav = navs[round(t_s * 100)]
    assert speed == pytest.approx(math.hypot(nav.vn_m_s, nav.ve_m_s), abs=0.006)
    course, t_s = told("navigation.courseOverGroundTrue")
    nav = navs[round(t_s * 100)]
    assert turn(course, math.atan2(nav.ve_m_s, nav.vn_m_s)) < 1e-4
    assert told(QUALITY)[0] == "GNSS Fix"
    # These tell no time; the server puts its own.
    heading, _ = told("navigation.headingTrue")
    assert min(turn(heading, math.radians(nav.heading_deg)) for nav in rig.navs) < 1e-4
    for path in ("environment.depth.belowTransducer", "environment.depth.belowSurface"):
        depth, _ = told(path)
        assert min(abs(SURFACE_M - nav.height_m - depth) for nav in rig.navs) < 0.006
        assert depth > 5.0


def turn(a: float, b: float) -> float:
    """The angle between two directions (rad)."""
    return abs(math.remainder(a - b, 2.0 * math.pi))
