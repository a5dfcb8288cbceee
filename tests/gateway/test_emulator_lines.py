"""One line on which an emulated INS says all that it measures and what is wired to it."""

import socket
import threading
from collections import Counter
from itertools import pairwise

import msgspec
import numpy as np
import pytest

from drivers import registry
from drivers.records import DepthRecord, DvlRecord, GnssRecord, ImuRecord, Rejected
from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.instruments import emissions
from gateway.emulator.player import emulate
from gateway.emulator.trajectory import Trajectory
from gateway.ingest import intakes
from gateway.messages import BottomVelocity, Depth, ImuBlock, PositionFix
from gateway.nav import earth
from tests.gateway.emulated import START, demo_data, make
from tests.gateway.test_emulator_player import SILENT, packets

KINDS = {"imu0": ImuRecord, "dvl0": DvlRecord, "depth0": DepthRecord, "gnss0": GnssRecord}


def ins(port, **changes):
    """A PHINS with a log, a depth sensor and a receiver behind it."""
    by_time = {"codec": "stdbin", "port": port, "clock": {"source": "device", "latency_ms": 3.0}}
    imu = demo_data()["devices"]["imu0"] | by_time | {"options": {}, "rate_hz": 100.0}
    log = {"kind": "dvl", "noise": {"velocity_m_s": [0.01, 0.01, 0.01]}, "age_ms": 50.0}
    depth = {"kind": "depth", "noise": {"depth_m": 0.02}, "rate_hz": 4.0}
    receiver = {"kind": "gnss", "noise": {"position_m": [1, 1, 2], "velocity_m_s": 0.1}}
    devices = {
        "imu0": imu,
        "dvl0": log | by_time,
        "depth0": depth | by_time | {"lever_arm_m": [0, 0, 2]},
        "gnss0": receiver | by_time | {"says": ["GGA"], "lever_arm_m": [0, 0, -3]},
    }
    data = demo_data() | {"duration_s": 4.0, "devices": devices, "sea_bed_depth_m": 60.0}
    return data | {"beacons": {}} | changes


def test_one_line_one_decoder_four_devices():
    data = ins({"type": "pty", "symlink": "/tmp/ins", "baud": 115200})
    scenario = twin.sound(data)
    trajectory = Trajectory(scenario.trajectory, 4.0)
    config = msgspec.convert(twin.gateway_config(scenario), Config)
    assert config.lines == (("imu0", "gnss0", "depth0", "dvl0"),)
    line = intakes(config)["dvl0"]
    found = Counter()
    pieces = list(emissions(scenario, trajectory, START, 1.0))
    for e in pieces:
        line.feed(e.data, round(e.t * 1e9))
    line.close()
    for measurement in line.flush():
        found[type(measurement)] += 1
        if isinstance(measurement, Depth):
            r_e, _ = trajectory.point(np.array([measurement.t_ns * 1e-9]), (0.0, 0.0, 2.0))
            assert measurement.h == pytest.approx(earth.ecef_to_lla(r_e)[2][0], abs=0.1)
    assert found.pop(ImuBlock) > 0
    assert found == {BottomVelocity: 20, Depth: 16, PositionFix: 4}
    counts = {name: ingest.counts for name, ingest in line.ingests.items()}
    assert [counts[n].records for n in ("imu0", "dvl0", "depth0", "gnss0")] == [400, 20, 16, 4]
    assert sum(line.counts.rejected.values()) == 0
    # Frames wait for each other: between the first and the last piece of one nobody else speaks.
    assert all(a.last or a.device == b.device for a, b in pairwise(pieces))


def test_a_capture_has_them_in_one_stream(tmp_path):
    scenario = twin.sound(ins({"type": "tcp-server", "port": 7010}))
    report = emulate(scenario, pcap=tmp_path / "ins.pcap", **SILENT)
    flows = {(ip.data.sport, ip.data.dport) for _, ip in packets(tmp_path / "ins.pcap")}
    assert len(flows) == 1
    decoder = registry.lookup("stdbin").decoder(registry.lookup("stdbin").options())
    data = b"".join(ip.data.data for _, ip in packets(tmp_path / "ins.pcap"))
    kinds = Counter(type(record) for record in decoder.feed(data, 0))
    assert kinds == {KINDS[name]: sent.frames for name, sent in report.devices.items()}


@pytest.mark.live
def test_live_they_share_the_port_and_its_cable():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    pulled = {"fault": "unplug", "device": "dvl0", "at_s": 1.3, "for_s": 0.5}
    data = ins({"type": "tcp-server", "port": port}, start="now", duration_s=2.0, faults=[pulled])
    heard = bytearray()
    begun, reports = threading.Event(), []

    def play():
        reports.append(emulate(make(data), say=lambda line: "start" in line and begun.set()))

    player = threading.Thread(target=play)
    player.start()
    assert begun.wait(10.0)
    with socket.create_connection(("127.0.0.1", port)) as client:
        while piece := client.recv(65536):
            heard += piece
    player.join()
    (report,) = reports
    decoder = registry.lookup("stdbin").decoder(registry.lookup("stdbin").options())
    kinds = Counter(type(record) for record in decoder.feed(bytes(heard), 0))
    assert kinds.keys() == set(KINDS.values()), "all of them before the cable is pulled"
    assert Rejected not in kinds
    lost = {name: sent.dropped_bytes for name, sent in report.devices.items()}
    sent = sum(sent.bytes for sent in report.devices.values())
    assert sent == len(heard) + sum(lost.values())
    assert lost["imu0"] > 0
