"""The KVH frames of the shared vectors decode to the values stated beside them."""

import pytest

from drivers.imu.kvh import KVH1750, KvhOptions
from drivers.imu.sample import G0
from drivers.records import DeviceStatus, ImuRecord, Rejected
from tests.golden.vectors import frames, stated


def test_format_a() -> None:
    (frame,) = frames("kvh1775_format_a_manual")
    said = stated("kvh1775_format_a_manual")
    exact, expected = said["decoded_exact"], said["expected"]
    (record,) = KVH1750.decoder(KvhOptions()).feed(frame, 1)
    assert isinstance(record, ImuRecord)
    assert list(record.delta_angle_rad) == exact["gyro"]
    assert [value / G0 for value in record.specific_force_m_s2] == pytest.approx(
        exact["accel_g"], rel=1e-15
    )
    assert record.sequence == expected["sequence"]
    assert record.temperature_c == expected["temperature"]
    assert record.valid is (expected["status"] == "0x77")
    assert KVH1750.encode(record, KvhOptions()) == frame


def test_built_in_test() -> None:
    reader = KVH1750.decoder(KvhOptions())
    passed, failed = (reader.feed(frame, 1) for frame in frames("kvh1775_bit_manual"))
    said = stated("kvh1775_bit_manual")["expected"]
    assert said[0]["meaning"] == "all pass"
    assert said[1]["meaning"] == "SR MAG offset failed, GCB Y volts failed"
    assert [*passed] == [DeviceStatus(t_rx_ns=1, line_bytes=11, healthy=True)]
    names = ("SR MAG offset", "GCB Y volts")
    assert [*failed] == [DeviceStatus(t_rx_ns=1, line_bytes=13, healthy=False, failed=names)]


def test_frames_that_do_not_verify_are_rejected() -> None:
    """Two strings the manual prints with a wrong sum or a wrong header."""
    for text in ("fe8100aa777f7b7f7f7f1e", "fe8100aa7f7f7f7f7f7f7f7f23"):
        reader = KVH1750.decoder(KvhOptions())
        found = [*reader.feed(bytes.fromhex(text), 0), *reader.close()]
        assert all(isinstance(record, Rejected) for record in found)
        assert b"".join(record.data for record in found).hex() == text


def test_interleaved_in_one_stream() -> None:
    (data,) = frames("kvh1775_format_a_manual")
    short, long = frames("kvh1775_bit_manual")
    stream = data + short + b"\r\n=testfilt\r\n" + data + long + data
    records = list(KVH1750.decoder(KvhOptions()).feed(stream, 0))
    kinds = [type(record) for record in records]
    assert kinds == [ImuRecord, DeviceStatus, Rejected, ImuRecord, DeviceStatus, ImuRecord]
