"""Doppler logs: printed lines and reports, ensembles put together by hand from the tables."""

import math
import struct
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace

from drivers import registry
from drivers.nmea0183 import sentence
from drivers.records import (
    DepthRecord,
    DvlRecord,
    HeadingRecord,
    NmeaSentence,
    OtherFrame,
    Record,
    Rejected,
    TimeRecord,
)
from tests.drivers.aiding_frames import A50_REPORT, line_of


def read(name: str, data: bytes, **options: Any) -> Record | Rejected:
    codec = registry.lookup(name)
    (record,) = codec.decoder(codec.options(**options)).feed(data, 7)
    return record


def bottom_track(
    velocity: tuple[int, int, int, int],
    *,
    coordinates: int,
    ranges: tuple[int, int, int, int] = (1000, 1010, 1020, 1030),
    system: int = 0x424B,
    fixed: bytes = b"",
    more: tuple[bytes, ...] = (),
) -> bytes:
    """An ensemble by the manual's tables: bytes counted from 1 there, from 0 here."""
    leader = bytearray(59)
    struct.pack_into("<HxxH", leader, 0, 0x0000, system)
    leader[25] = coordinates
    leader[59 - len(fixed) :] = fixed
    variable = bytearray(60)
    struct.pack_into("<HH7B", variable, 0, 0x0080, 17, 18, 4, 26, 10, 30, 15, 50)
    struct.pack_into("<H", variable, 14, 1482)
    bottom = bytearray(81)
    struct.pack_into("<H", bottom, 0, 0x0600)
    struct.pack_into("<4H4h", bottom, 16, *ranges, *velocity)
    types = (bytes(leader), bytes(variable), bytes(bottom), *more)
    at, offsets = 6 + 2 * len(types), []
    for data in types:
        offsets.append(at)
        at += len(data)
    head = struct.pack(f"<BBHBB{len(types)}H", 0x7F, 0x7F, at, 0, len(types), *offsets)
    body = head + b"".join(types)
    return body + struct.pack("<H", sum(body) % 65536)


BEAM, INSTRUMENT, SHIP, EARTH, TILTS = 0, 1 << 3, 2 << 3, 3 << 3, 1 << 2


def test_pd0_moves_the_bottom():
    """A bottom that comes from ahead and sinks away: the log goes ahead and up."""
    record = read("pd0", bottom_track((250, -1500, -100, 4), coordinates=INSTRUMENT))
    when = datetime(2018, 4, 26, 10, 30, 15, 500_000, tzinfo=UTC).timestamp()
    assert record == DvlRecord(
        t_rx_ns=7,
        line_bytes=record.line_bytes,
        velocity_m_s=pytest.approx((1.5, -0.25, -0.1)),
        t_device_s=when,
        altitude_m=pytest.approx(10.15),
        error_velocity_m_s=0.004,
        sound_speed_m_s=1482.0,
    )


@pytest.mark.parametrize(
    ("coordinates", "axes"),
    [
        (INSTRUMENT, "sensor"),
        (INSTRUMENT | TILTS, "sensor"),
        (SHIP, "sensor"),
        (SHIP | TILTS, "level"),
        (EARTH | TILTS, "north"),
    ],
)
def test_pd0_coordinates(coordinates, axes):
    record = read("pd0", bottom_track((250, -1500, -100, 4), coordinates=coordinates))
    assert record.axes == axes
    assert record.velocity_m_s == pytest.approx((1.5, -0.25, -0.1))


def beams(v_frd: np.ndarray, angle_deg: float, convex: bool = True) -> np.ndarray:
    """Speed (m/s) at which the bottom comes towards each beam of a log that moves by `v_frd`.

    Beam 3 ahead, 4 astern, 1 to port, 2 to starboard, all downwards; concave beams cross.
    """
    s, c = math.sin(math.radians(angle_deg)), math.cos(math.radians(angle_deg))
    s = s if convex else -s
    directions = np.array([[0, -s, c], [0, s, c], [s, 0, c], [-s, 0, c]])
    return directions @ v_frd


@given(
    v=st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-1, 1)),
    angle=st.sampled_from([(0, 15.0), (1, 20.0), (2, 30.0), (3, 25.0)]),
    convex=st.booleans(),
)
def test_pd0_beams_to_axes(v, angle, convex):
    """By the geometry of the beams: each hears the part of the motion along it."""
    code, angle_deg = angle
    system = 0x4043 | code << 8 | 8 * convex
    heard = np.round(1e3 * beams(np.array(v), angle_deg, convex)).astype(int)
    frame = bottom_track(tuple(heard), coordinates=BEAM, system=system, fixed=bytes([25]))
    record = read("pd0", frame)
    assert record.velocity_m_s == pytest.approx(v, abs=2e-3)
    assert record.error_velocity_m_s == pytest.approx(0.0, abs=5e-3)


@pytest.mark.parametrize("bad", range(4))
def test_pd0_three_beams_are_enough(bad):
    v = np.array([1.5, -0.75, 0.25])
    heard = np.round(1e3 * beams(v, 30.0)).astype(int).tolist()
    heard[bad] = -32768
    record = read("pd0", bottom_track(tuple(heard), coordinates=BEAM))
    assert record.velocity_m_s == pytest.approx(tuple(v), abs=3e-3)
    assert record.error_velocity_m_s is UNSET
    heard[bad - 1] = -32768
    lost = read("pd0", bottom_track(tuple(heard), coordinates=BEAM))
    assert (lost.valid, lost.error_code, lost.velocity_m_s) == (False, "no_lock", None)


def test_pd0_that_another_beam_angle_is_an_option():
    heard = tuple(np.round(1e3 * beams(np.array([2.0, 0.0, 0.0]), 22.0)).astype(int).tolist())
    other = bottom_track(heard, coordinates=BEAM, system=0x434B)
    assert read("pd0", other).reason == "range"
    turned = read("pd0", other, beam_angle_deg=22.0)
    assert turned.velocity_m_s == pytest.approx((2.0, 0.0, 0.0), abs=2e-3)


def test_pd0_without_lock_without_range_and_up():
    lost = read("pd0", bottom_track((-32768,) * 4, coordinates=INSTRUMENT, ranges=(0,) * 4))
    assert (lost.valid, lost.error_code, lost.altitude_m) == (False, "no_lock", None)
    ice = read("pd0", bottom_track((1, 2, 3, 4), coordinates=INSTRUMENT, system=0x42CB))
    assert (ice.valid, ice.error_code, ice.velocity_m_s) == (False, "up_facing", None)


def test_pd0_tells_its_age_unless_it_was_triggered():
    """Navigation parameters, bytes 54 to 69: microseconds to the first byte of the ensemble."""
    parameters = struct.pack("<H51x4I", 0x2013, 80_000, 82_000, 0, 84_000) + bytes(16)
    frame = bottom_track((0, 0, 0, 0), coordinates=INSTRUMENT, more=(parameters,))
    assert read("pd0", frame).age_s == pytest.approx(0.082)
    triggered = bytes([1]) + bytes(19)
    frame = bottom_track((0, 0, 0, 0), coordinates=INSTRUMENT, more=(parameters,), fixed=triggered)
    assert read("pd0", frame).age_s is UNSET


def test_pd0_without_bottom_track_is_another_frame():
    whole = bottom_track((0, 0, 0, 0), coordinates=INSTRUMENT)
    at = whole.index(b"\x00\x06", 120)
    body = whole[:at] + b"\x00\x05" + whole[at + 2 : -2]
    record = read("pd0", body + struct.pack("<H", sum(body) % 65536))
    assert isinstance(record, OtherFrame)


def test_pd0_with_a_short_data_type_is_rejected():
    body = bottom_track((0, 0, 0, 0), coordinates=INSTRUMENT)[:-12]
    body = body[:2] + struct.pack("<H", len(body)) + body[4:]
    record = read("pd0", body + struct.pack("<H", sum(body) % 65536))
    assert isinstance(record, Rejected)
    assert record.reason == "length"


LOG = DvlRecord(
    t_rx_ns=7,
    velocity_m_s=(1.5, -0.25, 0.125),
    altitude_m=700.25,
    t_device_s=1_659_947_538.25,
    error_velocity_m_s=0.004,
    sound_speed_m_s=1490.0,
)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"axes": "level"},
        {"axes": "north", "age_s": 0.5},
        {"error_velocity_m_s": UNSET, "altitude_m": None},
        {
            "velocity_m_s": None,
            "valid": False,
            "error_code": "no_lock",
            "error_velocity_m_s": UNSET,
        },
    ],
)
def test_pd0_that_is_written_is_read(changes):
    record = replace(LOG, **changes)
    codec = registry.lookup("pd0")
    line = codec.encode(record, codec.options())
    again = read("pd0", line)
    assert replace(again, altitude_m=record.altitude_m) == replace(record, line_bytes=len(line))
    assert again.altitude_m == pytest.approx(record.altitude_m)


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
    record = replace(
        LOG,
        sd_m_s=(0.5, 0.25, 0.125),
        age_s=0.125,
        error_velocity_m_s=UNSET,
        sound_speed_m_s=UNSET,
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
