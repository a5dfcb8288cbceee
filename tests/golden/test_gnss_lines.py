"""The GGA of a real ship, in the shared vectors, decodes to what it says."""

import pytest

from drivers import registry
from drivers.records import GnssRecord
from tests.shared_data import shared


def test_hipap_ship() -> None:
    raw = shared("vectors", "usbl", "psimssb_hipap.txt").read_bytes()
    codec = registry.lookup("nmea-gnss")
    reader = codec.decoder(codec.options())
    records = [*reader.feed(raw, 0), *reader.close()]
    [fix] = [record for record in records if isinstance(record, GnssRecord)]
    assert (fix.sentence, fix.valid, fix.quality, fix.satellites) == ("GGA", True, 2, 12)
    assert fix.lat_deg == pytest.approx(70 + 2.968962 / 60, abs=1e-12)
    assert fix.lon_deg == pytest.approx(29 + 38.350607 / 60, abs=1e-12)
    assert fix.height_m == 19.82
    assert fix.t_device_s == pytest.approx(7 * 3600 + 56 * 60 + 17.34)
