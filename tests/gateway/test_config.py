"""The configuration file: typed blocks of it, and the documented example."""

import json
from pathlib import Path

import msgspec
import pytest

from drivers.imu.kvh import KvhOptions
from drivers.settings import SerialLink, UdpLink
from gateway.config import Beacon, Config, Filter, ImuDevice, UsblDevice, load, wire_format
from gateway.emulator.twin import DEMO, gateway_config
from gateway.emulator.twin import load as load_scenario
from gateway.schema import build
from tests.gateway.configurations import GOOD, edited, written
from tests.shared_data import ROOT, shared


def test_good_file_gives_typed_blocks(tmp_path: Path) -> None:
    config = load(written(tmp_path, GOOD))
    name, imu = config.imu
    assert (name, imu.link, imu.rate_hz) == ("imu0", UdpLink(port=7001), 200.0)
    assert isinstance(imu.rate_hz, float)
    assert config.usbl["usbl0"].link == SerialLink(port="/dev/ttyUSB1", baud=9600)
    assert config.beacons == {"1": Beacon(lat_deg=39.8, lon_deg=116.2, height_m=-50.0)}
    assert config.filter == Filter()
    assert config.outputs == ()


def test_numbers_as_beacon_names_are_text(tmp_path: Path) -> None:
    text = json.dumps(GOOD).replace('"1":', "007:")
    assert list(load(written(tmp_path, text)).beacons) == ["007"]


@pytest.mark.parametrize("capture", ["lawnmower", "snapir02"])
def test_configuration_of_a_capture_loads(capture: str) -> None:
    config = load(shared("captures", capture, "config.yaml"))
    assert isinstance(config.imu[1], ImuDevice)
    assert isinstance(config.usbl["usbl0"], UsblDevice)
    assert config.imu[1].options == {"gyro": "delta_angle_rad", "accel": "g"}


def test_wire_format_gives_the_codec_its_own_options(tmp_path: Path) -> None:
    options = {"gyro": "rate_deg_s"}
    config = load(written(tmp_path, edited(("devices.imu0.options", options))))
    codec, made = wire_format(config.imu[1])
    assert codec.name == "kvh1750"
    assert made == KvhOptions(gyro="rate_deg_s")


def test_documented_example_has_no_fault() -> None:
    assert load(ROOT / "config.yaml").outputs


def test_documented_example_belongs_to_the_packaged_scenario() -> None:
    """Devices, beacons and sound speed are the same; the first state is, to its rounding."""
    example = load(ROOT / "config.yaml")
    faults: list[str] = []
    twin = build(Config, gateway_config(load_scenario(DEMO)), faults)
    assert twin is not None, faults
    for name, device in twin.devices.items():
        link = example.devices[name].link
        if isinstance(link, UdpLink):  # whom to listen to is the gateway's own affair
            link = msgspec.structs.replace(link, allow=())
        assert msgspec.structs.replace(example.devices[name], link=link) == device
    assert example.devices.keys() == twin.devices.keys()
    assert example.beacons == twin.beacons
    assert example.sound_speed_m_s == twin.sound_speed_m_s
    assert example.filter == twin.filter
    assert example.initial.sigma == twin.initial.sigma
    ours, theirs = example.initial, twin.initial
    assert ours.lat_deg == pytest.approx(theirs.lat_deg, abs=1e-6)
    assert ours.lon_deg == pytest.approx(theirs.lon_deg, abs=1e-6)
    assert ours.height_m == pytest.approx(theirs.height_m, abs=0.01)
    assert ours.velocity_ned_m_s == pytest.approx(theirs.velocity_ned_m_s, abs=1e-3)
    assert ours.attitude_deg == pytest.approx(theirs.attitude_deg, abs=1e-3)
