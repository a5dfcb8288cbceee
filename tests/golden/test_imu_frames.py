"""Frames of VectorNav, Xsens, MicroStrain and Advanced Navigation units decode as stated."""

import math

import pytest

from drivers.codec import Codec
from drivers.imu.anpp import ANPP
from drivers.imu.mip import MIP
from drivers.imu.sample import G0, Preference
from drivers.imu.vectornav import VECTORNAV
from drivers.imu.xsens import XSENS_MTDATA2
from drivers.records import ImuRecord, OtherFrame, Record, Rejected
from tests.golden.vectors import frames, stated


def read(codec: Codec, stream: bytes, options: object = None) -> list[Record | Rejected]:
    reader = codec.decoder(options or codec.options())
    return [*reader.feed(stream, 1), *reader.close()]


def test_vectornav_example_of_the_manual() -> None:
    """Yaw, pitch and roll only: framing and CRC hold, nothing inertial in it."""
    (frame,) = frames("vectornav_vn100_manual_ex1")
    (record,) = read(VECTORNAV, frame)
    assert isinstance(record, OtherFrame)
    assert record.data == frame


def test_anpp_packet_of_a_unit_test() -> None:
    (frame,) = frames("anpp_header_rock_unit_test")
    said = stated("anpp_header_rock_unit_test")["expected"]
    (record,) = read(ANPP, frame)
    assert (record.name, record.data) == (f"packet {said['id']}", frame)


def test_mip_rates() -> None:
    packets = stated("mip_sensor_data")["decoded"]
    stream = b"".join(frames("mip_sensor_data"))
    records = read(MIP, stream, Preference(prefer="rates"))
    names = [getattr(record, "name", "imu") for record in records]
    alone = "sensor data without inertial"
    assert names == ["imu", "imu", alone, "imu", alone, "set 82"]
    for record, packet in zip(records, packets, strict=True):
        if isinstance(record, ImuRecord):
            said = {name: value for field in packet["fields"] for name, value in field.items()}
            assert list(record.rate_rad_s) == said["scaled_gyro_rad_s"]
            assert [a / G0 for a in record.specific_force_m_s2] == pytest.approx(
                said["scaled_accel_g"], rel=1e-14
            )
            assert record.t_device_s == pytest.approx(said["reference_timestamp_ns"][0] * 1e-9)
            assert record.interval_s == pytest.approx(said["reference_time_delta_ns"][0] * 1e-9)
            assert record.valid


def test_mip_increments_where_there_are_some() -> None:
    packet = stated("mip_sensor_data")["decoded"][0]
    said = {name: value for field in packet["fields"] for name, value in field.items()}
    first, second = read(MIP, b"".join(frames("mip_sensor_data")[:2]))
    assert list(first.delta_angle_rad) == said["delta_theta_rad"]
    assert [v / G0 for v in first.delta_velocity_m_s] == pytest.approx(said["delta_velocity_g_s"])
    assert second.rate_rad_s


def test_xsens_messages() -> None:
    """All four number formats, clipping, messages without inertial data, replies to commands."""
    stream = b"".join(frames("xsens_mti300_mtdata2"))
    records = read(XSENS_MTDATA2, stream, Preference(prefer="rates"))
    samples = 0
    for record, said in zip(records, stated("xsens_mti300_mtdata2")["decoded"], strict=True):
        if "mid" in said:
            assert record.name == f"message {said['mid'][2:]}"
        elif not {"delta_q", "rate_of_turn_rad_s"} & said.keys():
            assert record.name == "MTData2 without inertial data"
        else:
            samples += 1
            check_xsens(record, said)
    assert samples == 3


def check_xsens(record: ImuRecord, said: dict) -> None:
    assert record.sequence == said["packet_counter"]
    if "sample_time_fine_100us" in said:
        assert record.t_device_s == pytest.approx(said["sample_time_fine_100us"] * 1e-4)
    if "rate_of_turn_rad_s" in said:
        assert list(record.rate_rad_s) == said["rate_of_turn_rad_s"]
        assert list(record.specific_force_m_s2) == said["acceleration_m_s2"]
        # The shaken one has accelerometer z and gyro y clipped.
        assert record.valid is (said["status_word"] == "0x00400003")
    else:
        w, *axis = said["delta_q"]
        assert not record.valid
        assert math.hypot(*record.delta_angle_rad) == pytest.approx(
            2 * math.atan2(math.hypot(*axis), w), rel=1e-9
        )
    if "temperature_c" in said:
        assert record.temperature_c == said["temperature_c"][0]


def test_xsens_increments() -> None:
    """400 Hz: a small turn is twice the quaternion's axis; at rest the force is gravity's."""
    stream = b"".join(frames("xsens_mti300_mtdata2"))
    said = [s for s in stated("xsens_mti300_mtdata2")["decoded"] if "delta_v_m_s" in s]
    records = [r for r in read(XSENS_MTDATA2, stream) if isinstance(r, ImuRecord)][:2]
    for record, values in zip(records, said, strict=True):
        assert list(record.delta_velocity_m_s) == values["delta_v_m_s"]
        _, *axis = values["delta_q"]
        assert record.delta_angle_rad == pytest.approx([2 * k for k in axis], rel=1e-3)
    still = records[1]
    assert math.hypot(*still.delta_velocity_m_s) * 400 == pytest.approx(9.81, abs=0.02)
