"""The emulator's bytes: captures read by dpkt, live frames on real sockets and terminals."""

import io
import itertools
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
from gateway.config.blocks import Config
from gateway.emulator import twin
from gateway.emulator.acoustics import measure
from gateway.emulator.pcap import ipv4_udp
from gateway.emulator.player import emulate
from gateway.emulator.ports import open_port, paced
from gateway.emulator.scenario import PtyPort, SerialPort, TcpServerPort, codec_options
from gateway.emulator.sensors import ImuErrorSource, increments
from gateway.emulator.streams import Emission
from gateway.emulator.trajectory import Trajectory
from gateway.emulator.truth import TruthFile, TruthWriter
from gateway.errors import ConfigError, UsblnavError
from gateway.nav import earth
from gateway.schema import build
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

    def test_a_port_that_does_not_open_is_one_line(self):
        data = demo_data()
        data["devices"]["usbl0"]["port"] = {"type": "serial", "port": "/nowhere/ttyS0"}
        with pytest.raises(
            UsblnavError, match=r"^serial /nowhere/ttyS0 \(9600 baud\): No such file"
        ):
            emulate(make(data), **SILENT)


class TestPorts:
    def test_a_serial_line_takes_its_time(self):
        port = PtyPort(symlink="unused", baud=9600)
        sentence = bytes(range(40))
        pieces = list(paced([Emission(1.0, "u", sentence), Emission(1.01, "u", sentence)], port))
        assert b"".join(p.data for p in pieces) == sentence * 2
        assert pieces[-1].t == pytest.approx(1.0 + 80 * 10 / 9600)
        assert [p.last for p in pieces].count(True) == 2
        assert all(b.t > a.t for a, b in itertools.pairwise(pieces))

    def test_a_terminal_nobody_reads_keeps_nothing(self, tmp_path):
        port = open_port(PtyPort(symlink=str(tmp_path / "tty")))
        port.send(b"old news")
        fd = os.open(tmp_path / "tty", os.O_RDWR | os.O_NOCTTY)
        port.send(b"news\r\n")
        assert os.read(fd, 100) == b"news\r\n"
        assert port.dropped_bytes == 8
        os.close(fd)
        port.close()

    def test_a_terminal_with_a_stalled_reader_never_blocks(self, tmp_path):
        port = open_port(PtyPort(symlink=str(tmp_path / "tty")))
        fd = os.open(tmp_path / "tty", os.O_RDWR | os.O_NOCTTY)
        for _ in range(200):
            port.send(bytes(1000))
        assert 0 < port.dropped_bytes < 200_000
        os.close(fd)
        port.close()

    def test_a_terminal_replaces_a_link_but_never_a_file(self, tmp_path):
        place = tmp_path / "tty"
        first, second = (open_port(PtyPort(symlink=str(place))) for _ in range(2))
        first.close()
        assert place.exists(), "the link is the second's now"
        second.close()
        place.write_text("precious")
        with pytest.raises(UsblnavError, match="exists and is no symlink"):
            open_port(PtyPort(symlink=str(place)))
        assert place.read_text() == "precious"

    def test_a_real_serial_port_is_set_raw(self):
        near, far = os.openpty()
        port = open_port(SerialPort(port=os.ttyname(far), baud=115200))
        port.send(b"a\nb\r\n")
        assert os.read(near, 100) == b"a\nb\r\n"
        port.close()
        os.close(near)
        os.close(far)

    def test_a_rate_no_uart_has(self):
        with pytest.raises(UsblnavError, match="12345 baud is not a rate"):
            open_port(SerialPort(port="/dev/null", baud=12345))

    def test_tcp_serves_many_and_forgets_who_left(self):
        number = free_tcp_port()
        port = open_port(TcpServerPort(port=number))
        port.send(b"nobody")
        clients = [socket.create_connection(("127.0.0.1", number), 5.0) for _ in range(2)]
        port.send(b"one")
        assert [c.recv(10) for c in clients] == [b"one", b"one"]
        clients[0].close()
        while port.dropped_bytes == 6:
            port.send(b"two")
        assert clients[1].recv(3) == b"two"
        clients[1].close()
        port.close()


def free_tcp_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


class TestTruth:
    def test_what_is_read_while_it_grows_is_the_trajectory(self, tmp_path):
        scenario = make(demo_data())
        trajectory = Trajectory(scenario.trajectory, 100.0)
        path = tmp_path / "truth.csv"
        reader = TruthFile(path)
        assert reader.at(START) is None
        with path.open("w") as file:
            writer = TruthWriter(file, trajectory, START)
            for t in (0.0, 3.33, 47.77):
                writer.write_until(t)
                row = reader.at(START + t)
                g = trajectory.geodetic(np.array([t]))
                assert row.lat_deg == pytest.approx(np.rad2deg(g.lat[0]), abs=1e-7)
                assert row.height_m == pytest.approx(g.h[0], abs=1e-3)
                assert row.vn_m_s == pytest.approx(g.v_eb_n[0, 0], abs=1e-3)
                difference = row.heading_deg - np.rad2deg(g.heading[0])
                assert abs((difference + 180) % 360 - 180) < 1e-2
            assert reader.at(START + 60.0) is None

    def test_heading_is_interpolated_across_north(self, tmp_path):
        data = demo_data()
        data["trajectory"] |= {"sway": {}, "start_bearing_deg": 90.05}
        trajectory = Trajectory(make(data).trajectory, 10.0)
        out = io.StringIO()
        TruthWriter(out, trajectory, 0.0).write_until(2.0)
        (tmp_path / "t.csv").write_text(out.getvalue())
        reader = TruthFile(tmp_path / "t.csv")
        for t in np.linspace(0.0, 1.0, 41):
            exact = np.rad2deg(trajectory.geodetic(np.array([t])).heading[0])
            assert abs((reader.at(t).heading_deg - exact + 180) % 360 - 180) < 1e-3


class TestScenario:
    def write(self, tmp_path, text):
        path = tmp_path / "scenario.yaml"
        path.write_text(text)
        return path

    def test_the_packaged_scenario_is_sound_and_its_twin_too(self):
        scenario = twin.load(twin.DEMO)
        faults: list[str] = []
        config = build(Config, twin.gateway_config(scenario), faults)
        assert not faults
        assert config is not None
        assert config.devices["usbl0"].link.port == "/tmp/usblnav-usbl0"

    def test_first_state_is_the_truth_with_errors_of_its_sigma(self):
        offsets = []
        for seed in range(200):
            scenario = make(demo_data() | {"seed": seed})
            initial = twin.gateway_config(scenario)["initial"]
            g = Trajectory(scenario.trajectory, 1.0).geodetic(np.zeros(1))
            lat, lon = np.deg2rad([initial["lat_deg"], initial["lon_deg"]])
            r_true = earth.lla_to_ecef(g.lat[0], g.lon[0], g.h[0])
            d = earth.lla_to_ecef(lat, lon, initial["height_m"]) - r_true
            offsets.append(earth.C_en(g.lat[0], g.lon[0]).T @ d)
        assert np.std(offsets, axis=0) == pytest.approx([5.0, 5.0, 1.0], rel=0.15)

    @pytest.mark.parametrize(
        ("old", "new", "fault"),
        [
            ("seed: 1", "sead: 1", "sead: unknown key; did you mean seed?"),
            ("type: circle", "type: figure8", "trajectory.type: unknown type"),
            ("codec: kvh1750", "codec: kvh1751", "devices.imu0.codec: no codec is called"),
            (
                "codec: tracklink-lxt",
                "codec: kvh1750",
                "devices.usbl0.codec: kvh1750 is of kind imu",
            ),
            ("codec: tracklink-lxt", "codec: tracklink-gll", "devices.usbl0.codec: beacon 1:"),
            ("accel: g}", "accel: furlong}", "devices.imu0.options.accel: expected one of"),
            ('"1": {', '"north-east": {', "devices.usbl0.codec: beacon north-east:"),
            ("period_s: 2.0", "period_s: 0", "devices.usbl0.period_s: expected a number > 0"),
        ],
    )
    def test_faults_are_named_by_their_place(self, tmp_path, old, new, fault):
        text = twin.DEMO.read_text()
        assert old in text
        with pytest.raises(ConfigError) as caught:
            twin.load(self.write(tmp_path, text.replace(old, new)))
        assert any(line.startswith(fault) for line in caught.value.faults), caught.value.faults
