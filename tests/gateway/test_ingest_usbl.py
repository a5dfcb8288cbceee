"""Acoustic fixes on their way in: axes, units, what they do not carry, and why one is none."""

import math

import msgspec
import numpy as np
import pytest

from drivers import registry
from drivers.records import Rejected, TimeDifference, UsblRecord
from gateway.config import Config
from gateway.ingest import intakes
from gateway.messages import UsblFix
from gateway.schema import build
from tests.gateway.emulated import demo_data, make
from tests.gateway.ingested import T0, UDP, sample, usbl
from tests.gateway.voyages import configuration

HERE = {"bearing_deg": None, "elevation_deg": None, "slant_range_m": None}
HERE |= {"lat_deg": float(np.degrees(0.5)), "lon_deg": float(np.degrees(-1.2)), "depth_m": 40.0}
"""A beacon's place on the Earth, and nothing of how it is seen."""


def sighting(**changes):
    fields = {"beacon": "1", "bearing_deg": 90.0, "elevation_deg": -30.0, "slant_range_m": 87.0}
    return UsblRecord(t_rx_ns=T0, **(fields | changes))


def test_degrees_become_radians_and_the_stamp_the_replys_arrival():
    """500 ms latency and 60 bytes at 9600 baud before the first byte was seen."""
    ingest = usbl(clock={"source": "arrival", "latency_ms": 500})
    ingest.take(sighting(line_bytes=60))
    (fix,) = ingest.flush()
    assert fix.t_ns == T0 - 500_000_000 - round(60 * 10 * 1e9 / 9600)
    assert (fix.device, fix.beacon, fix.slant_range) == ("usbl0", "1", 87.0)
    assert fix.bearing == pytest.approx(np.pi / 2.0)
    assert fix.elevation == pytest.approx(-np.pi / 6.0)
    assert ingest.flush() == []
    assert ingest.counts.measurements == 1


@pytest.mark.parametrize(
    ("pause_s", "changes", "expected_s"),
    [
        (0.0, {}, 0.5),
        (0.1, {}, 0.0),
        (0.0, {"link": UDP}, 0.0),
        (0.0, {"clock": {"source": "device"}}, 0.0),
    ],
    ids=["at once", "after a pause", "packets", "told its time"],
)
def test_what_stood_on_the_line_before_a_sentence_may_have_held_it_up(pause_s, changes, expected_s):
    """480 bytes at 9600 baud, in two pieces, that are no sentence's."""
    ingest = usbl(codec="evologics", **changes)
    byte_s = 10 / 9600
    begin_s = 240 * byte_s
    for k in (1, 2):
        t_ns = T0 + round((k * begin_s - 200 * byte_s) * 1e9)
        junk = Rejected(t_rx_ns=t_ns, line_bytes=40, reason="unknown", data=bytes(240))
        ingest.take(junk)
    t_ns = T0 + round((2 * begin_s + pause_s + 60 * byte_s) * 1e9)
    ingest.take(msgspec.structs.replace(sighting(line_bytes=60, t_device_s=1.0), t_rx_ns=t_ns))
    (fix,) = ingest.flush()
    assert fix.t_sd_s == pytest.approx(expected_s, abs=1e-6)


def test_what_a_sentence_does_not_carry_stays_missing():
    ingest = usbl()
    ingest.take(sighting(bearing_deg=None, elevation_deg=None))
    ingest.take(sighting(slant_range_m=None))
    fixes = ingest.flush()
    assert [(f.bearing is None, f.slant_range is None) for f in fixes] == [
        (True, False),
        (False, True),
    ]


CROSS = [[0.1, 0, 0], [-0.1, 0, 0], [0, 0.1, 0], [0, -0.1, 0]]


def plane_wave(forward, starboard):
    """Time differences that a wave with these direction cosines makes, against the first element.

    An element so far ahead towards the beacon hears so much earlier.
    """
    at = np.array(CROSS)[:, :2] - CROSS[0][:2]
    later = -at @ [forward, starboard] / 1500.0
    return tuple(TimeDifference(element=str(k + 1), than="1", delay_s=later[k]) for k in (1, 2, 3))


def test_angles_by_time_differences_with_the_range_of_another_sentence():
    ingest = usbl(direction="differences", elements_m=CROSS)
    ingest.take(sighting())
    nothing_told = {"bearing_deg": None, "elevation_deg": None, "slant_range_m": None}
    ingest.take(sighting(**nothing_told, differences=plane_wave(0.3, -0.4)))
    ranged, seen = ingest.flush()
    assert (ranged.bearing, ranged.elevation, ranged.slant_range) == (None, None, 87.0)
    assert seen.bearing == pytest.approx(math.atan2(-0.4, 0.3))
    assert seen.elevation == pytest.approx(-math.acos(0.5))
    assert seen.slant_range is None


def test_differences_that_contradict_are_no_fix_but_their_rate_is_used():
    ingest = usbl(direction="differences", elements_m=CROSS)
    ingest.take(sighting(differences=plane_wave(0.8, 0.7), range_rate_m_s=1.5))
    (rate,) = ingest.flush()
    assert rate.rates == (1.5,)
    assert dict(ingest.counts.ignored) == {"no_direction": 1}


def test_a_range_out_of_its_limits_is_no_fix():
    ingest = usbl(range_limits_m=[90.0, 500.0])
    ingest.take(sighting())
    assert ingest.flush() == []
    assert dict(ingest.counts.ignored) == {"range": 1}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"valid": False, "error_code": "32"}, "32"),
        ({"valid": False}, "invalid"),
        (HERE, "place"),
        ({"bearing_deg": None, "slant_range_m": None}, "no_sighting"),
    ],
)
def test_a_record_that_is_no_fix_says_why(changes, reason):
    ingest = usbl()
    ingest.take(sighting(**changes))
    assert ingest.flush() == []
    assert dict(ingest.counts.ignored) == {reason: 1}


@pytest.mark.parametrize("axes", ["array", "level", "north"])
def test_a_fix_keeps_the_axes_in_which_it_is_told(axes):
    ingest = usbl()
    ingest.take(sighting(axes=axes))
    (fix,) = ingest.flush()
    assert (fix.axes, fix.bearing) == (axes, pytest.approx(np.pi / 2.0))


def test_a_place_told_by_our_own_solution_is_a_fix():
    ingest = usbl(navigates_by="gateway")
    ingest.take(sighting(**HERE))
    (fix,) = ingest.flush()
    assert (fix.beacon, fix.lat, fix.lon) == ("1", pytest.approx(0.5), pytest.approx(-1.2))


def test_what_is_said_again_in_other_words_is_one_fix():
    """A topside that tells each fix by the bow, by north and on the Earth, every second."""
    ingest = usbl(navigates_by="gateway")
    for second in range(3):
        for k, words in enumerate(({"axes": "level"}, {"axes": "north"}, HERE)):
            for beacon in ("1", "2"):
                told = sighting(**words, beacon=beacon)
                t_rx_ns = T0 + second * 1_000_000_000 + k * 80_000_000
                ingest.take(msgspec.structs.replace(told, t_rx_ns=t_rx_ns))
    assert [f.axes for f in ingest.flush()] == ["level"] * 6
    assert dict(ingest.counts.ignored) == {"repeated": 12}


def test_a_topside_may_change_its_words():
    ingest = usbl()
    for second, axes in enumerate(("level", "level", "north", "north")):
        told = sighting(axes=axes)
        ingest.take(msgspec.structs.replace(told, t_rx_ns=T0 + second * 1_000_000_000))
    assert [f.axes for f in ingest.flush()] == ["level", "level", "north", "north"]


def test_a_rate_alone_is_a_measurement():
    ingest = usbl()
    ingest.take(sighting(bearing_deg=None, slant_range_m=None, range_rate_m_s=-1.5))
    assert [type(m).__name__ for m in ingest.flush()] == ["RadialRate"]
    assert not ingest.counts.ignored


def test_an_imu_record_is_no_fix():
    ingest = usbl()
    ingest.take(sample(0))
    assert dict(ingest.counts.ignored) == {"not_usbl": 1}


def test_one_intake_for_each_device_of_a_configuration():
    config = configuration(make(demo_data()))
    assert isinstance(config, Config)
    ways = intakes(config)
    assert set(ways) == {"imu0", "usbl0"}
    ways["usbl0"].feed(b"no sentence at all\r\n", T0)
    ways["usbl0"].close()
    counts = ways["usbl0"].counts
    assert counts.bytes == counts.rejected_bytes == 20
    codec = registry.lookup("tracklink-lxt")
    options = build(codec.options, {}, [], "options")
    ways = intakes(config)
    ways["usbl0"].feed(codec.encode(sighting(xyz_m=None), options), T0)
    (fix,) = ways["usbl0"].flush()
    assert isinstance(fix, UsblFix)
    assert fix.bearing == pytest.approx(np.pi / 2.0, abs=1e-3)
