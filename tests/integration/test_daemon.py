"""The daemon as a process among processes: what fails around it, what it says, how it goes on."""

import asyncio
import json
import os
import signal
import socket
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from drivers.imu.kvh import KVH1750, KvhOptions
from drivers.links.base import LinkCounts, LinkError
from drivers.links.serial import open_serial
from drivers.records import ImuRecord
from drivers.settings import SerialLink
from tests.integration.cables import Cable, PtyEnd, TcpEnd, UdpEnd
from tests.integration.rig import USBLNAV, Rig, session
from tests.loopback import free_port
from tests.shared_data import ROOT

pytestmark = pytest.mark.live


async def test_a_killed_filter_takes_up_where_it_was(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    async with rig.gateway(), rig.emulator():
        rig.hear_zenoh()
        await rig.until("a true position", rig.is_right)
        await rig.until("eight fixes", lambda: rig.navs and rig.navs[-1].fixes_used >= 8)
        killed, used = rig.worker(), rig.navs[-1].fixes_used
        os.kill(killed, signal.SIGKILL)
        await rig.until("the report", lambda: rig.said("killed by SIGKILL; starting it again"))
        rig.navs.clear()
        await rig.until("a solution", lambda: rig.navs)
        assert used - 2 <= rig.navs[0].fixes_used  # a checkpoint is at most a second old
        await rig.until("more fixes", lambda: rig.navs[-1].fixes_used > used)
        await rig.until("a true position again", rig.is_right)
        await rig.until("the status", lambda: rig.statuses[-1]["filter"]["restarts"] == 1)
        assert rig.statuses[-1]["filter"]["pid"] == rig.worker() != killed
        assert len(rig.said("filter process")) == 1
    times = [epoch.t_s for epoch in rig.epochs]
    assert times == sorted(set(times))


async def test_stopping_gives_everything_back(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    (imu, usbl), tcp = rig.links(), free_port(socket.SOCK_STREAM)
    rig.write({"outputs": [{"type": "nmea", "link": {"type": "tcp", "port": tcp}}]})
    async with rig.emulator():
        async with rig.gateway():
            await rig.until("the array's line", lambda: rig.said("navigation: aided"))
            with pytest.raises(OSError, match="in use"):
                bind(socket.SOCK_DGRAM, imu["port"])
            with pytest.raises(OSError, match="in use"):
                bind(socket.SOCK_STREAM, tcp)
            with pytest.raises(LinkError, match="in use by another program"):
                await open_once(usbl)
        bind(socket.SOCK_DGRAM, imu["port"])
        bind(socket.SOCK_STREAM, tcp)
        await open_once(usbl)


def bind(kind: socket.SocketKind, port: int) -> None:
    """Take a port as the gateway would at its next start."""
    with socket.socket(socket.AF_INET, kind) as probe:
        if kind == socket.SOCK_STREAM:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))


async def open_once(link: dict[str, Any]) -> None:
    async with open_serial(SerialLink(link["port"], link["baud"]), print, LinkCounts()):
        pass


async def test_no_filter_outlives_a_killed_daemon(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    async with rig.gateway(ends=-signal.SIGKILL):
        deadline = time.monotonic() + 5.0
        while len(session(rig.process.pid)) < 3:  # itself, the filter and the spare one
            assert time.monotonic() < deadline
            await asyncio.sleep(0.02)
        await rig.kill()


async def test_an_absent_array_comes_goes_and_comes_back(tmp_path: Path) -> None:
    adapter = PtyEnd(tmp_path / "usbl0")
    with Cable(adapter) as cable:
        rig = Rig(tmp_path, cables={"usbl0": cable})
        async with rig.gateway(), rig.emulator():
            await rig.until("inertial data", lambda: rig.said("aligning (was invalid)"))
            await rig.until("no claim before a fix", lambda: rig.is_now(0, "V", "N"))
            (absent,) = rig.said("usbl0: ")
            assert absent.endswith("usbl0: no such file or directory; trying until it is back")
            adapter.plug()
            await rig.until("a true position", rig.is_right)
            await rig.until("news of it", lambda: rig.said("usbl0: back after"))
            adapter.unplug()
            await rig.until("news of the loss", lambda: rig.said("usbl0: ")[2:])
            await rig.until("dead reckoning", lambda: rig.is_now(6, "A", "E"))
            assert rig.error_m(rig.epochs[-1]) is not None
            adapter.plug()
            await rig.until("a true position again", rig.is_right)
        assert rig.said("navigation: ") == [
            f"usblnav: navigation: {change}"
            for change in (
                "aligning (was invalid)",
                "aided (was aligning)",
                "dead_reckoning (was aided)",
                "aided (was dead_reckoning)",
            )
        ]
        # The inertial part went on all the while.
        assert max(b.t_s - a.t_s for a, b in pairwise(rig.epochs)) < 0.35


async def test_an_imu_behind_a_terminal_server_survives_junk_and_a_reset(tmp_path: Path) -> None:
    server = TcpEnd()
    with Cable(server) as cable:
        rig = Rig(tmp_path, cables={"imu0": cable})
        async with rig.gateway(), rig.emulator():
            rig.hear_zenoh()
            await rig.until("a true position", rig.is_right)
            junk = bytes(range(1, 250)) * 40
            server.send(junk)
            await rig.until("the junk", lambda: rig.device("imu0")["rejected_bytes"] >= len(junk))
            imu = rig.device("imu0")
            assert (imu["rejected_bytes"], imu["gaps"]) == (len(junk), 0)
            server.reset()
            line = f"imu0: tcp {server.link['host']}:{server.link['port']}: "
            (lost,) = await rig.until("the loss", lambda: rig.said(line))
            await rig.until("the recovery", lambda: rig.said("imu0: back after"))
            await rig.until("the gap", lambda: rig.device("imu0")["gaps"] == 1)
            seen = len(rig.navs)
            await rig.until("navigation", lambda: rig.navs[seen + 10 :] and rig.is_right())
            assert lost == f"usblnav: {line}connection reset by peer; trying until it is back"
            assert len(rig.said(line) + rig.said("imu0: back after")) == 2


async def test_a_stranger_is_refused_and_a_taken_port_waited_for(tmp_path: Path) -> None:
    end = UdpEnd(allow=["127.0.0.1"])
    with (
        Cable(end) as cable,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        rig = Rig(tmp_path, cables={"imu0": cable})
        holder.bind(("127.0.0.1", end.port))
        stranger.bind(("127.0.0.2", 0))
        async with rig.gateway(), rig.emulator():
            rig.hear_zenoh()
            await rig.until("news of the port", lambda: rig.said("address already in use"))
            holder.close()
            await rig.until("a true position", rig.is_right)
            spin = ImuRecord(
                t_rx_ns=0,
                sequence=0,
                delta_angle_rad=(0.0, 0.0, 0.5),
                specific_force_m_s2=(50.0, 0.0, 0.0),
            )
            for _ in range(100):
                stranger.sendto(KVH1750.encode(spin, KvhOptions()), ("127.0.0.1", end.port))
            await rig.until("count", lambda: rig.device("imu0")["refused_datagrams"] == 100)
            seen = len(rig.navs)
            await rig.until("a second more", lambda: rig.navs[seen + 10 :])
            await rig.until("a true position still", rig.is_right)
            assert rig.device("imu0")["gaps"] == 0


async def test_a_silent_imu_is_no_position_and_comes_back_by_itself(tmp_path: Path) -> None:
    with Cable(UdpEnd()) as cable:
        rig = Rig(tmp_path, cables={"imu0": cable})
        async with rig.gateway(), rig.emulator():
            rig.hear_zenoh()
            await rig.until("a true position", rig.is_right)
            cable.cut = True
            await rig.until("no position", lambda: rig.is_now(0, "V", "N"))
            assert rig.epochs[-1][-2:] == (None, None)
            await rig.until("an alarm", lambda: rig.said("imu0: silent for"))
            await rig.until("status", lambda: rig.statuses[-1]["mode"] == "invalid")
            assert rig.device("imu0")["silent_s"] > 1.0
            assert rig.device("usbl0")["silent_s"] < 1.0
            cable.cut = False
            await rig.until("news of it", lambda: rig.said("imu0: speaks"))
            await rig.until("a true position again", rig.is_right)
            await rig.until("the gap", lambda: rig.device("imu0")["gaps"] == 1)
            assert rig.device("imu0")["missing"] > 200


async def test_the_watchdog_starves_with_a_filter_that_hangs(tmp_path: Path) -> None:
    rig = Rig(tmp_path)

    def fed() -> list[float]:
        return rig.noticed("WATCHDOG=1")

    async with rig.gateway(WATCHDOG_USEC="1000000"), rig.emulator():
        await rig.until("a true position", rig.is_right)
        rig.notices.clear()
        await rig.until("food", lambda: fed()[2:])
        worker = rig.worker()
        os.kill(worker, signal.SIGSTOP)
        await rig.until("hunger", lambda: time.monotonic() - fed()[-1] > 1.5)
        assert rig.is_now(0, "V", "N")
        assert rig.said("navigation: no solution for 3 s")
        rig.notices.clear()
        os.kill(worker, signal.SIGCONT)
        await rig.until("food again", fed)
        await rig.until("a true position again", rig.is_right)
        assert any(notice.startswith("STATUS=aided; ") for _, notice in rig.notices)
        os.kill(worker, signal.SIGSTOP)  # the end of the gateway must not wait for it
    assert rig.notices[-1][1] == "STOPPING=1"


PLOTTER = """
import socket, sys
line = socket.socket()
line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
line.connect(("127.0.0.1", int(sys.argv[1])))
line.recv(100)
print("reading", flush=True)
while line.recv(4096):
    pass
"""
SUBSCRIBER = """
import json, sys, threading, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
heard = threading.Event()
held = session.declare_subscriber("usblnav/**", lambda sample: heard.set())
heard.wait()
print("reading", flush=True)
threading.Event().wait()
"""


@asynccontextmanager
async def stopped(script: str, *arguments: str) -> AsyncIterator[None]:
    """A program that reads what the gateway sends, and is then stopped."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", script, *arguments), stdout=asyncio.subprocess.PIPE
    )
    try:
        assert process.stdout is not None
        assert await asyncio.wait_for(process.stdout.readline(), 20) == b"reading\n"
        process.send_signal(signal.SIGSTOP)
        yield
    finally:
        process.kill()
        await process.wait()


async def ask(rig: Rig, *options: str) -> str:
    """What `usblnav status` prints."""
    process = await asyncio.create_subprocess_exec(
        *(*USBLNAV, "status", "-c", str(rig.config_file), *options),
        stdout=asyncio.subprocess.PIPE,
        cwd=ROOT,
    )
    said, _ = await asyncio.wait_for(process.communicate(), 30)
    assert process.returncode == 0
    return said.decode()


async def flood(rig: Rig) -> None:
    """Stop the daemon while more comes in than the system keeps for it; it is said, and counted."""
    place = ("127.0.0.1", rig.config["devices"]["imu0"]["link"]["port"])
    rig.process.send_signal(signal.SIGSTOP)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        for _ in range(30_000):
            line.sendto(b"junk", place)
    rig.process.send_signal(signal.SIGCONT)
    await rig.until("the loss", lambda: rig.said("imu0: the system's buffer is full, data is"))
    await rig.until("its count", lambda: rig.device("imu0")["kernel_dropped"] > 1_000)
    rig.navs.clear()
    await rig.until("solutions again", lambda: rig.navs)
    assert len(rig.said("is full")) == 1


async def test_stopped_readers_hold_up_nobody_and_are_counted(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_STREAM)
    rig = Rig(tmp_path)
    rig.terminal_closes = True
    sentences = ["GGA", "GLL", "RMC", "VTG", "HDT", "THS", "ZDA", "GST", "PUNAV"]
    link = {"type": "tcp", "port": port}
    server = {"type": "nmea", "link": link, "sentences": sentences, "rate_hz": 100}
    rig.write({"outputs": [*rig.config["outputs"], server]})
    async with (
        rig.gateway(),
        rig.emulator(),
        stopped(PLOTTER, str(port)),
        stopped(SUBSCRIBER, rig.endpoint),
    ):
        rig.hear_zenoh()
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        draining = asyncio.create_task(reader.read(-1))
        await rig.until("the plotter's end", lambda: rig.said("does not read, cut off"))
        await rig.until("the subscriber", lambda: rig.said("does not read; what it misses"))
        asked_at = len(rig.navs)
        table, report = await ask(rig), json.loads(await ask(rig, "--json"))
        await rig.until("more solutions", lambda: len(rig.navs) > asked_at + 10)
        await rig.until("a true position", rig.is_right)
        assert len(rig.said("does not read")) == 2
        writer.close()
        heard = (await draining).split(b"\r\n")
        await flood(rig)
    outputs = {output["name"]: output for output in report["outputs"]}
    assert outputs[f"tcp 127.0.0.1:{port}"]["clients_cut_off"] == 1
    zenoh = outputs["zenoh peer"]  # four seconds after it was seen to stall it is given up
    assert zenoh["clients_stalled"] + zenoh["clients_cut_off"] == 1
    assert {"imu0", "usbl0", f"127.0.0.1:{port}", "zenoh", "filter"} <= set(table.split())
    stages = {(row["stage"], row["of"]): row["recent"]["count"] for row in report["latency"]}
    assert min(stages[stage, "imu0"] for stage in ("decode", "hand on")) > 100
    assert min(stages[stage, "zenoh peer"] for stage in ("publish", "total")) > 10
    assert stages["filter", "filter"] > 100
    clocks = [line.split(b",")[1] for line in heard if line.startswith(b"$GPZDA")]
    times = [int(t[:2]) * 3600 + int(t[2:4]) * 60 + float(t[4:]) for t in clocks]
    assert len(times) > 200
    assert max((b - a) % 86400 for a, b in pairwise(times)) < 0.3


async def test_a_reader_of_standard_output_may_leave(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    command = '"$@" | head -n 20; exit "${PIPESTATUS[0]}"'
    run = (*USBLNAV, "run", "-c", str(rig.config_file), "--nmea", "-")
    async with rig.emulator():
        shell = await asyncio.create_subprocess_exec(
            *("bash", "-c", command, "bash", *run),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            cwd=ROOT,
        )
        out, err = await asyncio.wait_for(shell.communicate(), 20)
    assert shell.returncode == 0, err.decode()
    assert len(out.splitlines()) == 20
    assert out.startswith(b"$GPGGA,")
    assert b"Traceback" not in err
    assert err.splitlines()[-1] == b"usblnav: stopped"
