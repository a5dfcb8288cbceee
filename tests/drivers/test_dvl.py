"""Doppler logs that speak in lines, as they are printed: PD6, Water Linked, Nortek."""

from datetime import UTC, datetime

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from drivers import registry
from drivers.nmea0183 import sentence
from drivers.records import (
    DepthRecord,
    DvlRecord,
    HeadingRecord,
    NmeaSentence,
    Rejected,
    TimeRecord,
)
from tests.drivers.aiding_frames import A50_REPORT, line_of
from tests.drivers.streams import read


# Printed in the description of Water Linked's PD6, which pads by blanks.
@pytest.mark.parametrize(
    ("line", "record"),
    [
        (
            ":BI,  +123,  -420, +2000,    +0,A",
            DvlRecord(t_rx_ns=7, velocity_m_s=(-0.42, 0.123, -2.0), error_velocity_m_s=0.0),
        ),
        (
            ":BS,  -420,  +123, +2000,A",
            DvlRecord(t_rx_ns=7, velocity_m_s=(0.123, -0.42, -2.0), axes="level"),
        ),
        (
            ":BE,    +0,    +0,    +0,V",
            DvlRecord(t_rx_ns=7, axes="north", valid=False),
        ),
        (
            ":BD,       +0.00,       +0.00,       +0.00,   5.32,  0.00",
            DepthRecord(t_rx_ns=7, altitude_m=5.32),
        ),
        (
            ":SA, +1.50, -2.25,270.00",
            HeadingRecord(
                t_rx_ns=7, heading_deg=270.0, reference="magnetic", pitch_deg=1.5, roll_deg=-2.25
            ),
        ),
        (
            ":TS,22020812061850, 0.0, +0.0,   0.0,1475.0,  0",
            TimeRecord(
                t_rx_ns=7,
                unix_s=datetime(2022, 2, 8, 12, 6, 18, 500_000, tzinfo=UTC).timestamp(),
            ),
        ),
    ],
)
def test_pd6_lines(line, record):
    assert read("pd6", f"{line}\r\n".encode()) == replace(record, line_bytes=len(line) + 2)


def test_pd6_of_another_maker_has_other_axes():
    line = b":BI,  +123,  -420, +2000,    +0,A\r\n"
    record = read("pd6", line, axes="forward_starboard_down")
    assert record.velocity_m_s == pytest.approx((0.123, -0.42, 2.0))


@pytest.mark.parametrize("said", ["+00100,-32768,+00100,+00000,A", "+00100,+00100,+00100,+00000,V"])
def test_pd6_without_lock(said):
    record = read("pd6", f":BI,{said}\r\n".encode())
    assert (record.valid, record.velocity_m_s) == (False, None)
    assert not read("pd6", b":BD,+0.00,+0.00,+0.00,0000.00,000.00\r\n").valid


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (":BI,1,2,3,A", "syntax"),
        (":BI,1,2,3,4,X", "syntax"),
        (":BI,1,2,x,4,A", "syntax"),
        (":BI,1,2,99999,4,A", "range"),
        (":SA,1,2,361", "range"),
        (":TS,22023012061800,0,0,0,1500,0", "range"),
        (":TS,22020825061800,0,0,0,1500,0", "range"),
        (":TS,2202081206180,0,0,0,1500,0", "syntax"),
        ("BI,1,2,3,4,A", "syntax"),
    ],
)
def test_pd6_that_is_none(line, reason):
    record = read("pd6", f"{line}\r\n".encode())
    assert isinstance(record, Rejected)
    assert record.reason == reason


def test_pd6_of_the_water_is_another_frame():
    record = read("pd6", b":WI,+00100,+00000,+00000,+00000,A\r\n")
    assert (record.name, record.data) == ("WI", b":WI,+00100,+00000,+00000,+00000,A\r\n")


@pytest.mark.parametrize("axes", ["starboard_forward_up", "forward_starboard_down"])
@pytest.mark.parametrize("turned", ["sensor", "level", "north"])
def test_pd6_that_is_written_is_read(axes, turned):
    codec = registry.lookup("pd6")
    record = DvlRecord(t_rx_ns=7, velocity_m_s=(1.5, -0.25, 0.125), axes=turned)
    line = codec.encode(record, codec.options(axes=axes))
    assert read("pd6", line, axes=axes) == replace(record, line_bytes=len(line))


def test_the_printed_report():
    record = read("waterlinked-dvl", line_of(A50_REPORT))
    assert record == DvlRecord(
        t_rx_ns=7,
        line_bytes=len(line_of(A50_REPORT)),
        age_s=pytest.approx(0.189319),
        velocity_m_s=(-3.713480691658333e-05, 5.703703573090024e-05, 2.4990416932269e-05),
        t_device_s=pytest.approx(1638191471.563017, abs=1e-6),
        altitude_m=0.4949815273284912,
        sd_m_s=pytest.approx((1.5643e-4, 1.2106e-4, 3.9965e-5), rel=1e-4),
    )


def test_a_report_without_lock():
    record = read(
        "waterlinked-dvl", line_of(A50_REPORT | {"velocity_valid": False, "altitude": -1})
    )
    assert (record.valid, record.error_code, record.velocity_m_s) == (False, "no_lock", None)
    assert (record.altitude_m, record.sd_m_s) == (None, UNSET)


@pytest.mark.parametrize("changes", [{"type": "velocity_water"}, {"tracking_mode": "water"}])
def test_a_report_of_the_water_is_no_bottom_track(changes):
    record = read("waterlinked-dvl", line_of(A50_REPORT | changes))
    assert (record.valid, record.error_code, record.velocity_m_s) == (False, "water", None)
    assert record.water_velocity_m_s[0] == -3.713480691658333e-05


@pytest.mark.parametrize("late_us", [-5, 11_000_000])
def test_a_clock_that_was_set_in_between_tells_no_age(late_us):
    at = A50_REPORT["time_of_validity"]
    assert (
        read("waterlinked-dvl", line_of(A50_REPORT | {"time_of_transmission": at + late_us})).age_s
        is UNSET
    )


def test_other_reports_are_whole_frames():
    report = {"ts": 49056.809, "x": 12.4, "yaw": 0.6, "type": "position_local", "format": "json_v3"}
    record = read("waterlinked-dvl", line_of(report))
    assert (record.name, record.data) == ("position_local", line_of(report))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b'{"type":"velocity"}\r\n', "syntax"),
        (b'{"vx":1}\r\n', "syntax"),
        (line_of(A50_REPORT | {"vx": "fast"}), "syntax"),
        (line_of(A50_REPORT | {"vx": 1e30}), "range"),
        (line_of(A50_REPORT | {"covariance": [[-1, 0, 0], [0, 0, 0], [0, 0, 0]]}), "range"),
        (line_of(A50_REPORT)[:-10] + b"\r\n", "syntax"),
        (b"[1, 2]\r\n", "unknown"),
    ],
)
def test_what_is_no_report(line, reason):
    codec = registry.lookup("waterlinked-dvl")
    records = list(codec.decoder(codec.options()).feed(line, 0))
    assert {record.reason for record in records} == {reason}
    assert b"".join(record.data for record in records) == line


def test_a_report_that_is_written_is_read():
    codec = registry.lookup("waterlinked-dvl")
    record = DvlRecord(
        t_rx_ns=7,
        velocity_m_s=(1.5, -0.25, 0.125),
        sd_m_s=(0.5, 0.25, 0.125),
        altitude_m=700.25,
        t_device_s=1_659_947_538.25,
        age_s=0.125,
    )
    line = codec.encode(record, codec.options())
    assert read("waterlinked-dvl", line) == replace(record, line_bytes=len(line))


TAGGED = (
    "TIME=1452244916.7508",
    *("DT1=23.961", "DT2=-48.122", "VX=1.5", "VY=-0.25", "VZ=0.125", "FOM=0.004"),
    *("D1=10.00", "D2=0.00", "D3=12.00", "D4=14.00"),
)
HEALTH = ("BATT=23.4", "SS=1567.8", "PRESS=1.2", "TEMP=12.3", "STAT=0x000FFFFF")


@pytest.mark.parametrize(
    ("address", "fields", "sound_speed"),
    [
        ("PNORBT6", TAGGED, UNSET),
        ("PNORBT8", TAGGED + HEALTH, 1567.8),
        ("PNORBT7", tuple(field.partition("=")[2] for field in TAGGED), UNSET),
        ("PNORBT9", tuple(field.partition("=")[2] for field in TAGGED + HEALTH), 1567.8),
    ],
)
def test_nortek(address, fields, sound_speed):
    line = sentence(address, fields, longest=300)
    assert read("nortek-dvl", line) == DvlRecord(
        t_rx_ns=7,
        line_bytes=len(line),
        age_s=pytest.approx(0.048122),
        velocity_m_s=(1.5, -0.25, 0.125),
        t_device_s=1452244916.7508,
        altitude_m=12.0,
        sd_m_s=(0.004,) * 3,
        sound_speed_m_s=sound_speed,
    )


@pytest.mark.parametrize(("place", "value"), [(3, "-32.768"), (5, "-32.76800"), (6, "10.00000")])
def test_nortek_without_lock(place, value):
    fields = [field.partition("=")[2] for field in TAGGED]
    fields[place] = value
    record = read("nortek-dvl", sentence("PNORBT7", fields, longest=300))
    assert (record.valid, record.error_code, record.velocity_m_s) == (False, "no_lock", None)


@pytest.mark.parametrize(
    ("address", "fields"),
    [
        ("PNORBT7", ("1", "2")),
        ("PNORBT6", tuple(reversed(TAGGED))),
        ("PNORBT7", tuple(TAGGED)),
    ],
)
def test_nortek_that_is_none(address, fields):
    assert read("nortek-dvl", sentence(address, fields, longest=300)).reason == "syntax"


def test_nortek_beyond_all_numbers():
    fields = [field.partition("=")[2] for field in TAGGED]
    fields[3] = "9" * 400
    assert read("nortek-dvl", sentence("PNORBT7", fields, longest=600)).reason == "range"


def test_nortek_of_the_water_is_as_it_is():
    assert isinstance(read("nortek-dvl", sentence("PNORWT7", ("1", "2"))), NmeaSentence)


@pytest.mark.parametrize("name", ["pd0", "pd6", "waterlinked-dvl", "nortek-dvl"])
def test_what_cannot_be_written(name):
    codec = registry.lookup(name)
    sentence = NmeaSentence(t_rx_ns=0, talker="SD", formatter="DPT", fields=())
    with pytest.raises(ValueError, match=f"{name} cannot say"):
        codec.encode(sentence, codec.options())
