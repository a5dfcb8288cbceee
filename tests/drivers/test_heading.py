"""Headings and attitude against printed and logged sentences."""

import pynmeagps
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace

from drivers.heading.nmea import NMEA_HEADING, HeadingOptions
from drivers.nmea0183 import sentence
from drivers.records import HeadingRecord, NmeaSentence, Record, Rejected

# Logged from a fluxgate compass (gpsd's NMEA page prints it) and from a Teledyne log.
HDG = b"$HCHDG,101.1,,,7.1,W*3C\r\n"
PRDID = b"$PRDID,-4.44,2.12,154.25*56\r\n"
# Printed by makers of inertial systems as the example of this sentence.
PASHR = b"$PASHR,085335.000,224.19,T,-01.26,+00.83,+00.00,0.101,0.113,0.267,1,0*06\r\n"


def read(line: bytes, **options) -> Record | Rejected:
    (record,) = NMEA_HEADING.decoder(HeadingOptions(**options)).feed(line, 7)
    return record


def test_printed_attitude():
    assert read(PASHR) == HeadingRecord(
        t_rx_ns=7,
        line_bytes=len(PASHR),
        heading_deg=224.19,
        roll_deg=-1.26,
        pitch_deg=0.83,
        t_device_s=8 * 3600 + 53 * 60 + 35,
        sd_deg=0.267,
    )


@pytest.mark.parametrize(
    ("line", "options", "heading_deg", "reference"),
    [
        (HDG, {}, 94.0, "true"),
        (HDG, {"variation_deg": 3.0}, 94.0, "true"),
        (sentence("HCHDG", ["2.0", "5.5", "W", "", ""]), {}, 356.5, "magnetic"),
        (sentence("HCHDG", ["2.0", "5.5", "E", "1.0", "E"]), {}, 8.5, "true"),
        (sentence("HCHDG", ["2.0", "", "", "", ""]), {"variation_deg": -3.0}, 359.0, "true"),
        (sentence("HCHDM", ["350.0", "M"]), {}, 350.0, "magnetic"),
        (sentence("HCHDM", ["350.0", "M"]), {"variation_deg": 12.0}, 2.0, "true"),
        (PRDID, {}, 154.25, "true"),
        (PRDID, {"variation_deg": 1.0}, 154.25, "true"),
        (PRDID, {"prdid_magnetic": True}, 154.25, "magnetic"),
        (PRDID, {"prdid_magnetic": True, "variation_deg": 1.0}, 155.25, "true"),
        (sentence("HEHDT", ["0.0", "T"]), {"variation_deg": 1.0}, 0.0, "true"),
    ],
)
def test_which_north(line, options, heading_deg, reference):
    record = read(line, **options)
    assert (record.heading_deg, record.reference) == (heading_deg, reference)
    assert record.valid


def test_rdi_pitches_before_it_rolls():
    record = read(PRDID)
    assert (record.pitch_deg, record.roll_deg) == (-4.44, 2.12)


@pytest.mark.parametrize("mode", "AEMSV")
def test_only_a_measured_heading_is_valid(mode):
    assert read(sentence("GPTHS", ["77.52", mode])).valid is (mode == "A")


@pytest.mark.parametrize(
    "line",
    [
        sentence("GPTHS", ["", "V"]),
        sentence("HEHDT", ["", "T"]),
        sentence("HCHDG", ["", "", "", "", ""]),
        sentence("PASHR", ["", "", "T", "", "", "", "", "", "", "0", "0"]),
    ],
)
def test_a_compass_that_has_none_yet(line):
    record = read(line)
    assert isinstance(record, HeadingRecord)
    assert (record.valid, record.heading_deg) == (False, None)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (sentence("HEHDT", ["361", "T"]), "range"),
        (sentence("HEHDT", ["1", "M"]), "syntax"),
        (sentence("HEHDT", ["1"]), "syntax"),
        (sentence("PASHR", []), "syntax"),
        (sentence("GPTHS", ["1", "X"]), "syntax"),
        (sentence("HCHDG", ["1", "2", "", "", ""]), "syntax"),
        (sentence("PRDID", ["1", "2", "x"]), "syntax"),
        (sentence("PRDID", ["95", "2", "1"]), "range"),
        (PRDID.replace(b"2.12", b"2.13"), "checksum"),
    ],
)
def test_what_is_no_heading_is_rejected(line, reason):
    record = read(line)
    assert isinstance(record, Rejected)
    assert (record.reason, record.data) == (reason, line)


@pytest.mark.parametrize("line", [sentence("PASHR", ["POS", "1"]), sentence("HEROT", ["1", "A"])])
def test_other_sentences_come_out_as_they_are(line):
    assert isinstance(read(line), NmeaSentence)


@given(heading=st.integers(0, 359_999).map(lambda mdeg: mdeg / 1000))
def test_another_reader_reads_what_is_written(heading):
    record = HeadingRecord(t_rx_ns=0, heading_deg=heading)
    said = pynmeagps.NMEAReader.parse(NMEA_HEADING.encode(record, HeadingOptions()))
    assert (said.identity, said.headingT, said.headingTu) == ("HEHDT", heading, "T")


@pytest.mark.parametrize(
    ("changes", "options"),
    [
        ({}, {}),
        ({"valid": False, "heading_deg": None}, {}),
        ({"reference": "magnetic"}, {}),
        ({"roll_deg": 1.25, "pitch_deg": -2.5}, {}),
        ({"roll_deg": 1.25, "pitch_deg": -2.5, "reference": "magnetic"}, {"prdid_magnetic": True}),
        ({"roll_deg": 1.25, "pitch_deg": -2.5}, {"prdid_magnetic": True}),
        ({"roll_deg": 1.25, "pitch_deg": -2.5, "valid": False}, {}),
        ({"t_device_s": 43_200.25, "sd_deg": 0.125}, {}),
        ({"heading_deg": 12.0}, {"checksum": "forbidden"}),
    ],
)
def test_what_is_written_is_read(changes, options):
    record = replace(HeadingRecord(t_rx_ns=7, heading_deg=90.5), **changes)
    line = NMEA_HEADING.encode(record, HeadingOptions(**options))
    assert read(line, **options) == replace(record, line_bytes=len(line))


def test_what_cannot_be_written():
    with pytest.raises(ValueError, match="cannot say a NmeaSentence"):
        NMEA_HEADING.encode(
            NmeaSentence(t_rx_ns=0, talker="HE", formatter="ROT", fields=()), HeadingOptions()
        )
    tilted = HeadingRecord(t_rx_ns=0, heading_deg=1.0, roll_deg=2.0, reference="magnetic")
    with pytest.raises(ValueError, match="prdid_magnetic"):
        NMEA_HEADING.encode(tilted, HeadingOptions())
    assert tilted.sd_deg is UNSET
