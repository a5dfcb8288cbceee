"""A ship that follows a target, live: what Zenoh, plotters and recording are told of it."""

import asyncio
import csv
import math
import socket
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import msgspec
import pynmeagps
import pytest
import zenoh
import zenoh.ext

from gateway.emulator.truth import TruthFile
from gateway.monitor.watch import Listener
from gateway.outputs.schema import TargetReport
from gateway.outputs.zenoh import at
from tests.integration.rig import USBLNAV, Rig, brisk
from tests.integration.zenoh_ends import session
from tests.shared_data import ROOT

pytestmark = pytest.mark.live

WAY = {"type": "line", "lat_deg": 39.8, "lon_deg": 116.2, "height_m": -60.0, "speed_m_s": 1.0}


@contextmanager
def ear() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plotter:
        plotter.bind(("127.0.0.1", 0))
        plotter.setblocking(False)
        yield plotter


async def heard(plotter: socket.socket) -> dict[str, pynmeagps.NMEAMessage]:
    """The next epoch."""
    data = await asyncio.wait_for(
        asyncio.get_running_loop().sock_recv(plotter, 65536), timeout=10.0
    )
    lines = data.decode("ascii").splitlines(keepends=True)
    return {m.msgID: m for m in map(pynmeagps.NMEAReader.parse, lines)}


def following(folder: Path, own: int, targets: int) -> Rig:
    """A rig whose array asks the moored beacon and a target in turn."""
    scenario = brisk(folder)
    scenario["beacons"]["2"] = {"role": "target", "name": "rov", "trajectory": WAY}
    rig = Rig(folder, scenario)
    say = {"type": "nmea", "rate_hz": 1}
    rig.config["outputs"] += [
        say | {"link": {"type": "udp", "port": targets}, "sentences": ["TLL", "TTM"]},
        say | {"link": {"type": "udp", "port": own}, "sentences": ["GLL", "RMC"], "target": "rov"},
    ]
    (folder / "recorded").mkdir()
    rig.write({"recording": {"folder": str(folder / "recorded")}})
    return rig


def away_m(lat_deg: float, lon_deg: float, truth: Path, t_s: float) -> float:
    """From where the target truly was."""
    there = TruthFile(truth).at(t_s)
    assert there is not None
    north, east = lat_deg - there.lat_deg, lon_deg - there.lon_deg
    return 111_132.0 * math.hypot(north, east * math.cos(math.radians(lat_deg)))


async def test_a_target_is_told_to_all_and_recorded(tmp_path: Path) -> None:
    with ear() as own, ear() as targets:
        rig = following(tmp_path, own.getsockname()[1], targets.getsockname()[1])
        async with rig.gateway(), rig.emulator():
            rig.hear_zenoh()
            await rig.until("a true position", rig.is_right)
            while (await spoken(targets, "TTM")).targetstatus != "T":
                """Our own place is not known for a second yet."""
            report = await told(rig)
            assert (report.name, report.number, report.beacon) == ("rov", 1, "2")
            assert report.state == "tracked"
            truth = tmp_path / "truth-rov.csv"
            sigma = max(report.ellipse_major_m, 0.5)
            assert away_m(report.lat_deg, report.lon_deg, truth, report.t_s) < 4.0 * sigma
            ttm = await spoken(targets, "TTM")
            assert (ttm.targetname, ttm.targetstatus) == ("rov", "T")
            tll = await spoken(targets, "TLL")
            assert tll.targetname == "rov"
            rmc = await spoken(own, "RMC")
            assert (rmc.status, rmc.posMode) == ("A", "A")
            assert abs(rmc.lat - report.lat_deg) < 1e-3
            with closing(Listener(at(rig.endpoint), "*")) as listener:
                await rig.until("the monitor's word", lambda: followed(listener) == ["rov"])
            seen = len(rig.statuses)
            await rig.until("some seconds more", lambda: rig.statuses[seen + 3 :])
    await played_again(tmp_path)


def followed(listener: Listener) -> list[str]:
    """The targets that a monitor shows."""
    return [name for heard in listener.heard.values() for name in heard.targets]


async def spoken(plotter: socket.socket, name: str) -> pynmeagps.NMEAMessage:
    """The newest sentence of a name that is told while a target is seen."""
    with pytest.raises(BlockingIOError):
        while True:
            plotter.recv(65536)
    while True:
        said = await heard(plotter)
        if name in said:
            return said[name]


async def told(rig: Rig) -> TargetReport:
    """What somebody else's session that comes late is told at once, and what a query is answered.

    The next report is a second away; the last one comes with the subscription.
    """
    key = f"usblnav/{rig.scenario['vehicle']}/target/rov"
    loop, said = asyncio.get_running_loop(), asyncio.Queue[bytes]()

    def hear(sample: zenoh.Sample) -> None:
        loop.call_soon_threadsafe(said.put_nowait, sample.payload.to_bytes())

    with session(rig.endpoint) as other:
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
        with zenoh.ext.declare_advanced_subscriber(other, key, hear, history=history):
            first = msgspec.json.decode(await asyncio.wait_for(said.get(), 20.0), type=TargetReport)
            replies = await asyncio.to_thread(lambda: list(other.get(key)))
    (answer,) = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
    answered = msgspec.json.decode(answer, type=TargetReport)
    assert 0.0 <= answered.t_s - first.t_s <= 2.0
    return first


async def played_again(folder: Path) -> None:
    """Export and replay of the recording tell the same of the target, second by second."""
    tables = {}
    recorded = sorted(map(str, (folder / "recorded").glob("*.mcap")))
    for name in ("export", "replay"):
        command = [*USBLNAV, name, *recorded, "-o", str(folder / name)]
        done = await asyncio.to_thread(
            subprocess.run, command, capture_output=True, text=True, cwd=ROOT, check=False
        )
        assert (done.returncode, done.stderr) == (0, ""), done.stderr
        with (folder / name / "targets.csv").open() as file:
            tables[name] = {row["t_s"]: row for row in csv.DictReader(file)}
    both = tables["export"].keys() & tables["replay"].keys()
    assert len(both) >= len(tables["export"]) - 2 > 1
    assert all(tables["export"][t_s] == tables["replay"][t_s] for t_s in both)
