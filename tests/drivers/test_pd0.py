"""Doppler logs that speak PD0: ensembles put together by hand from the manual's tables."""

import math
import struct
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace

from drivers import registry
from drivers.records import (
    DvlRecord,
    OtherFrame,
    Rejected,
)
from tests.drivers.streams import read


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
