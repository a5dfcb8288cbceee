"""Records of a healthy device, and what ingest makes of them."""

from itertools import groupby
from operator import attrgetter

import numpy as np

from drivers.records import ImuRecord
from gateway.config import ImuDevice, UsblDevice
from gateway.ingest.imu import ImuIngest
from gateway.ingest.usbl import UsblIngest
from gateway.schema import build

T0 = 5_000_000_000
PERIOD_NS = 5_000_000
ANGLE, VELOCITY = (1e-3, -2e-3, 3e-3), (0.01, 0.02, -0.05)
NOISE = {
    "angle_random_walk_deg_sqrt_h": 0.002,
    "gyro_bias_deg_h": 0.02,
    "velocity_random_walk_ug_sqrt_hz": 20,
    "accel_bias_ug": 50,
}
UDP = {"type": "udp", "bind": "127.0.0.1", "port": 7001}
SERIAL = {"type": "serial", "port": "/dev/ttyUSB0", "baud": 9600}


def made(kind, data):
    faults: list[str] = []
    block = build(kind, data, faults)
    assert block is not None, faults
    return block


def imu(**changes):
    data = {"kind": "imu", "codec": "kvh1750", "link": UDP, "rate_hz": 200, "noise": NOISE}
    return ImuIngest(made(ImuDevice, data | changes))


def usbl(**changes):
    noise = {"bearing_deg": 1.0, "elevation_deg": 1.0, "range_m": 0.2}
    data = {"kind": "usbl", "codec": "tracklink-lxt", "link": SERIAL, "noise": noise}
    return UsblIngest("usbl0", made(UsblDevice, data | changes), 1500.0)


def sample(k, t_rx_ns=None, **changes):
    """Frame `k` of a healthy IMU, arriving when it is ready."""
    fields = {"delta_angle_rad": ANGLE, "delta_velocity_m_s": VELOCITY, "sequence": k % 128}
    t = T0 + k * PERIOD_NS if t_rx_ns is None else t_rx_ns
    return ImuRecord(t_rx_ns=t, **(fields | changes))


def taken(ingest, records):
    """Times and rows of what became of the records; those with one stamp were one chunk."""
    for _, chunk in groupby(records, key=attrgetter("t_rx_ns")):
        for record in chunk:
            ingest.take(record)
        ingest.end_of_chunk()
    blocks = ingest.flush()
    t_ns = np.concatenate([np.frombuffer(b.t_ns, dtype=np.int64) for b in blocks])
    rows = np.concatenate([np.frombuffer(b.rows).reshape(-1, 8) for b in blocks])
    return t_ns, rows


def microseconds(k, offset_us=0):
    """Time (s) of frame `k` by a counter of 32 bits that counts microseconds."""
    return ((offset_us + 5000 * k) % (1 << 32)) * 1e-6
