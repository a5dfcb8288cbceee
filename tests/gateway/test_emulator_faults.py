"""What goes wrong on the way to a port, told by frames that are numbered."""

import itertools
import socket
from collections import Counter

import numpy as np
import pytest
from msgspec import UNSET

from drivers import registry
from drivers.imu.stim300 import STIM300, Stim300Options
from drivers.records import OtherFrame, Rejected
from gateway.emulator import twin
from gateway.emulator.faults.clocks import ImuClock
from gateway.emulator.faults.wire import faulty
from gateway.emulator.instruments import emissions
from gateway.emulator.ledger import Sent
from gateway.emulator.player import emulate
from gateway.emulator.ports import Plug
from gateway.emulator.scenario import TcpServerPort
from gateway.emulator.streams import Emission
from gateway.emulator.trajectory import Trajectory
from gateway.errors import ConfigError
from tests.gateway.emulated import START, demo_data, make
from tests.gateway.test_emulator_player import SILENT, free_udp, packets

FRAMES = [Emission(k / 10, "imu0", b"frame%05d" % k) for k in range(600)]
SECOND_10 = range(100, 110)


def struck(*faults, seed=8):
    """The numbered frames as they reach the port."""
    blocks = [{"device": "imu0", "at_s": 10.0, "for_s": 1.0} | fault for fault in faults]
    scenario = make(demo_data() | {"seed": seed, "duration_s": 60.0, "faults": blocks})
    out = list(faulty(iter(FRAMES), "imu0", scenario))
    assert all(a.t <= b.t for a, b in itertools.pairwise(out))
    return out


def numbers(emissions):
    return [int(e.data[5:]) for e in emissions if e.data]


def test_a_flip_turns_so_many_bits_of_the_frames_in_its_time():
    out = struck({"fault": "flip", "bits": 3})
    wrong = [k for k, (e, sent) in enumerate(zip(out, FRAMES, strict=True)) if e.data != sent.data]
    assert wrong == list(SECOND_10)
    for k in wrong:
        pairs = zip(out[k].data, FRAMES[k].data, strict=True)
        assert sum((a ^ b).bit_count() for a, b in pairs) == 3
        assert out[k].fate == "damaged"


def test_what_is_truncated_is_the_beginning():
    out = struck({"fault": "truncate"})
    for k in SECOND_10:
        assert FRAMES[k].data.startswith(out[k].data)
        assert 0 < len(out[k].data) < 10
    assert numbers(out[:100] + out[110:]) == [*range(100), *range(110, 600)]


def test_junk_stands_before_the_frame_and_spares_it():
    out = struck({"fault": "junk", "bytes": 7})
    junk = [e for e in out if e.fate == "junk"]
    assert len(junk) == 10
    assert all(1 <= len(e.data) <= 7 for e in junk)
    assert numbers(e for e in out if e.fate == "whole") == list(range(600))


def test_frames_dropped_repeated_and_out_of_order():
    assert numbers(struck({"fault": "drop"})) == [*range(100), *range(110, 600)]
    again = struck({"fault": "duplicate"})
    assert Counter(numbers(again)) == Counter(range(600)) + Counter(SECOND_10)
    swapped = struck({"fault": "reorder", "for_s": 0.0})
    assert numbers(swapped)[99:103] == [99, 101, 100, 102]


def test_a_fault_of_no_length_strikes_the_next_frame():
    out = struck({"fault": "drop", "at_s": 12.34, "for_s": 0.0})
    assert numbers(out) == [k for k in range(600) if k != 124]


def test_a_burst_comes_at_once_and_in_order():
    out = struck({"fault": "burst"})
    assert numbers(out) == list(range(600))
    assert {e.t for e in out[100:110]} == {11.0}
    assert [e.t for e in out[110:]] == [f.t for f in FRAMES[110:]]


def test_what_comes_late_stays_in_order():
    out = struck({"fault": "delay", "delay_ms": 250.0})
    assert [e.t - f.t for e, f in zip(out[100:110], FRAMES[100:110], strict=True)] == pytest.approx(
        [0.25] * 10
    )
    jittery = struck({"fault": "jitter", "mean_ms": 40.0, "at_s": 0.0, "for_s": 60.0})
    late = [e.t - f.t for e, f in zip(jittery, FRAMES, strict=True)]
    assert sum(late) / len(late) == pytest.approx(0.04, rel=0.3)
    assert numbers(jittery) == list(range(600))


def test_an_unplugged_port_is_told_when_it_goes_and_is_back():
    out = struck({"fault": "unplug"})
    assert numbers(out) == [*range(100), *range(110, 600)]
    told = [(e.fate, e.t) for e in out if e.fate in ("plugged", "unplugged")]
    assert told == [("unplugged", 10.0), ("plugged", 11.0)]
    to_the_end = struck({"fault": "unplug", "for_s": 1e3})
    assert to_the_end[-1].fate == "plugged"


def test_at_random_it_comes_as_often_as_said_and_by_the_seed_alone():
    often = {"fault": "drop", "at_s": None, "per_hour": 3600.0, "for_s": 0.0}
    lost = [600 - len(numbers(struck(often, seed=seed))) for seed in range(30)]
    assert sum(lost) / len(lost) == pytest.approx(60, rel=0.15)  # few of 60 strike one frame twice
    assert struck(often, seed=3) == struck(often, seed=3) != struck(often, seed=4)


def test_the_ledger_counts_each_frame_once():
    every = [
        {"fault": fault, "at_s": 5.0, "for_s": 50.0, "probability": 0.4}
        for fault in ("junk", "duplicate", "flip", "truncate", "drop", "reorder", "duplicate")
    ]
    sent = Sent()
    out = struck(*every)
    for e in out:
        sent.note(e)
    assert sent.frames + sent.damaged + sent.dropped == 600
    assert min(sent.frames, sent.damaged, sent.dropped, sent.repeated, sent.junk_bytes) > 10
    assert sent.bytes == sum(len(e.data) for e in out)
    assert numbers(e for e in out if e.fate == "whole") != numbers(FRAMES)
    assert all(e.data in {f.data for f in FRAMES} for e in out if e.fate in ("whole", "repeated"))


def test_of_a_capture_the_bytes_are_those_of_the_ledger(tmp_path):
    faults = [
        {"fault": "flip", "device": "imu0", "per_hour": 3600.0},
        {"fault": "drop", "device": "imu0", "per_hour": 3600.0, "for_s": 0.1},
        {"fault": "junk", "device": "usbl0", "at_s": 0.0, "for_s": 12.0},
    ]
    data = demo_data() | {"duration_s": 12.0, "faults": faults}
    files = []
    for name in "ab":
        path = tmp_path / name
        report = emulate(make(data), pcap=path, **SILENT)
        files.append(path.read_bytes())
        for device, port in (("imu0", 7001), ("usbl0", 7002)):
            sent = report.devices[device]
            heard = [ip.data.data for _, ip in packets(path) if ip.data.dport == port]
            assert sum(map(len, heard)) == sent.bytes
    assert files[0] == files[1]
    assert report.devices["imu0"].damaged and report.devices["imu0"].dropped
    assert report.devices["usbl0"].junk_bytes


@pytest.mark.parametrize(
    ("block", "line"),
    [
        ("fault: flip, device: imu0", "faults[0]: expected either at_s or per_hour"),
        ("fault: flip, device: imu0, at_s: 1, per_hour: 1", "faults[0]: expected either"),
        ("fault: flip, device: imu1, at_s: 1", "faults[0].device: no device is called imu1"),
        ("fault: flop, device: imu0, at_s: 1", "faults[0].fault: unknown"),
        ("fault: flip, device: imu0, at_s: 1, bits: 0", "faults[0].bits: "),
    ],
)
def test_a_fault_of_the_file_is_named_by_its_place(tmp_path, block, line):
    path = tmp_path / "scenario.yaml"
    path.write_text(twin.DEMO.read_text() + f"\nfaults:\n  - {{{block}}}\n")
    with pytest.raises(ConfigError) as caught:
        twin.load(path)
    assert any(fault.startswith(line) for fault in caught.value.faults), caught.value.faults


def test_a_pulled_plug_takes_the_client_with_it():
    with socket.create_server(("127.0.0.1", 0)) as server:
        block = TcpServerPort(port=server.getsockname()[1])
    plug = Plug(block)
    with socket.create_connection((block.bind, block.port)) as client:
        plug.send(b"heard")
        assert client.recv(100) == b"heard"
        plug.pull()
        assert client.recv(100) == b""
    plug.send(b"lost")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((block.bind, block.port))
    plug.put_in()
    with socket.create_connection((block.bind, block.port)) as client:
        plug.send(b"again")
        assert client.recv(100) == b"again"
    plug.pull()
    assert plug.dropped_bytes == 4


@pytest.mark.live
def test_a_live_port_is_closed_while_it_is_unplugged():
    receiver, port = free_udp()
    data = demo_data() | {"start": "now", "duration_s": 0.3}
    data["devices"] = {"imu0": data["devices"]["imu0"]}
    data["devices"]["imu0"]["port"]["port"] = port
    data["faults"] = [{"fault": "unplug", "device": "imu0", "at_s": 0.1, "for_s": 0.1}]
    lines: list[str] = []
    report = emulate(make(data), say=lines.append)
    receiver.setblocking(False)
    heard = 0
    while heard < report.devices["imu0"].frames:
        receiver.recv(100)
        heard += 1
    receiver.close()
    assert (heard, report.devices["imu0"].dropped) == (40, 20)
    assert lines[2:] == ["imu0: unplugged", f"imu0: back, to udp 127.0.0.1:{port}"]


def told(*faults, codec="kvh1750", options=None, rate_hz=100.0, seconds=60.0):
    """Number and time on each sample of an IMU, and when it ended."""
    block = demo_data()["devices"]["imu0"] | {"codec": codec, "rate_hz": rate_hz}
    data = demo_data() | {"devices": {"imu0": block | {"options": options or {}}}}
    scenario = make(data | {"faults": [{"device": "imu0", "at_s": 20.0} | f for f in faults]})
    t = (np.arange(round(seconds * rate_hz)) + 1) / rate_hz
    counting = registry.lookup(codec).counting
    numbers, times = ImuClock(scenario, "imu0", counting, rate_hz).tell(t)
    return np.array(numbers), np.array(times), t


def test_a_clock_runs_fast_and_is_set():
    numbers, times, t = told(
        {"fault": "clock_drift", "ppm": 1000.0, "for_s": 10.0},
        {"fault": "clock_step", "at_s": 40.0, "step_s": -5.0},
    )
    expected = t + 0.001 * np.clip(t - 20.0, 0.0, 10.0) - 5.0 * (t >= 40.0)
    np.testing.assert_allclose(times, expected, atol=1e-9)
    assert numbers.tolist() == [k % 128 for k in range(6000)], "the frames are counted all the same"


def test_after_a_power_cycle_it_begins_at_zero():
    numbers, times, t = told({"fault": "power_cycle", "for_s": 3.0})
    np.testing.assert_allclose(times, np.where(t < 23.0, t, t - 23.0), atol=1e-9)
    assert numbers[t >= 23.005][:3].tolist() == [0, 1, 2]


@pytest.mark.parametrize("uptime_s", [0.0, 100.0])
def test_a_unit_says_what_it_is_when_it_is_switched_on(uptime_s):
    """So that who has the wrong options reads it rightly from the next power-up on."""
    data = demo_data() | {"duration_s": 3.0}
    options = {"gyro": "increment", "accel": "increment", "crlf": True}
    unit = {"codec": "stim300", "options": options, "uptime_s": uptime_s, "rate_hz": 100}
    data["devices"] = {"imu0": data["devices"]["imu0"] | unit}
    data["faults"] = [{"fault": "power_cycle", "device": "imu0", "at_s": 1.0, "for_s": 0.5}]
    scenario = make(data)
    decoder = STIM300.decoder(Stim300Options())
    way = Trajectory(scenario.trajectory, 3.0)
    records = [r for e in emissions(scenario, way, START, 1.0) for r in decoder.feed(e.data, 0)]
    said = [k for k, r in enumerate(records) if isinstance(r, OtherFrame)]
    names = [records[k].name for k in said]
    twice = 2 - (uptime_s > 0)
    numbers = ["part number", "serial number", "configuration", "bias trim offset"]
    assert names == twice * numbers
    assert said[-4:] == list(range(said[-4], said[-4] + 4))
    after = records[said[-1] + 1 :]
    assert len(after) == 150
    assert all(r.delta_angle_rad is not UNSET for r in after)
    # Until then each CR LF of a unit that was on before is rejected.
    assert any(isinstance(r, Rejected) for r in records) is (uptime_s > 0)


def test_a_count_turns_over_when_it_is_told_to():
    _, times, t = told({"fault": "clock_wrap"})
    turn = 2**32 * 1e-6
    np.testing.assert_allclose(times, (t - 20.0) % turn, atol=1e-6)
    numbers, _, t = told({"fault": "clock_wrap"}, codec="xsens-mtdata2")
    assert (numbers[np.argmin(np.abs(t - 20.0))] + 1) % 2**16 == 0


def test_where_the_counter_is_a_clock_it_drifts():
    numbers, _, t = told({"fault": "clock_drift", "ppm": 100.0, "at_s": 0.0}, codec="stim300")
    assert np.diff(numbers)[:5].tolist() == [20, 20, 20, 20, 20]
    assert numbers[-1] == round(60.0 * 1.0001 * 2000 - 1) % 256
    assert t[-1] == 60.0


def test_shaken_beyond_its_range_an_imu_says_the_end_of_it():
    narrow = {"fault": "saturation", "device": "imu0", "at_s": 2.0, "for_s": 1.0}
    narrow |= {"rate_deg_s": 500.0, "accel_g": 0.5}
    data = demo_data() | {"duration_s": 4.0, "faults": [narrow]}
    data["devices"] = {"imu0": data["devices"]["imu0"]}
    scenario = make(data)
    codec = registry.lookup("kvh1750")
    decoder = codec.decoder(codec.options(accel="g"))
    way = Trajectory(scenario.trajectory, 4.0)
    records = [r for e in emissions(scenario, way, 0.0, 1.0) for r in decoder.feed(e.data, 0)]
    down = np.array([r.specific_force_m_s2[2] for r in records])
    struck = np.isclose(down, -0.5 * 9.80665, rtol=1e-6)
    assert np.flatnonzero(struck).tolist() == list(range(399, 599))
    assert [r.valid for r in records] == (~struck).tolist()
