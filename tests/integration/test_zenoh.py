"""Zenoh between processes: what a program of somebody else's sees of a vehicle."""

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gateway.config import ZenohOutput
from gateway.messages import Calibration, Constant
from gateway.outputs.schema import calibration_report, nav_report
from gateway.outputs.zenoh import ZenohPublisher, open_publisher
from tests.gateway.test_outputs_schema import OFFSET_NS, solution
from tests.loopback import free_endpoint, until

pytestmark = pytest.mark.live

ROOT = Path(__file__).resolve().parents[2]

OTHER = """
import json, sys, threading, time
import zenoh
from zenoh import ext

endpoint, task = sys.argv[1:3]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("scouting/multicast/enabled", "false")
lock = threading.Lock()

def say(**what):
    with lock:
        print(json.dumps(what), flush=True)

def heard(sample):
    say(kind=str(sample.kind), key=str(sample.key_expr), encoding=str(sample.encoding),
        payload=sample.payload.to_string())

with zenoh.open(config) as session:
    if task == "subscribe":
        held = session.declare_subscriber("usblnav/**", heard)
    elif task == "late":
        held = ext.declare_advanced_subscriber(
            session, "usblnav/auv1/*", heard,
            history=ext.HistoryConfig(detect_late_publishers=True),
            recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
    elif task == "liveliness":
        held = session.liveliness().declare_subscriber("usblnav/*", heard, history=True)
    elif task == "get":
        for reply in session.get(sys.argv[3]):
            heard(reply.ok)
    say(kind="ready")
    sys.stdin.read()
    if task != "get":
        held.undeclare()
"""


def router(endpoint: str) -> ZenohOutput:
    return ZenohOutput(mode="router", listen=(endpoint,))


def peer(endpoint: str) -> ZenohOutput:
    return ZenohOutput(mode="peer", listen=(endpoint,))


class Other:
    """The other program: what it says, line by line."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    async def hear(self) -> dict[str, Any]:
        """Give the next thing it says."""
        assert self._process.stdout is not None
        line = await asyncio.wait_for(self._process.stdout.readline(), 15)
        return json.loads(line)

    async def ready(self) -> list[dict[str, Any]]:
        """Wait until it is set up; what it said before."""
        said = []
        while (word := await self.hear())["kind"] != "ready":
            said.append(word)
        return said


@asynccontextmanager
async def other(*arguments: str) -> AsyncIterator[Other]:
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", OTHER, *arguments, stdin=pipe, stdout=pipe
    )
    try:
        yield Other(process)
    finally:
        assert process.stdin is not None
        process.stdin.close()
        assert await asyncio.wait_for(process.wait(), 15) == 0


async def publish_until(publisher: ZenohPublisher, hearing: asyncio.Task[Any]) -> None:
    """Publish until the other program, whose declaration takes its time, has heard."""
    async with asyncio.timeout(15):
        while not hearing.done():
            publisher.publish("nav", nav_report(solution(), OFFSET_NS))
            await asyncio.wait([hearing], timeout=0.05)


async def hear_nav(publisher: ZenohPublisher, program: Other) -> dict[str, Any]:
    """Publish until the other program has heard; what it says."""
    hearing = asyncio.create_task(program.hear())
    await publish_until(publisher, hearing)
    return hearing.result()


@pytest.mark.parametrize("settings", [peer, router])
async def test_another_process_sees_the_solution(
    settings: Callable[[str], ZenohOutput],
) -> None:
    endpoint = free_endpoint()
    async with open_publisher(settings(endpoint), "auv1") as publisher:
        assert publisher.status().up
        async with other(endpoint, "subscribe") as program:
            await program.ready()
            heard = await hear_nav(publisher, program)
        assert (heard["key"], heard["encoding"]) == ("usblnav/auv1/nav", "application/json")
        data = json.loads(heard["payload"])
        assert (data["lat_deg"], data["mode"]) == (pytest.approx(39.8), "aided")
        assert publisher.status().dropped == 0


async def test_the_documented_subscriber_hears_the_vehicle() -> None:
    text = (ROOT / "docs/outputs.md").read_text()
    match = re.search(r"(?s)^python - <<'END'\n(.*?)^END$", text, re.MULTILINE)
    assert match is not None
    endpoint = free_endpoint()
    program = match[1].replace("tcp/127.0.0.1:7447", endpoint)
    assert endpoint in program
    async with open_publisher(peer(endpoint), "auv1") as publisher:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", program, stdout=asyncio.subprocess.PIPE
        )
        assert process.stdout is not None
        hearing = asyncio.create_task(process.stdout.readline())
        await publish_until(publisher, hearing)
        process.kill()
        await process.communicate()
    assert hearing.result().startswith(b'usblnav/auv1/nav {"utc_ns":')


async def test_the_documented_question_is_answered() -> None:
    text = (ROOT / "docs/outputs.md").read_text()
    match = re.search(r"(?s)^python - <<'ASK'\n(.*?)^ASK$", text, re.MULTILINE)
    assert match is not None
    endpoint = free_endpoint()
    program = match[1].replace("tcp/127.0.0.1:7447", endpoint)
    async with open_publisher(peer(endpoint), "auv1") as publisher:
        report = nav_report(solution(), OFFSET_NS)
        times = [time.time_ns() - age_s * 10**9 for age_s in (150, 60, 0)]
        for utc_ns in times:
            publisher.publish("nav", msgspec.structs.replace(report, utc_ns=utc_ns))
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", program, stdout=asyncio.subprocess.PIPE
        )
        said, _ = await asyncio.wait_for(process.communicate(), 15)
    lines = [line.split() for line in said.decode().splitlines()]
    assert [(key, int(utc_ns)) for key, utc_ns, *_ in lines] == [
        ("usblnav/auv1/nav", utc_ns) for utc_ns in times[1:]
    ]


async def test_a_late_subscriber_gets_the_last_of_each_key_at_once() -> None:
    endpoint = free_endpoint()
    async with open_publisher(peer(endpoint), "auv1") as publisher:
        for used in range(5):
            publisher.publish("nav", nav_report(solution(fixes_used=used), OFFSET_NS))
        constants = Calibration(0, (Constant("range_scale", 0.004, 1e-4),))
        publisher.publish("calibration", calibration_report(constants, OFFSET_NS))
        async with other(endpoint, "late") as program:
            heard = {}
            while len(heard) < 2:
                word = await program.hear()
                if "key" in word:
                    assert word["key"] not in heard
                    heard[word["key"]] = json.loads(word["payload"])
    assert heard["usblnav/auv1/nav"]["fixes_used"] == 4
    assert heard["usblnav/auv1/calibration"]["constants"]["range_scale"]["value"] == 0.004


async def test_a_query_is_answered_with_the_last_word() -> None:
    endpoint = free_endpoint()
    async with open_publisher(peer(endpoint), "auv1") as publisher:
        publisher.publish("nav", nav_report(solution(), OFFSET_NS))
        publisher.publish("status", {"mode": "aided"})
        async with other(endpoint, "get", "usblnav/auv1/status") as program:
            (status,) = await program.ready()
        async with other(endpoint, "get", "usblnav/**") as program:
            everything = await program.ready()
    assert (status["key"], status["payload"]) == ("usblnav/auv1/status", '{"mode":"aided"}')
    assert status["encoding"] == "application/json"
    assert {w["key"] for w in everything} == {"usblnav/auv1/nav", "usblnav/auv1/status"}


async def test_liveliness_comes_and_goes_with_the_vehicle() -> None:
    endpoint, vehicle_endpoint = free_endpoint(), free_endpoint()
    vehicle = ZenohOutput(mode="peer", connect=(endpoint,), listen=(vehicle_endpoint,))
    async with (
        open_publisher(router(endpoint), "ship"),
        other(endpoint, "liveliness") as program,
    ):
        words = [await program.hear() for _ in range(2)]
        assert "usblnav/ship" in [w.get("key") for w in words]
        async with open_publisher(vehicle, "auv1"):
            assert (await program.hear())["key"] == "usblnav/auv1"
        gone = await program.hear()
    assert (gone["key"], gone["kind"]) == ("usblnav/auv1", "SampleKind.DELETE")


async def test_a_port_in_use_is_one_line_and_taken_once_it_is_free(
    caplog: pytest.LogCaptureFixture,
) -> None:
    endpoint = free_endpoint()
    port = int(endpoint.rpartition(":")[2])
    with socket.create_server(("127.0.0.1", port)) as holder:
        async with open_publisher(peer(endpoint), "auv1") as publisher:
            publisher.publish("nav", nav_report(solution(fixes_used=7), OFFSET_NS))
            status = publisher.status()
            assert (status.up, status.sent, status.dropped) == (False, 0, 1)
            assert "Address already in use" in status.error
            holder.close()
            await until(lambda: publisher.status().up)
            async with other(endpoint, "get", "usblnav/auv1/nav") as program:
                (heard,) = await program.ready()
    assert json.loads(heard["payload"])["fixes_used"] == 7
    complaints = [m for m in caplog.messages if "trying again" in m]
    assert len(complaints) == 1
    assert ".rs" not in complaints[0]


async def test_a_client_waits_for_its_router_and_outlives_it(
    caplog: pytest.LogCaptureFixture,
) -> None:
    endpoint = free_endpoint()
    settings = ZenohOutput(mode="client", connect=(endpoint,))
    async with open_publisher(settings, "auv1") as publisher:
        assert not publisher.status().up
        assert "nobody answers" in publisher.status().error
        for _ in range(2):
            async with open_publisher(router(endpoint), "ship"):
                await until(lambda: publisher.status().up)
                async with other(endpoint, "subscribe") as program:
                    await program.ready()
                    assert (await hear_nav(publisher, program))["key"] == "usblnav/auv1/nav"
            await until(lambda: not publisher.status().up)
            publisher.publish("nav", nav_report(solution(), OFFSET_NS))
    assert len([m for m in caplog.messages if "trying again" in m]) == 1


def listening(pid: int) -> set[str]:
    """Addresses on which a process listens (TCP) or is bound (UDP), from /proc."""
    inodes = {
        match[1]
        for entry in Path(f"/proc/{pid}/fd").iterdir()
        if (match := re.match(r"socket:\[(\d+)\]", str(entry.readlink())))
    }
    found = set()
    for name in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/{pid}/net/{name}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes and (fields[3] == "0A" or name.startswith("udp")):
                found.add(f"{name} {fields[1]}")
    return found


DAEMON = """
import asyncio, signal, sys
import msgspec
from gateway.__main__ import leave
from gateway.config import ZenohOutput
from gateway.outputs.zenoh import open_publisher

async def main():
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    settings = msgspec.json.decode(sys.argv[1], type=ZenohOutput)
    async with open_publisher(settings, "auv1") as publisher:
        publisher.publish("status", {"mode": "aided"})
        print(publisher.status().up, flush=True)
        await stop.wait()

asyncio.run(main())
sys.exit(leave(0))
"""


def daemon(**settings: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", DAEMON, json.dumps({"type": "zenoh", **settings})],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


def terminate(process: "subprocess.Popen[str]") -> float:
    """Ask a daemon to end; how long it took (s)."""
    before = time.monotonic()
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=30)
    assert process.returncode == 0
    return time.monotonic() - before


@pytest.mark.parametrize("given", ["listen", "connect"])
def test_it_listens_where_it_was_told_and_nowhere_else(given: str) -> None:
    endpoint = free_endpoint()
    process = daemon(mode="peer", **{given: [endpoint]})
    assert process.stdout is not None
    assert process.stdout.readline() == "True\n"
    port = int(endpoint.rpartition(":")[2])
    expected = {f"tcp 0100007F:{port:04X}"} if given == "listen" else set()
    assert listening(process.pid) == expected
    assert terminate(process) < 2.0


def test_a_router_that_never_answers_holds_up_neither_start_nor_end() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        process = daemon(mode="client", connect=[f"tcp/127.0.0.1:{silent.getsockname()[1]}"])
        assert process.stdout is not None
        before = time.monotonic()
        assert process.stdout.readline() == "False\n"
        assert time.monotonic() - before < 8.0
        assert terminate(process) < 2.0
