"""Sentences of receivers against printed ones, a real log, and pynmeagps beside them."""

from datetime import UTC, datetime

import pynmeagps
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.gnss.nmea import KNOT_M_S, NMEA_GNSS, GnssOptions
from drivers.nmea0183 import sentence
from drivers.records import GnssRecord, NmeaSentence, Rejected, TimeRecord

# Printed in the receiver description of u-blox 8 / M8 (UBX-13003221).
UBLOX_GGA = b"$GPGGA,092725.00,4717.11399,N,00833.91590,E,1,08,1.01,499.6,M,48.0,M,,*5B\r\n"
UBLOX_RMC = b"$GPRMC,083559.00,A,4717.11437,N,00833.91522,E,0.004,77.52,091202,,,A*57\r\n"
# Printed on bytefusion.com, "About GPRMC": of version 2.0, without a mode.
OLD_RMC = b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n"
UBLOX_GNS = b"$GNGNS,103600.01,5114.51176,N,00012.29380,W,ANNN,07,1.18,111.5,45.6,,,V*00\r\n"
UBLOX_VTG = b"$GPVTG,77.52,T,,M,0.004,N,0.008,K,A*06\r\n"
UBLOX_ZDA = b"$GPZDA,082710.00,16,09,2002,00,00*64\r\n"
# A u-blox NEO-6M after power-on, logged on chris.cnie.de/avr/neo-6.html.
COLD_GGA = b"$GPGGA,,,,,,0,00,99.99,,,,,,*48\r\n"
COLD_RMC = b"$GPRMC,,V,,,,,,,,,,N*53\r\n"


def read(data: bytes, **options) -> GnssRecord | NmeaSentence | Rejected:
    """The one record of one sentence."""
    (record,) = NMEA_GNSS.decoder(GnssOptions(**options)).feed(data, 7)
    return record


def gga(**changes: str) -> bytes:
    """A sentence with some of its fields changed."""
    fields = {"time": "101530.25", "lat": "3322.5", "ns": "S", "lon": "15115.0", "ew": "E"}
    fields |= {"quality": "4", "satellites": "12", "hdop": "0.7", "altitude": "-3.5", "unit": "M"}
    fields |= {"geoid": "22.25", "geoid_unit": "M", "age": "1.0", "station": "0907"}
    return sentence("GNGGA", list((fields | changes).values()))


def gns(**changes: str) -> bytes:
    fields = {"time": "101530.25", "lat": "3322.5", "ns": "S", "lon": "15115.0", "ew": "E"}
    fields |= {"modes": "AA", "satellites": "12", "hdop": "0.7", "altitude": "-3.5"}
    fields |= {"geoid": "22.25", "age": "", "station": ""}
    return sentence("GNGNS", list((fields | changes).values()))


def rmc(**changes: str) -> bytes:
    fields = {"time": "101530.25", "status": "A", "lat": "3322.5", "ns": "S", "lon": "15115.0"}
    fields |= {"ew": "E", "knots": "5.5", "course": "359.9", "date": "010203", "variation": ""}
    fields |= {"sense": "", "mode": "D", "safety": "V"}
    return sentence("GNRMC", list((fields | changes).values()))


def test_printed_gga():
    assert read(UBLOX_GGA) == GnssRecord(
        t_rx_ns=7,
        line_bytes=len(UBLOX_GGA),
        sentence="GGA",
        valid=True,
        t_device_s=9 * 3600 + 27 * 60 + 25.0,
        lat_deg=pytest.approx(47.2852331667, abs=1e-10),
        lon_deg=pytest.approx(8.5652650000, abs=1e-10),
        height_m=547.6,
        geoid_m=48.0,
        quality=1,
        satellites=8,
        hdop=1.01,
    )


def test_printed_rmc():
    old, new = read(OLD_RMC), read(UBLOX_RMC)
    assert (old.valid, old.mode, old.course_deg) == (True, None, 84.4)
    assert old.speed_m_s == pytest.approx(22.4 * 0.514444, abs=1e-4)
    assert (old.lat_deg, old.lon_deg) == pytest.approx((48.1173, 11.516667), abs=1e-6)
    assert (new.valid, new.mode, new.course_deg, new.t_device_s) == (True, "A", 77.52, 30959.0)
    assert new.height_m is None


def test_printed_gns():
    fix = read(UBLOX_GNS)
    assert (fix.sentence, fix.valid, fix.mode, fix.satellites) == ("GNS", True, "ANNN", 7)
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx((51.241862667, -0.204896667), abs=1e-9)
    assert (fix.height_m, fix.geoid_m, fix.t_device_s) == (157.1, 45.6, 38160.01)


def test_printed_vtg():
    moving = read(UBLOX_VTG)
    assert (moving.sentence, moving.valid, moving.course_deg) == ("VTG", True, 77.52)
    assert moving.speed_m_s == pytest.approx(0.008 / 3.6, abs=2e-4)
    assert (moving.lat_deg, moving.t_device_s) == (None, None)


def test_printed_zda():
    when = datetime(2002, 9, 16, 8, 27, 10, tzinfo=UTC)
    assert read(UBLOX_ZDA) == TimeRecord(
        t_rx_ns=7, line_bytes=len(UBLOX_ZDA), unix_s=when.timestamp()
    )
    cold = read(sentence("GPZDA", [""] * 6))
    assert (cold.valid, cold.unix_s) == (False, None)


@pytest.mark.parametrize(
    ("modes", "valid"), [("AN", True), ("NN", False), ("ES", False), ("F", True)]
)
def test_modes_of_satellite_systems(modes, valid):
    line = gns(modes=modes)
    assert read(line).valid is valid


@pytest.mark.parametrize(("mode", "valid"), [("A", True), ("N", False), ("E", False), (None, True)])
def test_modes_of_vtg(mode, valid):
    fields = ["10.0", "T", "", "M", "5.0", "N", "", "K"]
    line = sentence("GPVTG", fields if mode is None else [*fields, mode])
    assert read(line).valid is valid
    assert read(line).speed_m_s == pytest.approx(5.0 * 1852 / 3600)


def test_a_receiver_that_wakes_up_has_no_place_and_is_not_valid():
    for cold in (read(COLD_GGA), read(COLD_RMC)):
        assert not cold.valid
        assert (cold.lat_deg, cold.lon_deg, cold.t_device_s) == (None, None, None)


@pytest.mark.parametrize("quality", range(9))
def test_qualities(quality):
    assert read(gga(quality=str(quality))).valid is (1 <= quality <= 5)


@pytest.mark.parametrize(
    ("status", "mode", "valid"),
    [("A", m, m in "ADFRP") for m in "ADEFMNPRS"] + [("V", "A", False), ("A", "", True)],
)
def test_status_and_mode(status, mode, valid):
    assert read(rmc(status=status, mode=mode)).valid is valid


@pytest.mark.parametrize(
    ("geoid", "options", "height_m"),
    [
        ("22.25", {}, 18.75),
        ("", {}, None),
        ("", {"geoid_m": -30.0}, -33.5),
        ("22.25", {"geoid_m": -30.0}, 18.75),
    ],
)
def test_a_height_needs_the_geoid(geoid, options, height_m):
    assert read(gga(geoid=geoid), **options).height_m == height_m


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (gga(lat="", lon=""), "syntax"),
        (gga(ns="E"), "syntax"),
        (gga(unit="F"), "syntax"),
        (gga(quality=""), "syntax"),
        (gga(quality="12"), "syntax"),
        (gga(quality="A"), "syntax"),
        (gga(time="246060"), "range"),
        (gga(hdop="1e3"), "syntax"),
        (gga(lat="9100.0"), "range"),
        (rmc(status="X"), "syntax"),
        (rmc(mode="AD"), "syntax"),
        (rmc(course="361"), "range"),
        (rmc(knots="-1"), "range"),
        (sentence("GPGGA", ["1"]), "syntax"),
        (sentence("GPRMC", ["1"]), "syntax"),
        (gns(modes=""), "syntax"),
        (gns(modes="AX"), "syntax"),
        (gns(lat="", lon=""), "syntax"),
        (sentence("GPVTG", ["1.0", "T"]), "syntax"),
        (sentence("GPVTG", ["1", "M", "", "M", "1", "N", "", "K"]), "syntax"),
        (sentence("GPVTG", ["1", "T", "", "M", "1", "N", "", "K", "AD"]), "syntax"),
        (sentence("GPZDA", ["082710", "31", "02", "2002", "", ""]), "range"),
        (sentence("GPZDA", ["082710", "x", "02", "2002", "", ""]), "syntax"),
        (UBLOX_RMC.replace(b"77.52", b"77.53"), "checksum"),
        (UBLOX_RMC[:-5] + b"\r\n", "syntax"),
    ],
)
def test_what_is_no_sentence_is_rejected(line, reason):
    record = read(line)
    assert isinstance(record, Rejected)
    assert (record.reason, record.data) == (reason, line)


def test_without_checksums():
    bare = UBLOX_RMC[:-5] + b"\r\n"
    record = read(bare, checksum="optional")
    assert record.course_deg == 77.52
    assert b"*" not in NMEA_GNSS.encode(record, GnssOptions(checksum="forbidden"))


@pytest.mark.parametrize(
    "line", [sentence("GPGSV", ["1.0", "T"]), sentence("PGGA", ["1"]), sentence("HEHDT", ["1"])]
)
def test_other_sentences_come_out_as_they_are(line):
    assert isinstance(read(line), NmeaSentence)


@given(
    lat=st.floats(-90, 90),
    lon=st.floats(-180, 180),
    height=st.floats(-500, 9000),
    geoid=st.floats(-107, 86),
    t_s=st.integers(0, 8_639_999).map(lambda cs: cs / 100),
)
def test_another_reader_reads_the_position_that_is_written(lat, lon, height, geoid, t_s):
    record = GnssRecord(
        t_rx_ns=0,
        sentence="GGA",
        valid=True,
        t_device_s=t_s,
        lat_deg=lat,
        lon_deg=lon,
        height_m=height,
        geoid_m=geoid,
        quality=2,
        satellites=9,
        hdop=0.9,
    )
    said = pynmeagps.NMEAReader.parse(NMEA_GNSS.encode(record, GnssOptions()))
    assert said.identity == "GPGGA"
    assert (said.lat, said.lon) == pytest.approx((lat, lon), abs=2e-8)
    assert said.alt + said.sep == pytest.approx(height, abs=0.011)
    assert (said.quality, said.numSV, said.HDOP) == (2, 9, 0.9)
    clock = said.time
    of_day = clock.hour * 3600 + clock.minute * 60 + clock.second + clock.microsecond * 1e-6
    assert of_day == pytest.approx(t_s, abs=1e-3)


@given(speed=st.floats(0, 50), course=st.floats(0, 360))
def test_another_reader_reads_the_velocity_that_is_written(speed, course):
    record = GnssRecord(
        t_rx_ns=0,
        sentence="RMC",
        valid=True,
        lat_deg=-33.375,
        lon_deg=151.25,
        speed_m_s=speed,
        course_deg=course,
        mode="A",
    )
    said = pynmeagps.NMEAReader.parse(NMEA_GNSS.encode(record, GnssOptions()))
    assert said.identity == "GPRMC"
    assert said.spd * KNOT_M_S == pytest.approx(speed, abs=3e-4)
    assert said.cog == pytest.approx(course, abs=0.006)
    assert (said.status, said.posMode) == ("A", "A")


@given(cs=st.integers(0, 4_000_000_000_00))
def test_another_reader_reads_the_time_that_is_written(cs):
    line = NMEA_GNSS.encode(TimeRecord(t_rx_ns=0, unix_s=cs / 100), GnssOptions())
    said = pynmeagps.NMEAReader.parse(line)
    when = datetime(said.year, said.month, said.day, tzinfo=UTC).timestamp()
    of_day = said.time.hour * 3600 + said.time.minute * 60 + said.time.second
    assert when + of_day + said.time.microsecond * 1e-6 == pytest.approx(cs / 100, abs=1e-4)
    assert read(line).unix_s == pytest.approx(cs / 100, abs=1e-5)


def test_what_cannot_be_written():
    with pytest.raises(ValueError, match="cannot say a NmeaSentence"):
        NMEA_GNSS.encode(
            NmeaSentence(t_rx_ns=0, talker="GP", formatter="GSV", fields=()), GnssOptions()
        )
    with pytest.raises(ValueError, match="needs a quality"):
        NMEA_GNSS.encode(GnssRecord(t_rx_ns=0, sentence="GGA", valid=True), GnssOptions())
    with pytest.raises(ValueError, match="needs a mode"):
        NMEA_GNSS.encode(GnssRecord(t_rx_ns=0, sentence="GNS", valid=True), GnssOptions())
    with pytest.raises(ValueError, match="names no sentence"):
        NMEA_GNSS.encode(GnssRecord(t_rx_ns=0, valid=True), GnssOptions())
