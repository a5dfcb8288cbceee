"""A receiver's records to fixes: units, epochs, and what is counted instead."""

import math

import pytest

from drivers.records import GnssRecord, NmeaSentence, Rejected, TimeRecord
from gateway.config import GnssDevice
from gateway.ingest.gnss import GnssIngest
from gateway.messages import PositionFix, VelocityFix
from gateway.schema import build

T0 = 5_000_000_000
UDP = {"type": "udp", "port": 7003}
SERIAL = {"type": "serial", "port": "/dev/ttyUSB2", "baud": 4800}


def receiver(**changes) -> GnssIngest:
    noise = {"position_m": [1.5, 2.5, 4.0], "velocity_m_s": 0.1}
    data = {"kind": "gnss", "codec": "nmea-gnss", "link": UDP, "noise": noise} | changes
    faults: list[str] = []
    device = build(GnssDevice, data, faults)
    assert device is not None, faults
    return GnssIngest("gnss0", device)


def gga(t_rx_ns: int = T0, t_device_s: float | None = 10.0, **changes) -> GnssRecord:
    fields = {"lat_deg": 60.0, "lon_deg": -30.0, "height_m": 41.5, "quality": 1}
    fields |= {"sentence": "GGA", "valid": True} | changes
    return GnssRecord(t_rx_ns=t_rx_ns, t_device_s=t_device_s, **fields)


def rmc(t_rx_ns: int = T0, t_device_s: float | None = 10.0, **changes) -> GnssRecord:
    fields = {"lat_deg": 60.0, "lon_deg": -30.0, "speed_m_s": 2.0, "course_deg": 120.0}
    fields |= {"sentence": "RMC", "valid": True} | changes
    return GnssRecord(t_rx_ns=t_rx_ns, t_device_s=t_device_s, **fields)


def test_gga_is_the_position_and_rmc_the_velocity():
    ingest = receiver(clock={"latency_ms": 250})
    ingest.take(gga())
    ingest.take(rmc())
    place, velocity = ingest.flush()
    t_ns = T0 - 250_000_000
    sd = (1.5, 2.5, 4.0)
    assert place == PositionFix(t_ns, "gnss0", math.pi / 3, pytest.approx(-math.pi / 6), 41.5, sd)
    assert velocity == VelocityFix(
        t_ns, "gnss0", pytest.approx(-1.0), pytest.approx(math.sqrt(3.0)), None, (0.1, 0.1, 0.1)
    )
    assert ingest.flush() == []
    assert ingest.counts.measurements == 2


def test_an_age_that_the_receiver_tells_comes_off_as_well():
    ingest = receiver(clock={"latency_ms": 100})
    ingest.take(gga(age_s=0.25))
    (place,) = ingest.flush()
    assert place.t_ns == T0 - 350_000_000


def test_a_receiver_may_say_that_it_is_worse_but_not_that_it_is_better():
    ingest = receiver()
    ingest.take(gga(sentence=None, sd_m=(9.0, 0.1, 4.5)))
    (place,) = ingest.flush()
    assert place.sd == (9.0, 2.5, 4.5)


def test_a_height_that_is_not_known_stays_unknown():
    ingest = receiver()
    ingest.take(gga(height_m=None))
    (place,) = ingest.flush()
    assert place.h is None


def test_sentences_of_an_epoch_are_of_one_moment():
    """At 4800 baud the second sentence comes 160 ms later; the next epoch is another one."""
    ingest = receiver(link=SERIAL)
    ingest.take(gga(T0, line_bytes=48))
    ingest.take(rmc(T0 + 160_000_000))
    ingest.take(gga(T0 + 1_000_000_000, 11.0))
    assert [fix.t_ns - T0 for fix in ingest.flush()] == [-100_000_000, -100_000_000, 1_000_000_000]


def test_vtg_is_of_the_epoch_that_it_follows():
    """Back to back on the line, or a whole burst later on its own."""
    ingest = receiver()
    ingest.take(gga(T0))
    ingest.take(rmc(T0 + 40_000_000, None, sentence="VTG"))
    ingest.take(rmc(T0 + 500_000_000, None, sentence="VTG"))
    assert [fix.t_ns - T0 for fix in ingest.flush()] == [0, 0, 500_000_000]


def test_of_two_sentences_that_say_the_same_the_first_is_used():
    ingest = receiver()
    for second in (10.0, 11.0):
        t_ns = T0 + round((second - 10.0) * 1e9)
        ingest.take(gga(t_ns, second, sentence="GNS"))
        ingest.take(gga(t_ns, second))
        ingest.take(rmc(t_ns, None, sentence="VTG"))
        ingest.take(rmc(t_ns, second))
    assert [type(fix) for fix in ingest.flush()] == [PositionFix, VelocityFix] * 2
    assert dict(ingest.counts.ignored) == {"repeated": 4}


def test_without_a_clock_or_a_day_later_every_sentence_is_of_its_own_moment():
    ingest = receiver()
    for t_ns, second in (
        (T0, None),
        (T0 + 10**9, None),
        (T0 + 2 * 10**9, 1.0),
        (T0 + 86_400 * 10**9, 1.0),
    ):
        ingest.take(gga(t_ns, second))
    assert [fix.t_ns - T0 for fix in ingest.flush()] == [0, 10**9, 2 * 10**9, 86_400 * 10**9]


@pytest.mark.parametrize(
    ("record", "reason"),
    [
        (gga(valid=False), "invalid"),
        (rmc(valid=False), "invalid"),
        (gga(lat_deg=None), "no_position"),
        (rmc(course_deg=None), "no_course"),
        (rmc(speed_m_s=None), "no_course"),
        (TimeRecord(t_rx_ns=T0, unix_s=1e9), "time"),
        (NmeaSentence(t_rx_ns=T0, talker="GP", formatter="GSV", fields=()), "not_gnss"),
    ],
)
def test_what_is_no_fix_says_why(record, reason):
    ingest = receiver()
    ingest.take(record)
    assert ingest.flush() == []
    assert dict(ingest.counts.ignored) == {reason: 1}


def test_rejected_bytes_are_counted():
    ingest = receiver()
    ingest.take(Rejected(t_rx_ns=T0, reason="checksum", data=b"$GP"))
    assert (ingest.counts.rejected["checksum"], ingest.counts.rejected_bytes) == (1, 3)
