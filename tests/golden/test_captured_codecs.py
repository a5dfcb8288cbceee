"""Every datagram of the real-data capture decodes: nothing in it is rejected."""

import gzip
from collections import Counter

import dpkt

from drivers import registry
from drivers.records import ImuRecord, UsblRecord
from tests.shared_data import shared


def test_snapir02_datagrams() -> None:
    codecs = {7001: "kvh1750", 7002: "tracklink-lxt"}
    readers = {}
    for port, name in codecs.items():
        codec = registry.lookup(name)
        readers[port] = codec.decoder(codec.options())
    kinds: Counter[type] = Counter()
    sequence = None
    with gzip.open(shared("captures", "snapir02", "capture.pcap.gz")) as file:
        for _, raw in dpkt.pcap.Reader(file):
            datagram = dpkt.ethernet.Ethernet(raw).data.data
            for record in readers[datagram.dport].feed(datagram.data, 0):
                kinds[type(record)] += 1
                assert getattr(record, "valid", False)
                if isinstance(record, ImuRecord):
                    assert sequence is None or record.sequence == (sequence + 1) % 128
                    sequence = record.sequence
    assert set(kinds) == {ImuRecord, UsblRecord}
    assert kinds[ImuRecord] > 35_000
    assert kinds[UsblRecord] > 100
