"""Depth sentences and Digiquartz answers against printed ones; pressure against UNESCO 1983."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET

from drivers.depth.nmea import NMEA_DEPTH, DepthOptions
from drivers.depth.paroscientific import PAROSCIENTIFIC, ParoscientificOptions
from drivers.depth.pressure import WaterColumn
from drivers.nmea0183 import sentence
from drivers.records import DepthRecord, NmeaSentence, OtherFrame, Record, Rejected

DBT = b"$SDDBT,7.8,f,2.4,M,1.3,F*0D\r\n"
# On deck, as the survey guide of a sensor's owner prints it.
ON_DECK = b"*000114.6959494\r\n"


def read(line: bytes, **options) -> Record | Rejected:
    (record,) = NMEA_DEPTH.decoder(DepthOptions(**options)).feed(line, 7)
    return record


def answer(line: bytes, **options) -> Record | Rejected:
    (record,) = PAROSCIENTIFIC.decoder(ParoscientificOptions(**options)).feed(line, 7)
    return record


@pytest.mark.parametrize(
    ("line", "metres"),
    [
        (DBT, 2.4),
        (sentence("SDDBT", ["10.0", "f", "", "M", "", "F"]), pytest.approx(3.048)),
        (b"$SDDPT,14.39,0.00*68\r\n", 14.39),
        (b"$INDPT,2.3,0.0*46\r\n", 2.3),
        (sentence("SDDPT", ["25.1", "-1.5", "100"]), 25.1),
    ],
)
def test_the_options_say_what_is_measured(line, metres):
    above = read(line)
    assert (above.altitude_m, above.depth_m, above.valid) == (metres, None, True)
    below = read(line, measures="depth")
    assert (below.altitude_m, below.depth_m, below.valid) == (UNSET, metres, True)


@pytest.mark.parametrize(
    "line", [sentence("SDDPT", ["", ""]), sentence("SDDBT", ["", "f", "", "M", "", "F"])]
)
def test_a_sounder_without_an_echo(line):
    assert not read(line).valid


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (sentence("SDDPT", ["1"]), "syntax"),
        (sentence("SDDPT", ["-1", ""]), "range"),
        (sentence("SDDBT", ["7.8", "f", "2.4", "F", "1.3", "F"]), "syntax"),
        (DBT.replace(b"2.4", b"2.5"), "checksum"),
    ],
)
def test_what_is_no_depth_is_rejected(line, reason):
    record = read(line)
    assert isinstance(record, Rejected)
    assert record.reason == reason


def test_a_depth_is_written_as_the_options_say():
    record = DepthRecord(t_rx_ns=0, depth_m=12.5, altitude_m=3.0)
    assert NMEA_DEPTH.encode(record, DepthOptions()) == sentence("SDDPT", ["3.000", "0.0"])
    said = NMEA_DEPTH.encode(record, DepthOptions(measures="depth"))
    assert said == sentence("SDDPT", ["12.500", "0.0"])
    lost = DepthRecord(t_rx_ns=0, valid=False)
    assert not read(NMEA_DEPTH.encode(lost, DepthOptions())).valid


def test_an_answer_on_deck_is_the_air():
    record = answer(ON_DECK)
    assert record.pressure_pa == pytest.approx(101_325, abs=1)
    assert record.depth_m == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("unit", "value"),
    [
        ("psi", "29.3919"),
        ("hpa", "2026.5"),
        ("bar", "2.0265"),
        ("kpa", "202.65"),
        ("mpa", "0.20265"),
        ("in_hg", "59.8425"),
        ("mm_hg", "1520.0"),
        ("m_h2o", "20.6645"),
    ],
)
def test_two_atmospheres_are_ten_metres(unit, value):
    record = answer(f"*0001{value}\r\n".encode(), unit=unit)
    assert record.pressure_pa == pytest.approx(202_650, rel=2e-5)
    assert record.depth_m == pytest.approx(10.08, abs=0.001)


def test_unesco_1983():
    """The check value that Fofonoff and Millard print, and the surface."""
    ocean = WaterColumn(atmosphere_hpa=0.0, latitude_deg=30.0)
    assert ocean.depth_m(1e8) == pytest.approx(9712.653, abs=5e-4)
    assert ocean.depth_m(0.0) == 0.0
    assert WaterColumn(latitude_deg=90.0).depth_m(101_325.0) == 0.0


@given(depth=st.floats(-5, 11_000), latitude=st.none() | st.floats(-90, 90))
def test_pressure_of_a_depth(depth, latitude):
    water = WaterColumn(latitude_deg=latitude)
    assert water.depth_m(water.pressure_pa(depth)) == pytest.approx(depth, abs=2e-6)


def test_a_depth_is_written_as_its_pressure():
    options = ParoscientificOptions(latitude_deg=-33.0)
    line = PAROSCIENTIFIC.encode(DepthRecord(t_rx_ns=0, depth_m=250.0), options)
    assert answer(line, latitude_deg=-33.0).depth_m == pytest.approx(250.0, abs=1e-3)
    with pytest.raises(ValueError, match="a pressure or a depth"):
        PAROSCIENTIFIC.encode(DepthRecord(t_rx_ns=0), options)
    with pytest.raises(ValueError, match="cannot say a NmeaSentence"):
        PAROSCIENTIFIC.encode(
            NmeaSentence(t_rx_ns=0, talker="SD", formatter="MTW", fields=()), options
        )


def test_other_answers_are_whole_frames():
    record = answer(b"*0001UN=1\r\n")
    assert isinstance(record, OtherFrame)
    assert (record.name, record.data) == ("UN", b"*0001UN=1\r\n")


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"*000190\r\n", "syntax"),
        (b"*010014.7\r\n", "syntax"),
        (b"*0001-1.0\r\n", "range"),
        (b"*000130000.0\r\n", "range"),
    ],
)
def test_what_is_no_pressure_is_rejected(line, reason):
    record = answer(line)
    assert isinstance(record, Rejected)
    assert record.reason == reason
