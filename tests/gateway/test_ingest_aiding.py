"""Depths, bottom tracks and headings to fixes: units, noise, and what is counted instead."""

import math

import pytest

from drivers.records import (
    DepthRecord,
    DvlRecord,
    HeadingRecord,
    LblRecord,
    LblReply,
    NmeaSentence,
    Rejected,
)
from gateway.config import DepthDevice, DvlDevice, HeadingDevice, LblDevice
from gateway.ingest.aiding import depth_ingest, dvl_ingest, heading_ingest
from gateway.ingest.lbl import LblIngest, Sea
from gateway.messages import BeaconRange, BottomVelocity, Depth, HeadingFix, RadialRate
from gateway.schema import build

T0 = 5_000_000_000
UDP = {"type": "udp", "port": 7003}
SENTENCE = NmeaSentence(t_rx_ns=T0, talker="SD", formatter="MTW", fields=())


def block(kind, **data):
    faults: list[str] = []
    device = build(kind, {"kind": kind.kind, "link": UDP} | data, faults)
    assert device is not None, faults
    return device


def depth(**changes):
    data = {"codec": "nmea-depth", "noise": {"depth_m": 0.1}, "surface_height_m": 21.5}
    return depth_ingest("depth0", block(DepthDevice, **(data | changes)))


def dvl(**changes):
    data = {"codec": "pd6", "noise": {"velocity_m_s": [0.02, 0.03, 0.01]}}
    return dvl_ingest("dvl0", block(DvlDevice, **(data | changes)))


def heading(**changes):
    data = {"codec": "nmea-heading", "noise": {"heading_deg": 0.5}}
    return heading_ingest("gyro0", block(HeadingDevice, **(data | changes)))


SEA = Sea(1480.0, {"A": 0.0, "B": 0.25, "S": 0.0}, frozenset({"S"}))


def lbl(**changes):
    data = {"codec": "micromodem", "noise": {"range_m": 1.0}, "beacons": ["A", "B"]}
    return LblIngest("lbl0", block(LblDevice, **(data | changes)), SEA)


def taken(ingest, record):
    ingest.take(record)
    return ingest.flush()


def test_a_depth_is_a_height_below_the_surface():
    ingest = depth(clock={"latency_ms": 80})
    assert taken(ingest, DepthRecord(t_rx_ns=T0, depth_m=120.25)) == [
        Depth(T0 - 80_000_000, "depth0", -98.75, 0.1)
    ]
    assert ingest.counts.measurements == 1


def test_a_bottom_track_is_scaled_by_the_sound_speed():
    record = DvlRecord(t_rx_ns=T0, velocity_m_s=(2.0, -0.5, 0.25), age_s=0.125)
    [fix] = taken(dvl(scale=1.01), record)
    assert fix == BottomVelocity(
        T0 - 125_000_000,
        "dvl0",
        pytest.approx((2.02, -0.505, 0.2525)),
        (0.02, 0.03, 0.01),
    )


def test_a_heading_in_radians():
    [fix] = taken(heading(), HeadingRecord(t_rx_ns=T0, heading_deg=270.0))
    assert fix == HeadingFix(T0, "gyro0", pytest.approx(1.5 * math.pi), math.radians(0.5))


def test_an_instrument_may_say_that_it_is_worse_but_not_that_it_is_better():
    [shy] = taken(depth(), DepthRecord(t_rx_ns=T0, depth_m=1.0, sd_m=0.5))
    [sure] = taken(depth(), DepthRecord(t_rx_ns=T0, depth_m=1.0, sd_m=0.001))
    assert (shy.sd, sure.sd) == (0.5, 0.1)
    told = DvlRecord(t_rx_ns=T0, velocity_m_s=(1.0, 0.0, 0.0), sd_m_s=(0.5, 0.001, 0.001))
    [fix] = taken(dvl(), told)
    assert fix.sd == (0.5, 0.03, 0.01)
    [fix] = taken(heading(), HeadingRecord(t_rx_ns=T0, heading_deg=1.0, sd_deg=2.0))
    assert fix.sd == pytest.approx(math.radians(2.0))


@pytest.mark.parametrize(
    ("ingest", "record", "reason"),
    [
        (depth, DepthRecord(t_rx_ns=T0, valid=False), "invalid"),
        (depth, DepthRecord(t_rx_ns=T0, altitude_m=5.0), "altitude"),
        (depth, DepthRecord(t_rx_ns=T0), "no_depth"),
        (depth, SENTENCE, "not_depth"),
        (dvl, DvlRecord(t_rx_ns=T0, valid=False, error_code="no_lock"), "no_lock"),
        (dvl, DvlRecord(t_rx_ns=T0, valid=False), "invalid"),
        (dvl, DvlRecord(t_rx_ns=T0), "no_velocity"),
        (dvl, DvlRecord(t_rx_ns=T0, velocity_m_s=(1, 0, 0), axes="north"), "not_sensor_axes"),
        (dvl, DvlRecord(t_rx_ns=T0, velocity_m_s=(1, 0, 0), axes="level"), "not_sensor_axes"),
        (dvl, SENTENCE, "not_dvl"),
        (heading, HeadingRecord(t_rx_ns=T0, valid=False), "invalid"),
        (heading, HeadingRecord(t_rx_ns=T0, roll_deg=1.0), "no_heading"),
        (heading, HeadingRecord(t_rx_ns=T0, heading_deg=1.0, reference="magnetic"), "magnetic"),
        (heading, SENTENCE, "not_heading"),
        (lbl, LblRecord(t_rx_ns=T0, replies=()), "no_reply"),
        (lbl, LblRecord(t_rx_ns=T0, replies=(), valid=False), "invalid"),
        (lbl, SENTENCE, "not_lbl"),
    ],
)
def test_what_is_no_fix_says_why(ingest, record, reason):
    made = ingest()
    assert taken(made, record) == []
    assert dict(made.counts.ignored) == {reason: 1}


@pytest.mark.parametrize("ingest", [depth, dvl, heading, lbl])
def test_rejected_bytes_are_counted(ingest):
    made = ingest()
    assert taken(made, Rejected(t_rx_ns=T0, reason="checksum", data=b"$GP")) == []
    assert (made.counts.rejected["checksum"], made.counts.rejected_bytes) == (1, 3)
    assert made.counts.records == 0


def replies(**one_way_s: float) -> tuple[LblReply, ...]:
    return tuple(LblReply(beacon=b, one_way_s=t) for b, t in one_way_s.items())


def test_replies_of_one_ping_are_each_of_their_own_moment():
    """B answers 0.25 s late: its reply is the last, 0.45 s after the ping; A came at 0.2."""
    record = LblRecord(t_rx_ns=T0, t_ping_s=100.0, replies=replies(A=0.1, B=0.1))
    a, b = taken(lbl(clock={"latency_ms": 50}), record)
    last = T0 - 50_000_000
    ping = last - 450_000_000
    assert a == BeaconRange(ping + 200_000_000, "lbl0", "A", pytest.approx(148.0), ping)
    assert b == BeaconRange(last, "lbl0", "B", pytest.approx(148.0), ping)


def test_a_time_out_that_is_not_told_leaves_no_time():
    made = lbl()
    assert taken(made, LblRecord(t_rx_ns=T0, t_ping_s=100.0, replies=replies(A=0.1))) == []
    assert dict(made.counts.ignored) == {"incomplete": 1}


def test_with_the_instruments_clock_a_time_out_does_no_harm():
    """Ten whole cycles say what its time means; then B is silent and A's reply waits a second."""
    made = lbl(clock={"source": "device"})
    pings = [T0 + k * 4_000_000_000 for k in range(11)]
    for k, ping in enumerate(pings[:10]):
        both = replies(A=0.1, B=0.1)
        taken(made, LblRecord(t_rx_ns=ping + 450_000_000, t_ping_s=4.0 * k, replies=both))
    alone = LblRecord(t_rx_ns=pings[10] + 1_450_000_000, t_ping_s=40.0, replies=replies(A=0.1))
    [fix] = taken(made, alone)
    assert fix.t_ns == pytest.approx(pings[10] + 200_000_000, abs=10_000)
    assert fix.t_transmit_ns == pytest.approx(pings[10], abs=10_000)
    assert made.counts.ignored == {}


def test_a_range_by_itself_tells_when_its_ping_left():
    """No time of the ping: the filter takes it from the range."""
    [fix] = taken(lbl(), LblRecord(t_rx_ns=T0, replies=replies(B=0.5)))
    assert fix == BeaconRange(T0, "lbl0", "B", pytest.approx(740.0), None)
    metres = LblReply(beacon="A", range_m=321.0)
    assert taken(lbl(), LblRecord(t_rx_ns=T0, replies=(metres,))) == [
        BeaconRange(T0, "lbl0", "A", 321.0, None)
    ]


def test_a_radial_rate_is_a_measurement_of_its_own():
    reply = LblReply(beacon="A", range_rate_m_s=-1.5)
    assert taken(lbl(), LblRecord(t_rx_ns=T0, replies=(reply,))) == [
        RadialRate(T0, "lbl0", "A", (-1.5,))
    ]


def test_beacons_that_are_not_asked_need_not_answer():
    """S sends by the clock: one way, and it is none of the interrogated."""
    record = LblRecord(t_rx_ns=T0, t_ping_s=1.0, replies=replies(A=0.1, B=0.1, S=0.2))
    *_, s = taken(lbl(), record)
    assert s.t_ns == T0 - 250_000_000
    assert s.slant_range == pytest.approx(296.0)
