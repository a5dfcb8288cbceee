"""STDBIN telegrams of the shared vectors and capture decode to the values stated beside them."""

import math
from collections import Counter
from itertools import pairwise

import dpkt
import pytest

from drivers.imu.stdbin.telegrams import STDBIN, StdbinOptions
from drivers.records import (
    CompensatedRecord,
    DepthRecord,
    DvlRecord,
    GnssRecord,
    HeadingRecord,
    ImuRecord,
    LblRecord,
    Record,
    Rejected,
    UsblRecord,
)
from tests.golden.vectors import frames, stated
from tests.shared_data import shared

NAVIGATION = [CompensatedRecord, HeadingRecord]
AIDING = [
    *(GnssRecord, GnssRecord, UsblRecord, UsblRecord, DepthRecord),
    *(DvlRecord, DvlRecord, LblRecord),
]


def read(telegram: bytes) -> list[Record | Rejected]:
    reader = STDBIN.decoder(StdbinOptions())
    return [*reader.feed(telegram, 1), *reader.close()]


def pairs(name: str) -> list[tuple[list[Record | Rejected], dict]]:
    telegrams = frames(name)
    return [(read(t), said) for t, said in zip(telegrams, stated(name)["decoded"], strict=False)]


def radians(values: list[float]) -> object:
    return pytest.approx([math.radians(value) for value in values], rel=1e-12)


@pytest.mark.parametrize("name", ["ixblue_stdbin_v2", "ixblue_stdbin_v3", "ixblue_stdbin_v5"])
def test_navigation_blocks(name: str) -> None:
    for records, said in pairs(name):
        has_raw = "raw_accel_vessel" in said
        assert [type(r) for r in records[:3]][-2:] == NAVIGATION or not has_raw
        compensated, attitude = records[has_raw : has_raw + 2]
        time_s = said["validity_time_100us"] * 1e-4
        assert compensated.rate_rad_s == radians(said["rotation_rate_comp_dps"])
        assert list(compensated.acceleration_m_s2) == said["accel_gravity_comp"]
        heading, roll, pitch = said["attitude_heading"]
        assert (attitude.heading_deg, attitude.roll_deg) == (heading, roll)
        assert attitude.pitch_deg == -pitch
        assert attitude.sd_deg == said["attitude_heading_std"][0]
        assert (compensated.t_device_s, attitude.t_device_s) == (time_s, time_s)
        assert compensated.sequence == said["counter"]
        if has_raw:
            sample = records[0]
            assert isinstance(sample, ImuRecord)
            assert list(sample.specific_force_m_s2) == said["raw_accel_vessel"]
            assert sample.rate_rad_s == radians(said["raw_rotation_rate_dps"])
            assert sample.temperature_c == said["temperatures"][0]
            assert (sample.sequence, sample.t_device_s) == (said["counter"], time_s)
            assert sample.valid


def test_aiding_blocks_with_their_own_times() -> None:
    for records, said in pairs("ixblue_stdbin_v3"):
        assert [type(r) for r in records] == [ImuRecord, *NAVIGATION, *AIDING]
        gnss, _, usbl, south, depth, bottom, water, lbl = records[3:]
        validity = said["validity_time_100us"]
        for record, key in ((gnss, "gnss1"), (usbl, "usbl1"), (depth, "depth"), (lbl, "lbl1")):
            told_s = record.t_ping_s if key == "lbl1" else record.t_device_s
            assert told_s == pytest.approx(said[key][0] * 1e-4)
            assert record.age_s == pytest.approx((validity - said[key][0]) * 1e-4)
        assert (gnss.lat_deg, gnss.lon_deg) == (said["gnss1"][3], said["gnss1"][4])
        assert (gnss.quality, gnss.valid, gnss.height_m) == (4, True, None)
        assert list(gnss.sd_m) == said["gnss1"][6:9]
        assert (usbl.beacon, south.beacon) == ("ABC", "DEF")
        assert (usbl.lat_deg, usbl.lon_deg) == (said["usbl1"][3], said["usbl1"][4])
        assert (south.lat_deg, south.lon_deg) == (said["usbl2"][3], said["usbl2"][4] - 360)
        assert (depth.depth_m, depth.sd_m) == tuple(said["depth"][1:])
        x, y, z = said["dvl_ground1"][2:5]
        assert (bottom.velocity_m_s, bottom.altitude_m) == ((x, -y, -z), said["dvl_ground1"][6])
        assert bottom.sound_speed_m_s == said["dvl_ground1"][5]
        assert list(bottom.sd_m_s) == said["dvl_ground1"][7:]
        x, y, z = said["dvl_water1"][2:5]
        assert (water.velocity_m_s, water.valid) == (None, False)
        assert water.water_velocity_m_s == (x, -y, -z)
        assert [(r.beacon, r.range_m) for r in lbl.replies] == [("0", said["lbl1"][6])]


def test_every_telegram_of_the_log() -> None:
    records = read(b"".join(frames("ixblue_stdbin_v3")))
    assert not any(isinstance(record, Rejected) for record in records)
    samples = [record for record in records if isinstance(record, ImuRecord)]
    assert len(samples) == 17
    for a, b in pairwise(samples):
        assert b.sequence == a.sequence + 1
        assert b.t_device_s - a.t_device_s == pytest.approx(1.0, abs=2e-4)


def test_capture_over_udp() -> None:
    """The time of validity is that of the day: beside the packet's own UTC stamp."""
    kinds: Counter[str] = Counter()
    with shared("captures", "stdbin_V3_2Hz.pcapng").open("rb") as file:
        reader = STDBIN.decoder(StdbinOptions())
        for stamp, raw in dpkt.pcapng.Reader(file):
            datagram = dpkt.ethernet.Ethernet(raw).data.data
            if getattr(datagram, "dport", 0) != 8200:
                continue
            for record in reader.feed(datagram.data, 0):
                kinds[type(record).__name__] += 1
                if isinstance(record, ImuRecord):
                    late = stamp % 86400 - record.t_device_s
                    assert abs(late) < 0.1
    assert kinds["ImuRecord"] > 10
    assert "Rejected" not in kinds
