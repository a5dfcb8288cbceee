"""Travel times and Doppler of the WHOI Micro-Modem, by the templates of public drivers."""

import pytest

from drivers.lbl.micromodem import MICROMODEM, MicromodemOptions
from drivers.nmea0183 import sentence
from drivers.records import LblRecord, LblReply, NmeaSentence, Record, Rejected


def read(line: bytes, **options) -> Record | Rejected:
    (record,) = MICROMODEM.decoder(MicromodemOptions(**options)).feed(line, 7)
    return record


def tta(*fields: str) -> bytes:
    return sentence("SNTTA", fields)


def test_who_did_not_answer_is_not_in_it():
    line = tta("0.3125", "", "0.2800", "", "101530.25")
    assert read(line) == LblRecord(
        t_rx_ns=7,
        line_bytes=len(line),
        replies=(LblReply(beacon="A", one_way_s=0.3125), LblReply(beacon="C", one_way_s=0.28)),
        t_ping_s=10 * 3600 + 15 * 60 + 30.25,
    )


def test_a_transponder_may_have_another_name():
    record = read(tta("", "1.5", "", "", "000000"), transponders=("N1", "N2", "N3", "N4"))
    assert record.replies == (LblReply(beacon="N2", one_way_s=1.5),)


def test_nobody_answered():
    assert read(tta("", "", "", "", "101530.25")).replies == ()
    assert read(sentence("CAMPR", ["3", "1", ""])).replies == ()


def test_a_modem_that_replied():
    record = read(sentence("CAMPR", ["3", "1", "0.5125"]))
    assert record.replies == (LblReply(beacon="3", one_way_s=0.5125),)
    assert record.t_ping_s is None


@pytest.mark.parametrize(("positive", "rate"), [("closing", -1.25), ("opening", 1.25)])
def test_doppler_is_a_rate_of_the_distance(positive, rate):
    line = sentence("CADOP", ["1.25"])
    record = read(line, doppler_beacon="3", doppler_positive=positive)
    assert record.replies == (LblReply(beacon="3", range_rate_m_s=rate),)
    assert isinstance(read(line), NmeaSentence)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (tta("0.1", "0.1", "0.1", "101530.25"), "syntax"),
        (tta("0.1", "0.1", "0.1", "x", "101530.25"), "syntax"),
        (tta("0.1", "0.1", "0.1", "", "250000"), "range"),
        (tta("-0.1", "", "", "", "101530.25"), "range"),
        (tta("0.1", "", "", "", ""), "syntax"),
        (sentence("CAMPR", ["A", "1", "0.5"]), "syntax"),
        (sentence("CAMPR", ["3", "1", "61"]), "range"),
        (sentence("CADOP", ["fast"]), "syntax"),
        (tta("0.1", "", "", "", "101530.25").replace(b"0.1", b"0.2"), "checksum"),
    ],
)
def test_what_is_rejected(line, reason):
    record = read(line)
    assert isinstance(record, Rejected)
    assert (record.reason, record.data) == (reason, line)


@pytest.mark.parametrize(
    ("record", "options"),
    [
        (LblRecord(t_rx_ns=7, replies=(), t_ping_s=0.25), {}),
        (
            LblRecord(
                t_rx_ns=7, replies=(LblReply(beacon="B", one_way_s=0.25),), t_ping_s=86399.99
            ),
            {"checksum": "forbidden"},
        ),
        (LblRecord(t_rx_ns=7, replies=(LblReply(beacon="12", one_way_s=0.25),)), {}),
        (
            LblRecord(t_rx_ns=7, replies=(LblReply(beacon="1", range_rate_m_s=-2.5),)),
            {"doppler_beacon": "1"},
        ),
    ],
)
def test_what_is_written_is_read(record, options):
    line = MICROMODEM.encode(record, MicromodemOptions(**options))
    again = read(line, **options)
    assert again.replies == record.replies
    assert again.t_ping_s == pytest.approx(record.t_ping_s)


def test_what_cannot_be_written():
    options = MicromodemOptions()
    with pytest.raises(ValueError, match="cannot say this LblRecord"):
        MICROMODEM.encode(LblRecord(t_rx_ns=0, replies=()), options)
    stranger = LblRecord(t_rx_ns=0, replies=(LblReply(beacon="Z", one_way_s=1.0),), t_ping_s=1.0)
    with pytest.raises(ValueError, match="one of the transponders"):
        MICROMODEM.encode(stranger, options)
