"""The processes at both ends of the live benchmark, and bare loops beside it.

``python -m tests.bench.ends ROLE ...``: each says "ready" when it is, works until its standard
input is closed (or its work is done), and leaves its stamps (host monotonic ns, int64) in a file.
"""

import asyncio
import gc
import json
import os
import socket
import sys
import threading
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
import zenoh

from drivers.capture import read_streams
from gateway.config import ZenohOutput, load
from gateway.outputs.schema import nav_report
from gateway.outputs.zenoh import open_publisher
from tests.gateway.solutions import solution as fixed_solution

Stamps: TypeAlias = "array[int]"

BARE_BYTES = 700
"""As long as a solution in JSON."""
SETTLE_S = 0.3


class Stamp(msgspec.Struct):
    """What is read of a solution."""

    utc_ns: int


def main(role: str, out: str, fifo: str, *arguments: str) -> None:
    """Play one role."""
    if int(fifo):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(fifo)))
    rows = array("q")
    gc.collect()
    gc.freeze()
    gc.disable()
    ROLES[role](rows, *arguments)
    with Path(out).open("wb") as file:
        rows.tofile(file)
    sys.stdout.flush()
    os._exit(0)  # zenoh's threads may be in the middle of something


def send(rows: Stamps, config_file: str, capture: str) -> None:
    """Send a capture's datagrams when they are due; rows: sent, due, whether it is a fix."""
    config = load(Path(config_file))
    links = {name: device.link for name, device in config.devices.items()}
    to = {name: ("127.0.0.1", link.port) for name, link in links.items()}
    imu = config.imu[0]
    packets = list(read_streams([Path(capture)], links))
    gc.freeze()
    say_ready()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        begin = time.monotonic_ns() + 200_000_000 - packets[0][2]
        for name, data, t_ns, _ in packets:
            due = begin + t_ns
            wait_until(due)
            now = time.monotonic_ns()
            line.sendto(data, to[name])
            rows.extend((now, due, name != imu))


def hear_zenoh(rows: Stamps, endpoint: str, key: str) -> None:
    """Hear solutions; rows: heard, time of validity."""
    decoder = msgspec.json.Decoder(Stamp)

    def take(sample: zenoh.Sample) -> None:
        now = time.monotonic_ns()
        utc_ns = decoder.decode(sample.payload.to_bytes()).utc_ns
        rows.extend((now, utc_ns - (time.time_ns() - time.monotonic_ns())))

    with client(endpoint) as session:
        held = session.declare_subscriber(key, take)
        say_ready()
        until_told()
        held.undeclare()


def hear_nmea(rows: Stamps, port: str) -> None:
    """Hear epochs that begin with RMC; rows: heard, its time (hundredths of a second)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", int(port)))
        ear.settimeout(0.5)
        say_ready()
        told = threading.Thread(target=until_told, daemon=True)
        told.start()
        while told.is_alive():
            try:
                data = ear.recv(4096)
            except TimeoutError:
                continue
            now, utc = time.monotonic_ns(), datetime.now(UTC)
            offset_ns = time.time_ns() - time.monotonic_ns()
            rows.extend((now, utc_ns_of(data.split(b",", 2)[1].decode(), utc) - offset_ns))


def utc_ns_of(hhmmss: str, now: datetime) -> int:
    """Unix time of a time of day that is near `now`."""
    t = datetime.strptime(hhmmss + "0000", "%H%M%S.%f").replace(
        year=now.year, month=now.month, day=now.day, tzinfo=UTC
    )
    days = round((now - t) / timedelta(days=1))
    return round((t + timedelta(days=days)).timestamp() * 100) * 10_000_000


def publish(_: Stamps, endpoint: str, rate: str, seconds: str) -> None:
    """Publish stamps over Zenoh by turns: bare, and as the gateway does its solutions."""
    asyncio.run(_publish(endpoint, float(rate), float(seconds)))


async def _publish(endpoint: str, rate_hz: float, seconds: float) -> None:
    settings = ZenohOutput(mode="client", connect=(endpoint,), rate_hz=rate_hz)
    solution = nav_report(fixed_solution(), 0)
    with client(endpoint) as session:
        bare = session.declare_publisher("bare")
        async with open_publisher(settings, "bench") as ours:
            await asyncio.sleep(SETTLE_S)  # both are known at the far end
            say_ready()
            for n, _due in enumerate(ticks(2.0 * rate_hz, seconds)):
                if n % 2:
                    bare.put(time.monotonic_ns().to_bytes(8, "little") + bytes(BARE_BYTES - 8))
                else:
                    now_ns = time.monotonic_ns()
                    ours.publish("nav", msgspec.structs.replace(solution, utc_ns=now_ns))
                await asyncio.sleep(0)
            await asyncio.sleep(SETTLE_S)


def hear(rows: Stamps, endpoint: str) -> None:
    """Hear stamps over Zenoh; rows: whether it was the gateway's, how long it was under way."""
    decoder = msgspec.json.Decoder(Stamp)

    def take_bare(sample: zenoh.Sample) -> None:
        now = time.monotonic_ns()
        rows.extend((0, now - int.from_bytes(sample.payload.to_bytes()[:8], "little")))

    def take_ours(sample: zenoh.Sample) -> None:
        now = time.monotonic_ns()
        rows.extend((1, now - decoder.decode(sample.payload.to_bytes()).utc_ns))

    with zenoh.open(configuration("peer", "listen", endpoint)) as session:
        held = [
            session.declare_subscriber("bare", take_bare),
            session.declare_subscriber("usblnav/bench/nav", take_ours),
        ]
        say_ready()
        until_told()
        for subscriber in held:
            subscriber.undeclare()


def two_hops(rows: Stamps, rate: str, seconds: str, fifo: str) -> None:
    """There and back between two processes by SOCK_SEQPACKET; rows: how long that took."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    if os.fork() == 0:
        ours.close()
        if int(fifo):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(fifo)))
        while data := theirs.recv(4096):
            theirs.send(data)
        os._exit(0)
    theirs.close()
    say_ready()
    message = bytes(100)
    for _due in ticks(float(rate), float(seconds)):
        sent = time.monotonic_ns()
        ours.send(message)
        ours.recv(4096)
        rows.append(time.monotonic_ns() - sent)
    ours.close()
    os.wait()


ROLES: dict[str, Callable[..., None]] = {
    "send": send,
    "hear-zenoh": hear_zenoh,
    "hear-nmea": hear_nmea,
    "publish": publish,
    "hear": hear,
    "two-hops": two_hops,
}


def ticks(rate_hz: float, seconds: float) -> Iterator[int]:
    """Absolute times at a rate, each when it has come."""
    begin = time.monotonic_ns() + 100_000_000
    for n in range(round(rate_hz * seconds)):
        due = begin + round(n / rate_hz * 1e9)
        wait_until(due)
        yield due


def wait_until(due_ns: int) -> None:
    """Sleep to an absolute time."""
    while (left := due_ns - time.monotonic_ns()) > 0:
        time.sleep(left * 1e-9)


def say_ready() -> None:
    """Tell who started us."""
    print("ready", flush=True)


def until_told() -> None:
    """Wait for the end of standard input."""
    os.read(0, 1)


@contextmanager
def client(endpoint: str) -> Iterator[zenoh.Session]:
    """A session with what listens at an endpoint."""
    with zenoh.open(configuration("client", "connect", endpoint)) as session:
        yield session


def configuration(mode: str, how: str, endpoint: str) -> Any:
    """Zenoh with one endpoint and nothing else."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5(f"{how}/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return config


if __name__ == "__main__":
    main(*sys.argv[1:])
