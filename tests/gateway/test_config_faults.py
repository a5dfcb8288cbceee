"""What a configuration file is refused for and in which words, all of it at once."""

import copy
from pathlib import Path
from typing import Any

import pytest

from drivers import registry
from gateway.config import Config, load
from gateway.config.checks import cross_faults
from gateway.schema import build
from tests.gateway.configurations import (
    EVERY_FAULT,
    EVERY_KIND,
    GONE,
    GOOD,
    edited,
    faults_of,
    written,
)

NMEA_TCP = {"type": "nmea", "link": {"type": "tcp", "port": 10110}}
NMEA_PTY = {"type": "nmea", "link": {"type": "pty", "symlink": "/run/nmea"}}
NMEA_STDOUT = {"type": "nmea", "link": {"type": "stdout"}}
ZENOH = {"type": "zenoh"}

IMU_CODECS = [codec.name for codec in registry.all_codecs() if codec.kind == "imu"]
NAME = "expected a name of letters, digits and _ . - (at most 64), got"
GYRO = "expected one of delta_angle_deg, delta_angle_rad, rate_deg_s, rate_rad_s, got"
LINK = "one of: serial, udp, tcp"
NO_BEACON = "missing; devices.usbl0 needs at least one"
SECOND_IMU = {**GOOD["devices"]["imu0"], "link": {"type": "udp", "port": 7009}}
NMEA_ON_USBL = {"type": "nmea", "link": {"type": "serial", "port": "/dev/ttyUSB1"}}

# path in the file, value put there, path of the fault within it, what is said
ONE_FAULT: list[tuple[str, Any, str, str]] = [
    ("vehicle", 5, "", f"{NAME} 5 (put it in quotes)"),
    ("vehicle", "my auv", "", f'{NAME} "my auv"'),
    ("vehicle", "auv\n", "", f'{NAME} "auv\\n"'),
    ("devices", GONE, "", "missing"),
    ("devices", 4, "", "expected a block of keys, got 4"),
    ("devices.usbl0.kind", GONE, "", "missing; one of: imu, usbl, lbl, gnss, depth, dvl, heading"),
    ("devices.usbl0", None, "", "expected a block of keys, got nothing"),
    ("devices.imu0.options", {"gyr": "g"}, ".gyr", "unknown key; did you mean gyro?"),
    ("devices.imu0.options", {"gyro": "rpm"}, ".gyro", f'{GYRO} "rpm"'),
    ("devices.imu0.link.type", "upd", "", f'unknown type "upd"; {LINK}'),
    ("devices.imu0.link", {"type": "stdout"}, ".type", f'unknown type "stdout"; {LINK}'),
    ("devices.imu0.link", {"port": 7001}, ".type", f"missing; {LINK}"),
    (
        "devices.imu0.link.allow",
        ["10.0.0.0/8", "10.0.0"],
        "[1]",
        'expected an address or network, got "10.0.0"',
    ),
    (
        "devices.imu0.link.group",
        "10.0.0.1",
        "",
        'expected a multicast address, got "10.0.0.1"',
    ),
    ("devices.imu0.rate_hz", True, "", "expected a number > 0 and <= 10000, got true"),
    (
        "devices.imu0.clock",
        {"source": "pps"},
        ".source",
        "pps is for devices of kind gnss; the pulse of no other is read",
    ),
    ("devices.imu0.clock", {"pulses": "/p"}, ".pulses", "only with source: pps"),
    (
        "devices.usbl0.clock",
        {"source": "device"},
        ".source",
        "tracklink-lxt tells no time; use arrival",
    ),
    ("devices.usbl0.noise.range_m", "abc", "", 'expected a number > 0, got "abc"'),
    ("devices.usbl0.noise.range_m", 0, "", "expected a number > 0, got 0"),
    ("devices.usbl0.noise", GONE, "", "missing"),
    (
        "devices.usbl0.clock",
        {"latency_ms": 10000},
        ".latency_ms",
        "10000 ms is not within filter.history_s (10 s); all its data would be too late",
    ),
    ("beacons", GONE, "", NO_BEACON),
    ("beacons", {}, "", NO_BEACON),
    ("beacons.1.travel", "round", "", 'expected one of one_way, two_way, got "round"'),
    ("beacons.1.lon_deg", 400, "", "expected a number from -180 to 360, got 400"),
    ("sound_speed_m_s", 340, "", "expected a number from 1300 to 1700, got 340"),
    (
        "filter",
        {"loose_noise": "none"},
        ".loose_noise",
        'expected one of fixed, mapped, got "none"',
    ),
    ("initial", GONE, "", "missing"),
    ("outputs", [{"type": "nmea"}], "[0].link", "missing"),
    ("outputs", "nmea", "", 'expected a list, got "nmea"'),
    ("outputs", [NMEA_TCP, NMEA_TCP], "[1]", "TCP port 10110 is already used by outputs[0]"),
    ("outputs", [NMEA_PTY, NMEA_PTY], "[1]", "the pty /run/nmea is already used by outputs[0]"),
    (
        "outputs",
        [ZENOH, NMEA_PTY | {"sentences": ["GGA", "DBT"]}],
        "[1].surface_height_m",
        "missing; DBT needs the height of the water's surface above the ellipsoid",
    ),
    ("outputs", [ZENOH, ZENOH], "[1]", "the Zenoh session is already used by outputs[0]"),
    (
        "outputs",
        [NMEA_STDOUT, ZENOH, NMEA_STDOUT],
        "[2]",
        "standard output is already used by outputs[0]",
    ),
    (
        "outputs",
        [NMEA_ON_USBL],
        "[0]",
        "serial port /dev/ttyUSB1 is already used by devices.usbl0",
    ),
    (
        "outputs",
        [{**NMEA_TCP, "talker": "GPS"}],
        "[0].talker",
        'expected two capital letters, got "GPS"',
    ),
    (
        "outputs",
        [{**NMEA_TCP, "sentences": []}],
        "[0].sentences",
        "expected a list of at least 1, got 0",
    ),
    (
        "outputs",
        [{"type": "zenoh", "mode": "client"}],
        "[0].connect",
        "missing; a client needs its router's endpoint",
    ),
    (
        "outputs",
        [{"type": "zenoh", "connect": ["host:7447"]}],
        "[0].connect[0]",
        'expected an endpoint such as tcp/192.168.1.5:7447, got "host:7447"',
    ),
    (
        "outputs",
        [{**ZENOH, "user": "auv1"}],
        "[0].password_file",
        "missing; user and password_file belong together",
    ),
    (
        "outputs",
        [{**ZENOH, "tls": {"private_key": "auv1.key"}}],
        "[0].tls.certificate",
        "missing; certificate and private_key belong together",
    ),
    (
        "outputs",
        [{**ZENOH, "tls": {"certificate": "a.pem", "private_key": "a.key", "mutual": True}}],
        "[0].tls.root_ca",
        "missing; mutual needs root_ca, certificate and private_key",
    ),
    (
        "outputs",
        [{**ZENOH, "listen": ["tls/0.0.0.0:7447"], "tls": {"root_ca": "ca.pem"}}],
        "[0].tls.certificate",
        "missing; who listens on tls must show one",
    ),
    (
        "outputs",
        [{**ZENOH, "mode": "client", "connect": ["tcp/a:1"], "users_file": "users"}],
        "[0].users_file",
        "a client lets nobody in",
    ),
]


def test_every_kind_of_fault_is_named_at_once(tmp_path: Path) -> None:
    assert faults_of(written(tmp_path, EVERY_KIND)) == EVERY_FAULT


@pytest.mark.parametrize(("path", "value", "within", "said"), ONE_FAULT)
def test_one_fault(tmp_path: Path, path: str, value: Any, within: str, said: str) -> None:
    assert faults_of(written(tmp_path, edited((path, value)))) == [f"{path}{within}: {said}"]


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("devices.imu0", GONE, "devices: none is of kind imu; exactly one is needed"),
        (
            "devices.imu1",
            SECOND_IMU,
            "devices: imu0, imu1 are all of kind imu; exactly one is needed",
        ),
        (
            "devices.imu0.codec",
            "tracklink-lxt",
            "devices.imu0.codec: tracklink-lxt is of kind usbl, the device of kind imu; "
            f"one of: {', '.join(IMU_CODECS)}",
        ),
        (
            "devices.usbl0.link",
            {"type": "udp", "port": 7001},
            "devices.usbl0: UDP port 7001 is already used by devices.imu0 for codec kvh1750"
            "; to share its line let link and codec be the same"
            ", or let allow of each name its own senders",
        ),
        (
            "devices.usbl0.link",
            {"type": "udp", "port": 7001, "bind": "0.0.0.0"},
            "devices.usbl0: UDP port 7001 is already used by devices.imu0 with other settings"
            "; to share its line let link and codec be the same"
            ", or let allow of each name its own senders",
        ),
        (
            "devices.imu0.link",
            {"type": "serial", "port": "/dev/ttyUSB1"},
            "devices.usbl0: serial port /dev/ttyUSB1 is already used by devices.imu0"
            " for codec kvh1750; to share its line let link and codec be the same",
        ),
        *(
            (
                "outputs",
                [{"type": "nmea", "link": {"type": "udp", "host": host, "port": 7001}}],
                "outputs[0]: devices.imu0 listens on UDP port 7001; it would hear this",
            )
            for host in ("127.0.0.1", "localhost")
        ),
        (
            "devices.usbl0.range_limits_m",
            [500.0, 1.0],
            "devices.usbl0.range_limits_m: the shortest range is not below the longest",
        ),
        *(
            (
                "devices.usbl0",
                GOOD["devices"]["usbl0"] | {"direction": "differences", "elements_m": elements},
                "devices.usbl0.elements_m: direction by differences needs three elements or more"
                " that are not on one line",
            )
            for elements in ([], [[0, 0, 0], [1, 0, 0], [2, 0, 0]])
        ),
    ],
)
def test_fault_between_blocks(tmp_path: Path, path: str, value: Any, expected: str) -> None:
    assert faults_of(written(tmp_path, edited((path, value)))) == [expected]


@pytest.mark.parametrize(
    "edits",
    [
        [("outputs", [{"type": "nmea", "link": {"type": "udp", "port": 10110}}] * 2)],
        [("outputs", [NMEA_TCP, {"type": "nmea", "link": {"type": "tcp", "port": 10111}}])],
        [("devices.usbl0.link", {"type": "udp", "port": 7001, "bind": "127.0.0.2"})],
        [("devices.usbl0.link", {"type": "tcp", "port": 7001})],
        [
            (
                "outputs",
                [{"type": "nmea", "link": {"type": "udp", "host": "10.0.0.2", "port": 7001}}],
            )
        ],
        [("devices.usbl0", GONE), ("beacons", GONE)],
        [("initial.lon_deg", 359.9)],
        [("filter", {"history_s": 120}), ("devices.usbl0.clock", {"latency_ms": 30000})],
    ],
)
def test_accepted(tmp_path: Path, edits: list[tuple[str, Any]]) -> None:
    assert isinstance(load(written(tmp_path, edited(*edits))), Config)


@pytest.mark.parametrize(
    ("document", "fault"),
    [("", "nothing"), ("- 1", "a list"), ("usblnav", '"usblnav"')],
)
def test_a_file_that_is_no_block(tmp_path: Path, document: str, fault: str) -> None:
    path = written(tmp_path, document)
    assert faults_of(path) == [f"expected a block of keys, got {fault}"]


def test_checks_across_blocks_pass_over_what_is_named_already(tmp_path: Path) -> None:
    """A block that cannot be read is one fault, not a second one elsewhere."""
    path = written(
        tmp_path,
        edited(
            ("devices.imu0.codec", 5),
            ("devices.imu0.clock", "device"),
            ("devices.usbl0.link", "serial"),
            ("filter", []),
            ("beacons", 1),
            ("outputs", [NMEA_TCP, {"type": "nmea", "link": 5}, "zenoh"]),
        ),
    )
    assert faults_of(path) == [
        "devices.imu0.codec: expected text, got 5 (put it in quotes)",
        'devices.imu0.clock: expected a block of keys, got "device"',
        'devices.usbl0.link: expected a block of keys, got "serial"',
        "beacons: expected a block of keys, got 1",
        "filter: expected a block of keys, got a list",
        "outputs[1].link: expected a block of keys, got 5",
        'outputs[2]: expected a block of keys, got "zenoh"',
    ]


def test_senders_of_their_own_make_of_a_port_two() -> None:
    data = copy.deepcopy(GOOD)
    for name, allow in (("imu0", ["10.0.0.7"]), ("usbl0", ["10.0.0.8", "fd00::/8"])):
        data["devices"][name]["link"] = {"type": "udp", "port": 7001, "allow": allow}
    assert not list(cross_faults(build(Config, data, [])))
    data["devices"]["imu0"]["link"]["allow"] = ["10.0.0.0/24"]
    (fault,) = cross_faults(build(Config, data, []))
    assert fault.startswith("devices.usbl0: UDP port 7001 is already used by devices.imu0 ")
