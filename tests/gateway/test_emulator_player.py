"""The emulator's bytes: captures read by dpkt, live frames on real sockets and terminals."""

import os
import select
import socket
import threading
import time
from contextlib import ExitStack

import dpkt
import numpy as np
import pytest

from drivers import registry
from drivers.records import ImuRecord, UsblRecord
from gateway.emulator import twin
from gateway.emulator.acoustics import measure
from gateway.emulator.pcap import ipv4_udp
from gateway.emulator.player import emulate
from gateway.emulator.scenario import codec_options
from gateway.emulator.sensors import ImuErrorSource, increments
from gateway.emulator.trajectory import Trajectory
from gateway.emulator.truth import TruthFile
from gateway.errors import ConfigError, UsblnavError
from tests.gateway.emulated import START, demo_data, make

SILENT = {"say": lambda _line: None}


class Listener:
    """Reads a descriptor in a thread and keeps what it heard with the Unix times of it."""

    def __init__(self, fd):
        self.heard: list[tuple[float, bytes]] = []
        self._fd = fd
        self._more, self._over = threading.Condition(), False
        self._thread = threading.Thread(target=self._listen)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over = True
        self._thread.join()

    def wait_for(self, count):
        with self._more:
            assert self._more.wait_for(lambda: len(self.heard) >= count, 10.0), len(self.heard)

    def _listen(self):
        while not self._over:
            if select.select([self._fd], [], [], 0.05)[0]:
                try:
                    data = os.read(self._fd, 4096)
                except OSError:  # the far end of the terminal has closed
                    return
                with self._more:
                    self.heard.append((time.time(), data))
                    self._more.notify()


def free_udp():
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    receiver.settimeout(10.0)
    return receiver, receiver.getsockname()[1]


def capture(tmp_path, data, name="run"):
    scenario = make(data)
    path = tmp_path / f"{name}.pcap"
    report = emulate(scenario, pcap=path, truth=tmp_path / f"{name}.csv", **SILENT)
    return scenario, path, report


def packets(path):
    with path.open("rb") as file:
        return [
            (float(t), dpkt.ethernet.Ethernet(frame).data) for t, frame in dpkt.pcap.Reader(file)
        ]


def decode(model, data):
    decoder = registry.lookup(model.codec).decoder(codec_options(model))
    return [*decoder.feed(data, 0), *decoder.close()]


class TestCapture:
    def test_frames_say_what_the_imu_sensed(self, tmp_path):
        scenario, path, report = capture(tmp_path, demo_data() | {"duration_s": 7.0})
        model = scenario.devices["imu0"]
        sent = [(t, ip.data.data) for t, ip in packets(path) if ip.data.dport == 7001]
        records = decode(model, b"".join(data for _, data in sent))
        assert len(records) == report.devices["imu0"].frames == 1400
        assert all(isinstance(r, ImuRecord) and r.valid for r in records)
        assert [r.sequence for r in records] == [k % 128 for k in range(1400)]
        t_end = (np.arange(1400) + 1) / 200.0
        np.testing.assert_allclose([t for t, _ in sent], START + t_end + 0.5e-3, atol=1e-6)
        expected = increments(Trajectory(scenario.trajectory, 7.0), t_end, 0.005)
        expected += ImuErrorSource(model, scenario.seed, "imu0").next(1400)
        angles = np.array([r.delta_angle_rad for r in records])
        forces = np.array([r.specific_force_m_s2 for r in records])
        np.testing.assert_allclose(angles, expected[:, :3], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(forces * 0.005, expected[:, 3:], rtol=1e-6, atol=1e-9)

    def test_sentences_say_what_the_array_measured(self, tmp_path):
        scenario, path, _ = capture(tmp_path, demo_data() | {"duration_s": 60.0})
        model = scenario.devices["usbl0"]
        sent = [(t, ip.data.data) for t, ip in packets(path) if ip.data.dport == 7002]
        records = decode(model, b"".join(data for _, data in sent))
        found = measure(scenario, "usbl0", model, Trajectory(scenario.trajectory, 60.0))
        assert len(records) == len(found.t_rx) == 30
        assert all(isinstance(r, UsblRecord) and r.valid and r.beacon == "1" for r in records)
        np.testing.assert_allclose([t for t, _ in sent], START + found.t_rx + 0.5, atol=1e-6)
        np.testing.assert_allclose(
            [r.slant_range_m for r in records], found.slant_range, atol=0.051
        )
        turn = np.exp(1j * np.deg2rad([r.bearing_deg for r in records]) - 1j * found.bearing)
        assert np.abs(np.angle(turn, deg=True)).max() < 0.051
        elevation = np.rad2deg(found.elevation)
        np.testing.assert_allclose([r.elevation_deg for r in records], elevation, atol=0.051)

    def test_same_seed_same_bytes_other_seed_others(self, tmp_path):
        data = demo_data() | {"duration_s": 12.0}
        files = [
            capture(tmp_path, data | {"seed": seed}, name)[1].read_bytes()
            for seed, name in [(4, "a"), (4, "b"), (5, "c")]
        ]
        assert files[0] == files[1] != files[2]
        assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()

    def test_headers_and_checksums_hold(self, tmp_path):
        _, path, _ = capture(tmp_path, demo_data() | {"duration_s": 3.0})
        times = [t for t, _ in packets(path)]
        assert times == sorted(times)
        for _, ip in packets(path):
            ip_sum, udp_sum = ip.sum, ip.data.sum
            ip.sum = ip.data.sum = 0
            again = dpkt.ip.IP(bytes(ip))
            assert (again.sum, again.data.sum) == (ip_sum, udp_sum)
            assert socket.inet_ntoa(ip.dst) == "127.0.0.1"

    def test_a_udp_checksum_is_never_zero(self):
        """Zero means "no checksum"; a payload chosen to sum to zero is sent as FFFF."""
        plain = ipv4_udp(1, ("127.0.0.1", 2), b"\0\0", 0)
        check = plain[26:28]
        assert ipv4_udp(1, ("127.0.0.1", 2), check, 0)[26:28] == b"\xff\xff"

    def test_other_ports_become_udp_and_so_does_the_twin(self):
        scenario = twin.for_capture(make(demo_data()))
        link = twin.gateway_config(scenario)["devices"]["usbl0"]["link"]
        assert link == {"type": "udp", "bind": "127.0.0.1", "port": 7002}

    @pytest.mark.parametrize("codec", ["tracklink-lxt", "tracklink-tp2"])
    @pytest.mark.parametrize("frame_format", ["a", "b", "c"])
    def test_formats(self, tmp_path, codec, frame_format):
        data = demo_data() | {"duration_s": 5.0}
        data["devices"]["imu0"]["options"] = {
            "format": frame_format,
            "gyro": "rate_deg_s",
            "accel": "delta_v_m_s",
        }
        data["devices"]["usbl0"]["codec"] = codec
        scenario, path, _ = capture(tmp_path, data)
        for device, port, count in [("imu0", 7001, 1000), ("usbl0", 7002, 3)]:
            sent = b"".join(ip.data.data for _, ip in packets(path) if ip.data.dport == port)
            records = decode(scenario.devices[device], sent)
            assert len(records) == count
            assert all(r.valid for r in records)

    def test_what_lxt_cannot_say_is_counted(self, tmp_path):
        data = demo_data() | {"duration_s": 9.0}
        data["beacons"]["1"]["height_m"] = 40.0
        _, path, report = capture(tmp_path, data)
        assert report.devices["usbl0"].unsayable == 5
        assert all(ip.data.dport == 7001 for _, ip in packets(path))

    def test_a_capture_needs_a_number_for_an_address(self, tmp_path):
        data = demo_data()
        data["devices"]["imu0"]["port"]["host"] = "some.where"
        with pytest.raises(ConfigError, match=r"devices\.imu0\.port\.host"):
            capture(tmp_path, data)

    def test_a_file_that_cannot_be_written_is_one_line(self, tmp_path):
        with pytest.raises(UsblnavError, match=r"missing/run\.pcap: No such file"):
            capture(tmp_path / "missing", demo_data())


class TestLive:
    def test_udp_and_pty_in_real_time(self, tmp_path):
        receiver, port = free_udp()
        data = demo_data() | {"duration_s": 3.2, "start": "now"}
        data["devices"]["imu0"]["port"]["port"] = port
        link = tmp_path / "usbl0"
        data["devices"]["usbl0"]["port"] |= {"symlink": str(link), "baud": 1200}
        lines: list[str] = []
        with ExitStack() as stack:
            datagrams = stack.enter_context(Listener(receiver.fileno()))
            terminal: list[Listener] = []

            def say(line):
                lines.append(line)
                if line.startswith("usbl0"):
                    fd = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
                    stack.callback(os.close, fd)
                    terminal.append(stack.enter_context(Listener(fd)))

            truth = tmp_path / "truth.csv"
            report = emulate(make(data), truth=truth, say=say)
            datagrams.wait_for(640)
        receiver.close()
        arrived = terminal[0].heard
        frames = [data for _, data in datagrams.heard]
        records = decode(make(data).devices["imu0"], b"".join(frames))
        assert [r.sequence for r in records] == [k % 128 for k in range(640)]
        sentences = b"".join(data for _, data in arrived)
        assert (
            sentences.count(b"\r\n") == len(sentences) / 43 == report.devices["usbl0"].frames == 2
        )
        t_rx = 2 * 87.0 / 1500.0
        first = arrived[0][0] - report.start_unix_s
        assert t_rx + 0.5 < first < t_rx + 0.5 + 0.3
        took = next(t for t, data in arrived if b"\r\n" in data or b"\n" in data) - arrived[0][0]
        assert took > 0.8 * 43 * 10 / 1200, "bytes leave at the line rate"
        assert lines[0] == f"imu0: kvh1750 to udp 127.0.0.1:{port}"
        assert lines[1].startswith(f"usbl0: tracklink-lxt to pty {link} (1200 baud) -> /dev/")
        assert not link.is_symlink(), "the symlink goes with its terminal"
        assert TruthFile(truth).at(report.start_unix_s + 3.2) is not None

    def test_stop_ends_at_once_and_speed_is_kept(self, tmp_path):
        receiver, port = free_udp()
        data = demo_data() | {"start": "now"}
        data["devices"] = {"imu0": data["devices"]["imu0"]}
        data["devices"]["imu0"]["port"]["port"] = port
        stop, result = threading.Event(), []
        player = threading.Thread(
            target=lambda: result.append(emulate(make(data), speed=5.0, stop=stop, **SILENT))
        )
        with Listener(receiver.fileno()) as datagrams:
            player.start()
            datagrams.wait_for(1000)
            stop.set()
            player.join(2.0)
        receiver.close()
        assert not player.is_alive()
        assert result[0].devices["imu0"].frames >= 1000
        took = datagrams.heard[999][0] - datagrams.heard[0][0]
        assert took == pytest.approx(999 / 200.0 / 5.0, abs=0.2)

    def test_a_start_to_come_is_waited_for(self):
        receiver, port = free_udp()
        data = demo_data() | {"start": time.time() + 0.5, "duration_s": 0.05}
        data["devices"]["imu0"]["port"]["port"] = port
        data["devices"] = {"imu0": data["devices"]["imu0"]}
        with Listener(receiver.fileno()) as datagrams:
            report = emulate(make(data), **SILENT)
            datagrams.wait_for(10)
        receiver.close()
        assert report.start_unix_s == pytest.approx(data["start"], abs=1e-6)
        assert 0.005 < datagrams.heard[0][0] - data["start"] < 0.2

    def test_a_port_that_does_not_open_is_one_line(self):
        data = demo_data()
        data["devices"]["usbl0"]["port"] = {"type": "serial", "port": "/nowhere/ttyS0"}
        with pytest.raises(
            UsblnavError, match=r"^serial /nowhere/ttyS0 \(9600 baud\): No such file"
        ):
            emulate(make(data), **SILENT)
