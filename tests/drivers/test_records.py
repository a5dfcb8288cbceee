"""The JSON lines of `usblnav decode`."""

import json

from drivers.records import DvlRecord, ImuRecord, LblRecord, LblReply, Rejected, UsblRecord, to_json


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


def test_a_log_without_bottom_lock_prints_no_velocity() -> None:
    said = json.loads(to_json(DvlRecord(t_rx_ns=0, valid=False, age_s=0.25)))
    assert (said["record"], said["axes"], said["velocity_m_s"]) == ("dvl", "sensor", None)
    assert (said["valid"], said["age_s"]) == (False, 0.25)
    assert "sd_m_s" not in said


def test_replies_of_a_long_baseline_print_as_objects() -> None:
    reply = LblReply(beacon="B", one_way_s=0.125)
    said = json.loads(to_json(LblRecord(t_rx_ns=0, t_ping_s=10.5, replies=(reply,))))
    assert (said["record"], said["t_ping_s"]) == ("lbl", 10.5)
    assert said["replies"] == [
        {"beacon": "B", "one_way_s": 0.125, "range_m": None, "range_rate_m_s": None}
    ]
