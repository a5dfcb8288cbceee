"""Devices that share a line: one decoder, every record counted once by the device that takes it."""

import logging
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers import registry
from drivers.capture.streams import read_streams
from drivers.records import DvlRecord, HeadingRecord, ImuRecord
from drivers.settings import UdpLink
from gateway import replay
from gateway.config import Config
from gateway.config.checks import cross_faults
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.health.lines import FIRST_S, SILENT_S, Line
from gateway.ingest import Intake, intakes
from gateway.messages import ImuBlock
from gateway.schema import build
from tests.gateway.emulated import demo_data, make
from tests.shared_data import shared

PORT = {"type": "udp", "port": 8200, "bind": "0.0.0.0"}
INS = {"codec": "stdbin", "link": PORT}
WALKS = {"angle_random_walk_deg_sqrt_h": 0.01, "velocity_random_walk_ug_sqrt_hz": 50}
IMU = {
    "kind": "imu",
    "rate_hz": 100,
    "noise": WALKS | {"gyro_bias_deg_h": 0.1, "accel_bias_ug": 100},
}
DVL = {"kind": "dvl", "noise": {"velocity_m_s": [0.01, 0.01, 0.005]}}
EVERYTHING = {
    "imu0": IMU,
    "usbl0": {"kind": "usbl", "noise": {"bearing_deg": 1, "elevation_deg": 1, "range_m": 1}},
    "lbl0": {"kind": "lbl", "noise": {"range_m": 1}},
    "gnss0": {"kind": "gnss", "noise": {"position_m": [1, 1, 2], "velocity_m_s": 0.1}},
    "depth0": {"kind": "depth", "noise": {"depth_m": 0.1}, "surface_height_m": 0.0},
    "dvl0": DVL,
    "gyro0": {"kind": "heading", "noise": {"heading_deg": 0.5}},
}


def configured(*names: str, **changes: dict[str, Any]) -> Config:
    """Devices of the INS by name, in this order."""
    plain = twin.gateway_config(make(demo_data()))
    plain["devices"] = {n: EVERYTHING[n] | INS | changes.get(n, {}) for n in names}
    faults: list[str] = []
    config = build(Config, plain, faults)
    assert config is not None, faults
    return config


def telegrams() -> bytes:
    """Real telegrams with a block of every kind."""
    return bytes.fromhex(shared("vectors", "imu", "ixblue_stdbin_v3.hex").read_text())


def of_kind(data: bytes) -> Counter[str]:
    """How many records of each kind the codec itself finds."""
    codec = registry.lookup("stdbin")
    decoder = codec.decoder(codec.options())
    found = [*decoder.feed(data, 0), *decoder.close()]
    return Counter(type(record).__name__ for record in found)


def heard(config: Config, data: bytes) -> dict[str, Intake]:
    ways = intakes(config)
    ways["imu0"].feed(data, 10**12)
    ways["imu0"].close()
    return ways


def test_each_takes_the_records_of_its_kind() -> None:
    found = of_kind(telegrams())
    ways = heard(configured(*EVERYTHING), telegrams())
    (line,) = dict.fromkeys(ways.values())
    records = {name: ingest.counts.records for name, ingest in line.ingests.items()}
    assert records == {
        "imu0": found["ImuRecord"] + found["CompensatedRecord"],
        "usbl0": found["UsblRecord"],
        "lbl0": found["LblRecord"],
        "gnss0": found["GnssRecord"],
        "depth0": found["DepthRecord"],
        "dvl0": found["DvlRecord"],
        "gyro0": found["HeadingRecord"],
    }
    assert min(records.values()) > 0 and sum(records.values()) == found.total()
    assert line.counts.ignored == {"not_imu": found["CompensatedRecord"]}
    assert {type(m) for m in line.flush()} > {ImuBlock}
    assert line.ingests["depth0"].counts.measurements == found["DepthRecord"]


def test_bytes_and_junk_count_once_for_the_line() -> None:
    data = b"no telegram" + telegrams()
    line = heard(configured(*EVERYTHING), data)["imu0"]
    counts = [ingest.counts for ingest in line.ingests.values()]
    assert [c.bytes for c in counts] == [len(data)] + [0] * 6
    assert [c.rejected_bytes for c in counts] == [11] + [0] * 6


def test_what_nobody_takes_is_ignored_where_the_line_has_its_name_from() -> None:
    found = of_kind(telegrams())
    line = heard(configured("dvl0", "imu0"), telegrams())["dvl0"]
    assert line.name == "imu0"  # whatever the order in the file
    others = found.total() - found["ImuRecord"] - found["DvlRecord"]
    assert line.counts.ignored == {"not_imu": others}
    assert line.ingests["dvl0"].counts.records == found["DvlRecord"]
    assert "not_dvl" not in line.ingests["dvl0"].counts.ignored


def spoken() -> Iterator[bytes]:
    """A second of samples, a velocity every tenth and a heading every seventh telegram."""
    codec = registry.lookup("stdbin")
    options = codec.options()
    for k in range(100):
        t_s = 40_000.0 + 0.01 * k
        sample = ImuRecord(
            t_rx_ns=0,
            t_device_s=t_s,
            sequence=k,
            rate_rad_s=(0.01, 0.0, 0.02),
            specific_force_m_s2=(0.0, 0.0, -9.8),
        )
        yield codec.encode(sample, options)
        if k % 10 == 0:
            yield codec.encode(
                DvlRecord(t_rx_ns=0, t_device_s=t_s, velocity_m_s=(1.0, 0.0, 0.0)), options
            )
        if k % 7 == 0:
            yield codec.encode(HeadingRecord(t_rx_ns=0, heading_deg=float(k)), options)


def order(config: Config, each: int) -> list[Any]:
    """Samples one by one and fixes as they come, flushed after so many chunks."""
    line, said = intakes(config)["imu0"], []
    for k, telegram in enumerate(spoken(), 1):
        line.feed(telegram, 10**12 + k * 10_000_000)
        if k % each == 0:
            said += line.flush()
    said += line.flush()
    flat: list[Any] = []
    for m in said:
        flat += np.frombuffer(m.t_ns, np.int64).tolist() if isinstance(m, ImuBlock) else [m]
    return flat


def test_the_order_of_samples_and_fixes_is_that_of_their_arrival() -> None:
    config = configured("imu0", "gyro0", "dvl0")
    live, gathered = order(config, 1), order(config, 64)
    assert gathered == live
    assert len(live) == 100 + 10 + 15


def test_a_real_stream_of_two_devices_is_replayed(tmp_path: Path) -> None:
    capture = shared("captures", "stdbin_V3_2Hz.pcapng")
    link = {"x": UdpLink(port=8200, bind="0.0.0.0")}
    payloads = [p.data for p in read_streams([capture], link)]
    found = of_kind(b"".join(payloads))
    config = configured("imu0", "gyro0", imu0={"rate_hz": 2})
    told = replay.run([capture], config, out=tmp_path)["devices"]
    assert (told["imu0"]["line"], told["gyro0"]["line"]) == ("imu0", "imu0")
    assert told["gyro0"]["records"] == told["gyro0"]["measurements"] == found["HeadingRecord"]
    assert told["imu0"]["measurements"] == found["ImuRecord"]
    assert (told["imu0"]["bytes"], told["gyro0"]["bytes"]) == (sum(map(len, payloads)), 0)


def test_a_stream_on_one_port_gives_what_it_gives_on_three(tmp_path: Path) -> None:
    """The INS, its log and its depth, emulated: the same bytes, heard together or apart."""
    results = []
    for ports in ((7001, 7001, 7001), (7001, 7002, 7003)):
        data = demo_data() | {"duration_s": 12.0, "sea_bed_depth_m": 40.0}
        imu = data["devices"]["imu0"] | {"codec": "stdbin", "options": {}}
        depth = {"kind": "depth", "noise": {"depth_m": 0.1}}
        dvl = {"kind": "dvl", "noise": {"velocity_m_s": [0.01, 0.01, 0.005]}}
        ins = {
            "imu0": imu,
            "dvl0": dvl | {"codec": "stdbin"},
            "depth0": depth | {"codec": "stdbin"},
        }
        for port, device in zip(ports, ins.values(), strict=True):
            device["port"] = {"type": "udp", "port": port}
        scenario = make(data | {"devices": ins})
        folder = tmp_path / str(ports[2])
        folder.mkdir()
        emulate(scenario, pcap=folder / "sea.pcap", say=lambda _line: None)
        config = build(Config, twin.gateway_config(scenario), [])
        assert config is not None and not list(cross_faults(config))
        told = replay.run([folder / "sea.pcap"], config, out=folder)["devices"]
        results.append((folder / "nav.csv").read_text())
        assert min(told[name]["measurements"] for name in ins) >= 12
        assert len({told[name]["line"] for name in ins}) == len(set(ports))
        assert sum(told[name]["rejected_bytes"] for name in ins) == 0
    assert results[0] == results[1]
    assert len(results[0].splitlines()) > 100


def test_a_bus_of_sentences_is_three_devices() -> None:
    """Of sentences that tell no time each device takes its own; the log line is nobody's."""
    bus = {"codec": "nmea-bus", "options": {"measures": "depth", "checksum": "forbidden"}}
    config = configured("imu0", "depth0", "gyro0", "gnss0", depth0=bus, gyro0=bus, gnss0=bus)
    assert config.lines == (("imu0",), ("gnss0", "depth0", "gyro0"))
    line = intakes(config)["gyro0"]
    line.feed(
        b"$GPGGA,120000.00,3300.0,S,07200.0,W,1,08,1.0,5.0,M,40.0,M,,\r\n"
        b"$HEHDT,123.4,T\r\n$SDDPT,12.5,0.0\r\n$VDVLW,1.0,N,1.0,N\r\n$HEHDT,123.5,T\r\n",
        10**12,
    )
    said = [(type(m).__name__, m.device) for m in line.flush()]
    place, depth, heading = ("PositionFix", "gnss0"), ("Depth", "depth0"), ("HeadingFix", "gyro0")
    assert sorted(said) == sorted([place, depth, heading, heading])
    assert line.counts.ignored == {"not_gnss": 1}
    assert {n: i.counts.records for n, i in line.ingests.items()} == {
        "gnss0": 2,
        "depth0": 1,
        "gyro0": 2,
    }


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (
            {"kind": "imu"} | IMU,
            "devices.dvl0: of the same kind as devices.imu0, with which it shares its line;"
            " whose would a record be?",
        ),
        (
            {"options": {"version": 3}},
            "devices.dvl0.options: not those of devices.imu0, with which it shares its line",
        ),
        (
            {"codec": "pd0"},
            "devices.dvl0: UDP port 8200 is already used by devices.imu0 for codec stdbin;"
            " to share its line let link and codec be the same,"
            " or let allow of each name its own senders",
        ),
        (
            {"link": PORT | {"allow": ["10.0.0.1"]}},
            "devices.dvl0: UDP port 8200 is already used by devices.imu0 with other settings;"
            " to share its line let link and codec be the same,"
            " or let allow of each name its own senders",
        ),
    ],
)
def test_who_cannot_share_is_told_why(change: dict[str, Any], fault: str) -> None:
    faults = list(cross_faults(configured("imu0", "dvl0", dvl0=change)))
    assert fault in faults


def test_one_that_falls_silent_on_a_line_that_speaks_is_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, logger="gateway.health")
    line = Line(intakes(configured("imu0", "dvl0"))["imu0"])
    line.opened(0.0, "udp")
    now, codec = 0.0, registry.lookup("stdbin")
    dvl = DvlRecord(t_rx_ns=0, t_device_s=0.0, velocity_m_s=(1.0, 0.0, 0.0))

    def seconds(count: float, *, with_log: bool) -> None:
        nonlocal now
        for k in range(int(count)):
            now += 1.0
            sample = ImuRecord(
                t_rx_ns=0,
                t_device_s=now,
                rate_rad_s=(0.0, 0.0, 0.0),
                specific_force_m_s2=(0.0, 0.0, 0.0),
            )
            line.intake.feed(codec.encode(sample, codec.options()), k)
            if with_log:
                line.intake.feed(codec.encode(dvl, codec.options()), k)
            line.heard(now)
            line.watch(now)

    seconds(5, with_log=True)
    seconds(max(FIRST_S, SILENT_S["dvl"]) + 3, with_log=False)
    assert [record.getMessage() for record in caplog.records] == ["dvl0: silent for 11 s"]
    reports = dict(line.reports(now))
    assert reports["imu0"].silent_s == 0.0 < reports["dvl0"].silent_s
    assert reports["dvl0"].line == "imu0" and reports["dvl0"].link.place == "udp"
    seconds(2, with_log=True)
    assert caplog.records[-1].getMessage() == "dvl0: speaks"
