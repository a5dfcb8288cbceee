"""A small configuration file, edited and written, and what is found wrong with it."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from gateway.config import load
from gateway.errors import ConfigError

GONE = object()
GOOD: dict[str, Any] = {
    "vehicle": "auv1",
    "devices": {
        "imu0": {
            "kind": "imu",
            "codec": "kvh1750",
            "link": {"type": "udp", "port": 7001},
            "rate_hz": 200,
            "noise": {
                "angle_random_walk_deg_sqrt_h": 0.002,
                "gyro_bias_deg_h": 0.02,
                "velocity_random_walk_ug_sqrt_hz": 20,
                "accel_bias_ug": 50,
            },
        },
        "usbl0": {
            "kind": "usbl",
            "codec": "tracklink-lxt",
            "link": {"type": "serial", "port": "/dev/ttyUSB1"},
            "noise": {"bearing_deg": 1, "elevation_deg": 1, "range_m": 0.2},
        },
    },
    "beacons": {"1": {"lat_deg": 39.8, "lon_deg": 116.2, "height_m": -50}},
    "initial": {
        "lat_deg": 39.8,
        "lon_deg": 116.2,
        "height_m": 0,
        "attitude_deg": [0, 0, 90],
        "sigma": {"position_m": [5, 5, 1], "velocity_m_s": 0.2, "attitude_deg": [1, 1, 2]},
    },
}
EVERY_KIND = """\
vehicle: auv1
devices:
  imu0:
    kind: imu
    codec: kvh1751
    link: {type: udp, port: 70000}
    rate_hz: 200 Hz
    noise:
      angle_random_walk_deg_sqrt_h: 0.002
      gyro_bias_deg_h: yes
      velocity_random_walk_ug_sqrt_hz: .nan
      accel_bias_mg: 50
  usbl0:
    kind: usbl
    codec: tracklink-lxt
    link: {type: udp, port: "7002"}
    noise: {bearing_deg: 1, elevation_deg: 1, range_cm: 20}
    lever_arm_m: [0.5, 0]
  dvl0:
    kind: dvll
initial:
  lat_deg: 98
  lon_deg: 116.2
  height_m: 0
  attitude_deg: [0, 0, north]
  sigma: {position_m: [5, 5, -1], velocity_m_s: 0.2, attitude_deg: [1, 1, 2]}
filter: {couplign: loose}
outputs:
  - {type: zenoh, rate_hz: 10}
  - {type: nmea, link: {type: tcp, port: 0}, sentences: [GGA, GSV]}
"""
EVERY_FAULT = """\
devices.imu0.link.port: expected an integer from 1 to 65535, got 70000
devices.imu0.rate_hz: expected a number > 0 and <= 10000, got "200 Hz"
devices.imu0.noise.gyro_bias_deg_h: expected a number >= 0, got "yes"
devices.imu0.noise.velocity_random_walk_ug_sqrt_hz: expected a number > 0, got nan
devices.imu0.noise.accel_bias_ug: missing
devices.imu0.noise.accel_bias_mg: unknown key; did you mean accel_bias_ug?
devices.usbl0.link.port: expected an integer from 1 to 65535, got "7002" (take away the quotes)
devices.usbl0.noise.range_m: missing
devices.usbl0.noise.range_cm: unknown key; did you mean range_m?
devices.usbl0.lever_arm_m: expected a list of 3 numbers, got 2
devices.dvl0.kind: unknown kind "dvll"; one of: imu, usbl, lbl, gnss, depth, dvl, heading
initial.lat_deg: expected a number from -90 to 90, got 98
initial.attitude_deg[2]: expected a number from -360 to 360, got "north"
initial.sigma.position_m[2]: expected a number >= 0, got -1
filter.couplign: unknown key; did you mean coupling?
outputs[1].link.port: expected an integer from 1 to 65535, got 0
outputs[1].sentences[1]: expected one of DBS, DBT, DPT, GBS, GGA, GLL, GSA, GST, HDT, \
PUNAV, RMC, THS, TLL, TTM, VTG, ZDA, got "GSV"
devices.imu0.codec: no codec is called "kvh1751"; did you mean kvh1750?
beacons: missing; devices.usbl0 needs at least one
""".splitlines()


def edited(*edits: tuple[str, Any]) -> dict[str, Any]:
    """GOOD with the values at some dotted paths replaced, or GONE."""
    data = copy.deepcopy(GOOD)
    for path, value in edits:
        *way, last = path.split(".")
        block = data
        for key in way:
            block = block.setdefault(key, {})
        if value is GONE:
            del block[last]
        else:
            block[last] = value
    return data


def written(folder: Path, content: str | dict[str, Any]) -> Path:
    path = folder / "config.yaml"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def faults_of(path: Path) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert caught.value.file == path
    assert caught.value.exit_code == 2
    return caught.value.faults
