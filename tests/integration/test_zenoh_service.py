"""What a declared publisher promises: services, times, the past for who asks, and coming back."""

import asyncio
import json
import signal
import struct
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from gateway.config import MapOrigin, ZenohOutput, ZenohRos
from gateway.outputs.schema import nav_report
from gateway.outputs.zenoh import ZenohPublisher, open_publisher
from tests.gateway.test_outputs_schema import OFFSET_NS, solution
from tests.integration.zenoh_ends import Wire, session
from tests.loopback import free_endpoint, until

pytestmark = pytest.mark.live

NAV = "usblnav/auv1/nav"


def publish(publisher: ZenohPublisher, utc_ns: int | None = None) -> None:
    utc_ns = utc_ns or time.time_ns()
    report = nav_report(solution(), OFFSET_NS)
    publisher.publish("nav", msgspec.structs.replace(report, utc_ns=utc_ns, t_s=utc_ns / 1e9))


def ask(there: zenoh.Session, selector: str) -> list[Any]:
    return [json.loads(reply.ok.payload.to_bytes()) for reply in there.get(selector) if reply.ok]


@pytest.mark.parametrize(
    ("settings", "express"), [({}, True), ({"rate_hz": 200.0}, False), ({"express": False}, False)]
)
async def test_navigation_goes_first_and_at_once_with_its_own_time(
    settings: dict[str, Any], express: bool
) -> None:
    endpoint, heard = free_endpoint(), {}
    async with open_publisher(ZenohOutput(listen=(endpoint,), **settings), "auv1") as publisher:
        with session(endpoint) as there:
            held = there.declare_subscriber(
                "usblnav/**", lambda sample: heard.setdefault(str(sample.key_expr), sample)
            )
            await until(lambda: NAV in heard, lambda: publish(publisher, 1_777_777_777_123_456_789))
            await until(
                lambda: len(heard) == 2, lambda: publisher.publish("status", {"mode": "aided"})
            )
            held.undeclare()
    nav, status = heard[NAV], heard["usblnav/auv1/status"]
    assert (nav.priority, nav.express) == (zenoh.Priority.REAL_TIME, express)
    assert (status.priority, status.express) == (zenoh.Priority.DATA_LOW, False)
    for sample in (nav, status):
        assert sample.congestion_control == zenoh.CongestionControl.DROP
        assert sample.encoding == zenoh.Encoding.APPLICATION_JSON
    told = nav.timestamp.get_time_as_ntp64()
    assert told.as_secs() * 10**9 + told.subsec_nanos() == pytest.approx(
        1_777_777_777_123_456_789, abs=1
    )
    assert abs(status.timestamp.get_time().timestamp() - time.time()) < 5.0


async def test_the_past_is_given_as_far_as_it_is_asked_for() -> None:
    endpoint, now = free_endpoint(), time.time_ns()
    settings = ZenohOutput(listen=(endpoint,), history_s=60.0)
    async with open_publisher(settings, "auv1") as publisher:
        for age_s in range(90, -1, -1):
            publish(publisher, now - age_s * 10**9)
        publisher.publish("status", {"mode": "aided"})
        with session(endpoint) as there:

            async def answers(selector: str) -> list[Any]:
                return await asyncio.to_thread(ask, there, selector)

            (last,) = await answers(NAV)
            everything = await answers(f"{NAV}?_time=[now(-2m)..]")
            recent = await answers(f"{NAV}?_time=[now(-30.5s)..]")
            both = await answers("usblnav/auv1/*?_time=[now(-10s)..]")
            (refusal,) = await asyncio.to_thread(lambda: list(there.get(f"{NAV}?_time=120")))
    assert last["utc_ns"] == now
    assert [r["utc_ns"] for r in everything] == [now - age * 10**9 for age in range(60, -1, -1)]
    assert 25 <= len(recent) <= 31
    assert {"mode": "aided"} in both
    assert "no range of times" in refusal.err.payload.to_string()


async def test_a_great_past_is_given_whole_while_navigation_goes_on() -> None:
    endpoint, now, count = free_endpoint(), time.time_ns(), 5000
    async with open_publisher(ZenohOutput(listen=(endpoint,)), "auv1") as publisher:
        for n in range(count):
            publish(publisher, now - (count - n) * 5_000_000)
        with session(endpoint) as there:
            asking = asyncio.create_task(asyncio.to_thread(ask, there, f"{NAV}?_time=[..]"))
            turns = 0
            while not asking.done():
                publish(publisher)
                turns += 1
                await asyncio.sleep(0.002)
            answers = asking.result()
    times = [report["utc_ns"] for report in answers]
    assert len(times) >= count
    assert times == sorted(times)
    assert turns > 10


EAGER = {"connect": {"retry": {"period_init_ms": 100, "period_increase_factor": 1.0}}}
"""Zenoh tries again sooner than by itself: one second, two, four."""
IMPATIENT = EAGER | {"transport": {"link": {"tx": {"lease": 1000}}}}
"""And believes in a silent connection for one second instead of ten."""


@pytest.mark.parametrize("mode", ["client", pytest.param("peer", marks=pytest.mark.slow)])
async def test_after_its_router_a_vehicle_is_as_it_was(
    mode: Any, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    endpoint = free_endpoint()
    router = ZenohOutput(mode="router", listen=(endpoint,))
    settings = ZenohOutput(mode=mode, connect=(endpoint,), config=EAGER)
    async with open_publisher(router, "ship"):
        opening = open_publisher(settings, "auv1")
        publisher = await opening.__aenter__()
    try:
        await until(lambda: publisher.status().error)
        assert publisher.status().error == f"{endpoint}: nobody answers"
        publish(publisher, 4_000_000_000)
        async with open_publisher(router, "ship"):
            await until(lambda: publisher.status().up and not publisher.status().error)
            with session(endpoint) as there:
                tokens = await asyncio.to_thread(lambda: list(there.liveliness().get("usblnav/*")))
                heard: list[zenoh.Sample] = []
                held = there.declare_subscriber(NAV, heard.append)
                (last,) = await asyncio.to_thread(ask, there, NAV)
                await until(lambda: heard, lambda: publish(publisher))
                held.undeclare()
    finally:
        await opening.__aexit__(None, None, None)
    assert {str(token.ok.key_expr) for token in tokens} == {"usblnav/ship", "usblnav/auv1"}
    assert last["utc_ns"] == 4_000_000_000
    ours = [m for m in caplog.messages if f"zenoh {mode}" in m]
    assert ours[:2] == [
        f"output zenoh {mode}: {endpoint}: nobody answers; trying again",
        f"output zenoh {mode}: back",
    ]


async def test_a_network_that_goes_silent_is_noticed_and_comes_back() -> None:
    endpoint = free_endpoint()
    router = ZenohOutput(mode="router", listen=(endpoint,), config=IMPATIENT)
    heard: list[zenoh.Sample] = []
    async with open_publisher(router, "ship"), Wire(endpoint) as wire:
        settings = ZenohOutput(mode="client", connect=(wire.endpoint,), config=IMPATIENT)
        async with open_publisher(settings, "auv1") as publisher:
            with session(endpoint) as there:
                held = there.declare_subscriber(NAV, heard.append)
                await until(lambda: heard, lambda: publish(publisher))
                wire.cut()
                await until(lambda: not publisher.status().up, lambda: publish(publisher))
                wire.mend()
                await until(lambda: publisher.status().up)
                heard.clear()
                await until(lambda: heard, lambda: publish(publisher))
                held.undeclare()


SUBSCRIBER = """
import json, sys, zenoh
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
held = session.declare_subscriber("usblnav/**", lambda sample: print("heard", flush=True))
sys.stdin.read()
"""


async def test_a_killed_subscriber_is_not_felt() -> None:
    endpoint = free_endpoint()
    pipe = subprocess.PIPE
    async with open_publisher(ZenohOutput(listen=(endpoint,)), "auv1") as publisher:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", SUBSCRIBER, endpoint, stdin=pipe, stdout=pipe
        )
        assert process.stdout is not None
        hearing = asyncio.create_task(process.stdout.readline())
        await until(hearing.done, lambda: publish(publisher))
        process.send_signal(signal.SIGKILL)
        await process.wait()
        dropped = publisher.status().dropped
        heard: list[zenoh.Sample] = []
        with session(endpoint) as there:
            held = there.declare_subscriber(NAV, heard.append)
            await until(lambda: len(heard) > 10, lambda: publish(publisher))
            held.undeclare()
        await until(lambda: publisher.status().clients == 0)
        assert publisher.status().dropped == dropped == 0


ORIGIN = MapOrigin(lat_deg=39.8, lon_deg=116.2)


@dataclass
class RosEar:
    """What a ROS 2 system would see of a vehicle: its samples and its tokens."""

    samples: dict[str, zenoh.Sample]
    tokens: set[str]


async def ros_ear(ros: ZenohRos, looks_at: str) -> RosEar:
    endpoint, samples = free_endpoint(), {}
    async with open_publisher(ZenohOutput(listen=(endpoint,), ros=ros), "auv-1") as publisher:
        with session(endpoint) as there:
            held = there.declare_subscriber(
                "**", lambda sample: samples.__setitem__(str(sample.key_expr), sample)
            )
            await until(lambda: len(samples) == 4, lambda: publish(publisher))
            tokens = await asyncio.to_thread(lambda: list(there.liveliness().get(looks_at)))
            held.undeclare()
    del samples["usblnav/auv-1/nav"]
    return RosEar(samples, {str(token.ok.key_expr) for token in tokens if token.ok})


async def test_the_zenoh_middleware_of_ros_finds_odometry_and_fix() -> None:
    ear = await ros_ear(ZenohRos(origin=ORIGIN, domain=3, rate_hz=1000.0), "@ros2_lv/3/**")
    (odometry,) = (sample for key, sample in ear.samples.items() if "Odometry" in key)
    domain, namespace, topic, kind, kind_hash = str(odometry.key_expr).split("/")
    assert (domain, namespace, topic, kind) == (
        *("3", "auv_1", "odometry"),
        "nav_msgs::msg::dds_::Odometry_",
    )
    store = get_typestore(Stores.ROS2_JAZZY)
    assert kind_hash == store.hash_rihs01("nav_msgs/msg/Odometry")
    message = store.deserialize_cdr(odometry.payload.to_bytes(), "nav_msgs/msg/Odometry")
    assert message.header.frame_id == "map"
    sequence, source_ns, size = struct.unpack_from("<qqB", odometry.attachment.to_bytes())
    assert (sequence >= 1, size, len(odometry.attachment.to_bytes())) == (True, 16, 33)
    assert abs(source_ns - time.time_ns()) < 20e9
    assert odometry.encoding == zenoh.Encoding.APPLICATION_CDR
    by_kind = {token.split("/")[5]: token.split("/") for token in ear.tokens}
    assert by_kind["NN"][6:] == ["%", "%auv_1", "usblnav"]
    assert len(ear.tokens) == 5
    published = {token.split("/")[9] for token in ear.tokens if "/MP/" in token}
    assert published == {
        *("%auv_1%odometry", "%auv_1%fix", "%auv_1%imu%data"),
        "%diagnostics",
    }
    identities = [(token.split("/")[2], token.split("/")[4]) for token in ear.tokens]
    assert len(set(identities)) == 5


async def test_the_bridge_of_ros_to_dds_finds_them_by_their_topics() -> None:
    settings = ZenohRos(origin=ORIGIN, keys="ros2dds", namespace="/fleet/auv1", rate_hz=1000.0)
    ear = await ros_ear(settings, "@/*/@ros2_lv/**")
    topics = {"fleet/auv1/odometry", "fleet/auv1/fix", "fleet/auv1/imu/data"}
    assert set(ear.samples) == topics
    announced = {token.split("/")[4].replace("§", "/") for token in ear.tokens}
    assert announced == topics | {"diagnostics"}
    fix = ear.samples["fleet/auv1/fix"].payload.to_bytes()
    message = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(fix, "sensor_msgs/msg/NavSatFix")
    assert (message.latitude, message.status.status) == (pytest.approx(39.8), 0)
