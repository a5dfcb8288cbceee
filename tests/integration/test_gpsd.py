"""gpsd, the real one, on the gateway's UDP, TCP and pty: what it makes of a whole voyage."""

import asyncio
import json
import math
import re
import shutil
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from gateway.outputs.schema import NavReport
from tests.integration.cables import Cable, UdpEnd
from tests.integration.rig import Rig, brisk
from tests.loopback import free_port

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(not shutil.which("gpsd"), reason="no gpsd: apt-get install gpsd"),
]

RATE_HZ = 5
RECKONED = 5
"""What gpsd calls the status of a dead-reckoned fix."""
HARMLESS = re.compile(
    r"DBUS|can't use GGA time until after ZDA or RMC|terminating|exiting|shmctl|no kernel PPS"
)


class Gpsd:
    """A running gpsd, its reports by class and device, and what it complains of."""

    def __init__(self) -> None:
        self.reports: dict[tuple[str, str], list[dict[str, Any]]] = {}
        self.complaints: list[str] = []
        self.news = asyncio.Event()

    def of(self, kind: str, device: str) -> list[dict[str, Any]]:
        return self.reports.get((kind, device), [])

    def last(self, device: str) -> dict[str, Any]:
        """The last report of a fix, or of none."""
        return self.of("TPV", device)[-1]

    def fixes(self, device: str) -> list[dict[str, Any]]:
        """Reports that are whole: gpsd learns in its first ones which sentence ends an epoch."""
        return [report for report in self.of("TPV", device) if "epx" in report]

    async def until(self, condition: Callable[[], object], within_s: float = 20.0) -> None:
        """Wait until it has reported or complained so."""
        try:
            async with asyncio.timeout(20.0 + within_s):
                while not condition():
                    self.news.clear()
                    await self.news.wait()
        except TimeoutError:
            last = {key: reports[-1] for key, reports in self.reports.items()}
            pytest.fail(f"in vain: {last} {self.complaints}")

    async def take_reports(self, stream: asyncio.StreamReader) -> None:
        async for line in stream:
            report = json.loads(line)
            key = report["class"], report.get("device", "")
            self.reports.setdefault(key, []).append(report)
            self.news.set()

    async def take_complaints(self, stream: asyncio.StreamReader) -> None:
        async for raw in stream:
            line = raw.decode(errors="replace").rstrip()
            if re.match(r"gpsd:(WARN|ERROR)", line) and not HARMLESS.search(line):
                self.complaints.append(line)
                self.news.set()


@asynccontextmanager
async def gpsd(*sources: str) -> AsyncIterator[Gpsd]:
    """Run gpsd on its sources as its manual says, and watch it as any of its clients does."""
    port = free_port(socket.SOCK_STREAM)
    process = await asyncio.create_subprocess_exec(
        *("gpsd", "-N", "-n", "-D", "3", "-S", str(port), *sources),
        stderr=asyncio.subprocess.PIPE,
    )
    running = Gpsd()
    assert process.stderr is not None
    tasks = [asyncio.create_task(running.take_complaints(process.stderr))]
    try:
        reader, writer = await connected(port)
        with closing(writer):
            writer.write(b'?WATCH={"enable":true,"json":true}\n')
            tasks.append(asyncio.create_task(running.take_reports(reader)))
            yield running
    finally:
        process.terminate()
        await process.wait()
        await asyncio.wait(tasks)


async def connected(port: int) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Be a client, as soon as there is a server."""
    async with asyncio.timeout(10):
        while True:
            try:
                return await asyncio.open_connection("127.0.0.1", port)
            except ConnectionRefusedError:
                await asyncio.sleep(0.02)


@pytest.mark.parametrize("epochs", [12, pytest.param(300 * RATE_HZ, marks=pytest.mark.slow)])
@pytest.mark.timeout(500)
async def test_gpsd_has_the_fix_its_errors_track_and_speed(tmp_path: Path, epochs: int) -> None:
    imu, usbl = Cable(UdpEnd()), Cable(UdpEnd())
    scenario = brisk(tmp_path) | {"duration_s": 60 + epochs / RATE_HZ}
    rig = Rig(tmp_path, scenario, {"imu0": imu, "usbl0": usbl})
    udp, tcp = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    pty = str(tmp_path / "nmea")
    links: dict[str, dict[str, Any]] = {
        f"udp://127.0.0.1:{udp}": {"type": "udp", "port": udp},
        f"tcp://127.0.0.1:{tcp}": {"type": "tcp", "port": tcp},
        pty: {"type": "pty", "symlink": pty},
    }
    plotters = [{"type": "nmea", "link": link, "rate_hz": RATE_HZ} for link in links.values()]
    rig.write({"outputs": [*rig.config["outputs"], *plotters]})
    with imu, usbl:
        async with rig.gateway(), rig.emulator():
            rig.hear_zenoh()
            await rig.until("a true position", rig.is_right)
            async with gpsd(*links) as heard:
                for source in links:
                    await heard.until(
                        lambda source=source: len(heard.fixes(source)) >= epochs, epochs
                    )
                whole = {source: list(heard.of("TPV", source)) for source in links}
                usbl.cut = True
                await heard.until(
                    lambda: all(heard.last(s).get("status") == RECKONED for s in links)
                )
                imu.cut = True
                await heard.until(lambda: all(heard.last(s)["mode"] < 2 for s in links))
                complaints = list(heard.complaints)
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as liar:
                    liar.sendto(b"$GPHDT,1.00,T*00\r\n", ("127.0.0.1", udp))
                await heard.until(lambda: heard.complaints[len(complaints) :])
            await rig.until("the truth", lambda: rig.error_m(rig.navs[-1]) is not None)
    assert complaints == []
    for source in links:
        assert "lat" not in heard.last(source)
        judge(rig, heard, source, whole[source])


def judge(rig: Rig, heard: Gpsd, source: str, reports: list[dict[str, Any]]) -> None:
    """Every epoch from the first whole one on is there, and says what the solution said."""
    navs = {(nav.utc_ns + 5_000_000) // 10_000_000: nav for nav in rig.navs}
    first, *_ = heard.fixes(source)
    hundredths = []
    errors = []
    for report in reports[reports.index(first) :]:
        hundredths.append(round(datetime.fromisoformat(report["time"]).timestamp() * 100))
        nav = navs[hundredths[-1]]
        agrees(report, nav)
        error = rig.error_m(nav)
        assert error is not None
        errors.append(error)
    assert {b - a for a, b in pairwise(hundredths)} == {100 // RATE_HZ}
    assert any(report.get("major", 0.0) > 0.0 for report in heard.of("GST", source))
    attitude = heard.of("ATT", source)[-1]
    assert min(turn(nav.heading_deg, attitude["heading"]) for nav in rig.navs) < 0.006
    rms_m = math.sqrt(sum(error**2 for error in errors) / len(errors))
    span_s = (hundredths[-1] - hundredths[0]) / 100
    print(f"{source}: {len(errors)} reports of mode 3 in {span_s:.0f} s, {rms_m:.2f} m RMS")
    assert rms_m < 2.0


def agrees(report: dict[str, Any], nav: NavReport) -> None:
    """A report of gpsd is the solution of that moment, to the last digit that NMEA carries."""
    course = math.degrees(math.atan2(nav.ve_m_s, nav.vn_m_s))
    assert report["mode"] == 3
    assert report["lat"] == pytest.approx(nav.lat_deg, abs=1e-7)
    assert report["lon"] == pytest.approx(nav.lon_deg, abs=1e-7)
    assert report["altHAE"] == pytest.approx(nav.height_m, abs=0.006)
    assert report["speed"] == pytest.approx(math.hypot(nav.vn_m_s, nav.ve_m_s), abs=0.006)
    assert turn(course, report["track"]) < 0.006
    for error, sigma in (("epx", nav.sd_e_m), ("epy", nav.sd_n_m), ("epv", nav.sd_d_m)):
        assert report[error] == pytest.approx(sigma, abs=0.0011)


def turn(a_deg: float, b_deg: float) -> float:
    """The angle between two directions (deg)."""
    return abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)
