"""The headings of a real PHINS, in the shared vectors, decode to what they say."""

from drivers import registry
from drivers.records import HeadingRecord, NmeaSentence, Rejected
from tests.shared_data import shared


def test_phins_headings() -> None:
    lines = shared("vectors", "imu", "phins_nmea_standard.hex").read_text().split()
    codec = registry.lookup("nmea-heading")
    reader = codec.decoder(codec.options())
    records = [
        record
        for line in lines
        for record in reader.feed(bytes.fromhex(line).rstrip() + b"\r\n", 0)
    ]
    headings = [record for record in records if isinstance(record, HeadingRecord)]
    assert [record.heading_deg for record in headings] == [116.581, 41.87]
    assert all(record.valid and record.reference == "true" for record in headings)
    others = [record for record in records if isinstance(record, NmeaSentence)]
    assert len(headings) + len(others) == len(lines)
    assert not any(isinstance(record, Rejected) for record in records)
