"""An INS on one port as the daemon hears it: samples, its log's velocities and its depth."""

import socket
from pathlib import Path

import pytest

from tests.integration.rig import Rig, brisk
from tests.loopback import free_port

pytestmark = pytest.mark.live


async def test_an_ins_with_its_log_and_depth_on_one_port(tmp_path: Path) -> None:
    data = brisk(tmp_path) | {"sea_bed_depth_m": 60.0}
    port = {"type": "udp", "port": free_port(socket.SOCK_DGRAM)}
    told = {"codec": "stdbin", "port": port}
    data["devices"]["imu0"] |= told | {"options": {}}
    dvl = {"kind": "dvl", "noise": {"velocity_m_s": [0.01, 0.01, 0.005]}}
    depth = {"kind": "depth", "noise": {"depth_m": 0.1}, "rate_hz": 5}
    data["devices"] |= {"dvl0": dvl | told, "depth0": depth | told}
    rig = Rig(tmp_path, data)
    async with rig.gateway():
        rig.hear_zenoh()
        async with rig.emulator():
            await rig.until("velocities", lambda: rig.device("dvl0").get("measurements", 0) > 2)
            await rig.until("depths", lambda: rig.device("depth0")["measurements"] > 2)
    imu, log, depth = (rig.device(name) for name in ("imu0", "dvl0", "depth0"))
    assert [d["line"] for d in (imu, log, depth)] == ["imu0"] * 3
    assert (log["bytes"], depth["bytes"], imu["rejected_bytes"]) == (0, 0, 0)
    assert rig.said("navigation: ")
    assert imu["bytes"] == imu["link"]["bytes"] == log["link"]["bytes"]
    assert sum(s["records"] for s in imu["link"]["senders"].values()) == (
        imu["records"] + log["records"] + depth["records"]
    )
    assert not any(d["ignored"] for d in (imu, log, depth))
