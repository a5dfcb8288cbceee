"""The JSON lines of `usblnav decode`."""

import json

from drivers.records import ImuRecord, Rejected, UsblRecord, to_json


def test_rejected_bytes_print_as_hex() -> None:
    line = to_json(Rejected(t_rx_ns=5, line_bytes=2, reason="checksum", data=b"\xfe\x81"))
    assert json.loads(line) == {
        "record": "rejected",
        "t_rx_ns": 5,
        "line_bytes": 2,
        "reason": "checksum",
        "bytes": "fe81",
    }


def test_imu_prints_only_what_the_frame_carries() -> None:
    record = ImuRecord(
        t_rx_ns=5, delta_angle_rad=(1.0, 2.0, 3.0), specific_force_m_s2=(0.0, 0.0, -9.8)
    )
    said = json.loads(to_json(record))
    assert said["record"] == "imu"
    assert said["delta_angle_rad"] == [1.0, 2.0, 3.0]
    assert said["temperature_c"] is None
    assert "rate_rad_s" not in said


def test_usbl_prints_null_for_what_is_missing() -> None:
    said = json.loads(to_json(UsblRecord(t_rx_ns=0, beacon="1", bearing_deg=-0.1)))
    assert said["record"] == "usbl"
    assert said["bearing_deg"] == -0.1
    assert said["xyz_m"] is None
    assert "lat_deg" not in said
