"""The real STIM300 datagram of the shared vectors decodes to the values stated beside it."""

import math

import pytest

from drivers.imu.sample import G0
from drivers.imu.stim300 import STIM300, Stim300Options
from drivers.records import ImuRecord, Rejected
from tests.golden.vectors import frames, stated

NAME = "stim300_af_geirhovland"


def test_rate_acceleration_inclination_temperature_aux() -> None:
    (frame,) = frames(NAME)
    said = stated(NAME)["expected"]
    (record,) = STIM300.decoder(Stim300Options(crlf=True)).feed(frame, 1)
    assert isinstance(record, ImuRecord)
    assert [math.degrees(rate) for rate in record.rate_rad_s] == pytest.approx(said["gyro_dps"])
    assert [a / G0 for a in record.specific_force_m_s2] == pytest.approx(said["accel_g"])
    assert record.temperature_c == pytest.approx(sum(said["gyro_temp_c"]) / 3)
    assert (record.sequence, record.valid) == (said["counter"], True)
    assert record.age_s == pytest.approx(said["latency_us"] * 1e-6)


def test_termination_not_said_is_all_that_is_rejected() -> None:
    (frame,) = frames(NAME)
    reader = STIM300.decoder(Stim300Options())
    found = [*reader.feed(3 * frame, 1), *reader.close()]
    assert [type(record) for record in found] == 3 * [ImuRecord, Rejected]
    assert [record.data for record in found[1::2]] == 3 * [b"\r\n"]
