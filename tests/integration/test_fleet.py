"""Three vehicles under one router, which is killed meanwhile: each stays in its place and goes on.

``pytest -m slow tests/integration/test_fleet.py``
"""

import asyncio
import json
import sys
from collections import defaultdict
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from tests.integration.rig import Rig, brisk
from tests.integration.zenoh_ends import session
from tests.loopback import free_endpoint, until

pytestmark = [pytest.mark.live, pytest.mark.slow]

VEHICLES = {"auv1": 10.0, "auv2": 20.0, "auv3": -30.0}
"""Where they are: latitude (deg)."""
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

ROUTER = """
import json, sys, zenoh
config = {"mode": "router", "listen": {"endpoints": [sys.argv[1]]},
          "scouting": {"multicast": {"enabled": False}}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
print("ready", flush=True)
sys.stdin.read()
"""


@asynccontextmanager
async def router(endpoint: str) -> AsyncIterator[None]:
    """A router in a process of its own, until it is killed."""
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", ROUTER, endpoint, stdin=pipe, stdout=pipe
    )
    try:
        assert process.stdout is not None
        assert await asyncio.wait_for(process.stdout.readline(), 15) == b"ready\n"
        yield
    finally:
        process.kill()
        await process.wait()


def vehicle(folder: Path, name: str, lat_deg: float, endpoint: str) -> Rig:
    """The packaged scenario elsewhere, its gateway a client of the router."""
    folder.mkdir()
    scenario = brisk(folder)
    moved = lat_deg - scenario["trajectory"]["lat_deg"]
    scenario["trajectory"]["lat_deg"] = lat_deg
    for beacon in scenario["beacons"].values():
        beacon["lat_deg"] += moved
    rig = Rig(folder, scenario | {"vehicle": name})
    ros = {"origin": {"lat_deg": lat_deg, "lon_deg": 116.2}}
    zenoh_output = {"type": "zenoh", "mode": "client", "connect": [endpoint], "ros": ros}
    rig.write({"outputs": [rig.config["outputs"][0], zenoh_output]})
    return rig


class Topside:
    """What the ship hears of its vehicles."""

    def __init__(self) -> None:
        self.navs: defaultdict[str, list[float]] = defaultdict(list)
        self.names: defaultdict[str, set[str]] = defaultdict(set)
        self.diagnosed: defaultdict[str, set[str]] = defaultdict(set)
        self._store = get_typestore(Stores.ROS2_JAZZY)

    def take(self, sample: zenoh.Sample) -> None:
        """Hear JSON."""
        _, name, topic = str(sample.key_expr).split("/")
        report = json.loads(sample.payload.to_bytes())
        if topic == "nav":
            self.navs[name].append(report["lat_deg"])
        elif topic == "status":
            self.names[name].add(report["vehicle"])

    def diagnose(self, sample: zenoh.Sample) -> None:
        """Hear ROS."""
        array = self._store.deserialize_cdr(sample.payload.to_bytes(), DIAGNOSTICS)
        for status in array.status:
            self.diagnosed[status.hardware_id].add(status.name)

    def everybody(self) -> bool:
        """Whether all vehicles were heard with solutions and status."""
        return all(len(self.navs[name]) > 5 and self.names[name] for name in VEHICLES)


async def test_a_fleet_outlives_its_router(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    rigs = {
        name: vehicle(tmp_path / name, name, lat_deg, endpoint)
        for name, lat_deg in VEHICLES.items()
    }
    async with AsyncExitStack() as fleet:
        async with router(endpoint):
            for rig in rigs.values():
                await fleet.enter_async_context(rig.gateway())
                await fleet.enter_async_context(rig.emulator())
            before = await heard(endpoint)
        pids = {name: rig.process.pid for name, rig in rigs.items()}
        for rig in rigs.values():
            await until(lambda rig=rig: rig.said("nobody answers; trying again"))
        async with router(endpoint):
            after = await heard(endpoint)
            for rig in rigs.values():
                await until(lambda rig=rig: rig.said("output zenoh client: back"))
        assert {name: rig.process.pid for name, rig in rigs.items()} == pids
        assert all(rig.process.returncode is None for rig in rigs.values())
    for topside in (before, after):
        for name, lat_deg in VEHICLES.items():
            assert topside.names[name] == {name}
            assert topside.navs[name] == pytest.approx([lat_deg] * len(topside.navs[name]), abs=0.1)
            assert {f"{name}: navigation", f"{name}: imu0", f"{name}: filter"} <= (
                topside.diagnosed[name]
            )


async def heard(endpoint: str) -> Topside:
    """Listen until all have been heard."""
    topside = Topside()
    with session(endpoint) as there:
        held = [
            there.declare_subscriber("usblnav/*/*", topside.take),
            there.declare_subscriber("0/diagnostics/**", topside.diagnose),
        ]
        await until(lambda: topside.everybody() and len(topside.diagnosed) == len(VEHICLES))
        for subscriber in held:
            subscriber.undeclare()
    return topside
