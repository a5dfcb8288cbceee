"""A ROS 2 system's view of a gateway, by zenoh-ros2-sdk, which speaks as rmw_zenoh does.

``pip install zenoh-ros2-sdk`` and ``pytest -m slow tests/integration/test_ros_sdk.py``.
"""

import asyncio
import time
from pathlib import Path
from typing import Any

import pytest
import xxhash
import zenoh
from rosbags.typesys import Stores, get_typestore

from tests.integration.rig import ROS, Rig
from tests.integration.zenoh_ends import session
from tests.loopback import until

sdk = pytest.importorskip("zenoh_ros2_sdk", reason="no zenoh-ros2-sdk")
pytestmark = [pytest.mark.live, pytest.mark.slow]

TOPICS = {
    "/demo/odometry": "nav_msgs/msg/Odometry",
    "/demo/fix": "sensor_msgs/msg/NavSatFix",
    "/demo/imu/data": "sensor_msgs/msg/Imu",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
JAZZY = get_typestore(Stores.ROS2_JAZZY)


def key(topic: str, kind: str) -> str:
    """Where such a system listens to a topic: the library's key, with rosbags' hash."""
    package, _, name = kind.split("/")
    dds = f"{package}::msg::dds_::{name}_"
    found: str = sdk.keyexpr.topic_keyexpr(0, topic, dds, JAZZY.hash_rihs01(kind))
    return found


async def test_its_topics_are_found_heard_and_known_by_their_publishers(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    router = {"type": "zenoh", "mode": "router", "listen": [rig.endpoint], "ros": ROS}
    rig.write({"outputs": [rig.config["outputs"][0], router]})
    heard: dict[str, zenoh.Sample] = {}
    async with rig.gateway(), rig.emulator():
        await rig.until("a true position", rig.is_right)
        where = {"router_port": int(rig.endpoint.rpartition(":")[2]), "timeout": 5.0}
        listed = await asyncio.to_thread(sdk.get_topic_names_and_types, 0, **where)
        with session(rig.endpoint) as there:
            tokens = await asyncio.to_thread(lambda: list(there.liveliness().get("@ros2_lv/0/**")))
            held = [there.declare_subscriber(key(*t), keep(heard, t[0])) for t in TOPICS.items()]
            await until(lambda: len(heard) == len(TOPICS))
            for subscriber in held:
                subscriber.undeclare()
    assert dict(listed) == {topic: [kind] for topic, kind in TOPICS.items()}
    known = {xxhash.xxh3_128_intdigest(t): t for t in (str(r.ok.key_expr).encode() for r in tokens)}
    for topic, sample in heard.items():
        JAZZY.deserialize_cdr(sample.payload.to_bytes(), TOPICS[topic])
        said = sdk.attachment.Attachment.from_bytes(sample.attachment.to_bytes())
        assert abs(said.timestamp_ns - time.time_ns()) < 60e9
        token = known[int.from_bytes(said.gid, "little")].decode().split("/")
        assert (token[5], token[9].replace("%", "/")) == ("MP", topic)


def keep(heard: dict[str, zenoh.Sample], topic: str) -> Any:
    """Take the samples of a topic."""
    return lambda sample: heard.__setitem__(topic, sample)
