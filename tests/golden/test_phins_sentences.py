"""Sentences of PHINS units at the surface and at 732 m, as quoted by drivers that read them."""

import math

import pytest

from drivers.heading.phins import PHINS
from drivers.nmea0183 import NmeaOptions
from drivers.records import (
    DepthRecord,
    GnssRecord,
    HeadingRecord,
    NmeaSentence,
    Record,
    Rejected,
    UsblRecord,
)
from tests.golden.vectors import frames, stated

NAME = "phins_nmea_standard"


def read(stream: bytes) -> list[Record | Rejected]:
    reader = PHINS.decoder(NmeaOptions())
    return [*reader.feed(stream, 1), *reader.close()]


def test_every_sentence_is_read() -> None:
    sentences = stated(NAME)["expected"]
    records = read(b"".join(frames(NAME)))
    kinds = {"$HEHDT": HeadingRecord, "ATITUD": HeadingRecord, "POSITI": GnssRecord}
    kinds |= {"SPEED_": GnssRecord, "DEPIN_": DepthRecord}
    for record, sentence in zip(records, sentences, strict=True):
        address, name, *_ = sentence.split(",")
        wanted = kinds.get(name if address == "$PIXSE" else address, NmeaSentence)
        assert type(record) is wanted, sentence


def test_values() -> None:
    attitude, position = (
        [r for r in read(b"".join(frames(NAME))) if isinstance(r, kind)]
        for kind in (HeadingRecord, GnssRecord)
    )
    assert [r.heading_deg for r in attitude if r.valid] == [116.581, 41.87]
    assert [(r.roll_deg, r.pitch_deg) for r in attitude if not r.valid] == [
        (-1.641, 0.490),
        (-0.729, 15.705),
    ]
    assert (position[0].lat_deg, position[0].lon_deg) == (53.10245714, 8.83994382)
    assert not any(record.valid for record in position)
    (depth,) = (r for r in read(b"".join(frames(NAME))) if isinstance(r, DepthRecord))
    assert depth.depth_m == 732.811
    assert depth.t_device_s == pytest.approx(8 * 3600 + 58 * 60 + 32.643253)


def test_the_sign_of_pitch_is_what_the_vehicle_does() -> None:
    """It climbs 0.412 m/s at 1.455 m/s over ground without sideways drift: bow up by as much."""
    lines = [frame.decode() for frame in frames(NAME)]
    at = lines.index("$PIXSE,ATITUD,-0.729,-15.705*58\r\n")
    speed_line = next(line for line in lines[at:] if "SPEED_" in line)
    heading, attitude, speed = read("".join((lines[at - 1], lines[at], speed_line)).encode())
    assert abs(speed.course_deg - heading.heading_deg) < 0.2
    up = float(speed_line.split("*")[0].split(",")[4])
    assert math.degrees(math.atan2(up, speed.speed_m_s)) == pytest.approx(
        attitude.pitch_deg, abs=0.2
    )


def test_sentences_are_written_as_they_came() -> None:
    for frame in frames(NAME):
        (record,) = read(frame)
        told = PHINS.encode(record, NmeaOptions())
        if b"SPEED_" in frame or b"POSITI" in frame:  # altitude and climb are not kept
            assert told.split(b",")[:4] == frame.split(b",")[:4]
        elif frame != b"$HEHDT,41.87,T*25\r\n":  # two decimals where others have three
            assert told == frame


def test_the_stated_bad_sum_is_rejected() -> None:
    line = b"$PIXSE,LMNIN_,0.355,0.149,0.086,0.157,0.156,101702.016560,1*78\r\n"
    (record,) = read(line)
    assert (type(record), record.reason) == (Rejected, "checksum")


def test_records_no_sentence_can_say() -> None:
    for record in (UsblRecord(t_rx_ns=0, beacon="1"), HeadingRecord(t_rx_ns=0)):
        with pytest.raises(ValueError, match="no sentence of phins"):
            PHINS.encode(record, NmeaOptions())
