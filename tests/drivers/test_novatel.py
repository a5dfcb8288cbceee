"""NovAtel SPAN: every raw log in every form, errors, units it does not name, damage in the text."""

import math

import msgspec
import pytest

from drivers.imu.novatel.frames import MESSAGE_MAX, ascii_log, crc, long
from drivers.imu.novatel.logs import NOVATEL_SPAN, NovatelOptions
from drivers.imu.novatel.scales import SCALES, TYPES
from drivers.records import ImuRecord, OtherFrame, Record, Rejected

SAMPLE = ImuRecord(
    t_rx_ns=0,
    t_device_s=491674.25,
    delta_angle_rad=(1e-4, -2e-4, 3e-4),
    delta_velocity_m_s=(0.01, -0.02, 0.098),
)


def read(stream: bytes, **options: object) -> list[Record | Rejected]:
    reader = NOVATEL_SPAN.decoder(msgspec.convert(options, NovatelOptions))
    return [*reader.feed(stream, 7), *reader.close()]


@pytest.mark.parametrize("log", ["rawimu", "rawimus", "rawimux", "rawimusx"])
@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("imu", sorted(SCALES))
def test_round_trip(log: str, text: bool, imu: str) -> None:
    options = {"log": log, "ascii": text, "imu": imu}
    (record,) = read(NOVATEL_SPAN.encode(SAMPLE, msgspec.convert(options, NovatelOptions)), imu=imu)
    scale = SCALES[imu]
    assert record.t_device_s == SAMPLE.t_device_s
    assert record.delta_angle_rad == pytest.approx(
        SAMPLE.delta_angle_rad, abs=0.51 * scale.gyro_rad
    )
    assert record.delta_velocity_m_s == pytest.approx(
        SAMPLE.delta_velocity_m_s, abs=0.51 * scale.accel_m_s
    )


@pytest.mark.parametrize("text", [False, True])
def test_an_error_of_the_unit(text: bool) -> None:
    bad = msgspec.structs.replace(SAMPLE, valid=False)
    (record,) = read(NOVATEL_SPAN.encode(bad, NovatelOptions(ascii=text)))
    assert not record.valid


def test_scales_of_the_options_overrule() -> None:
    log = NOVATEL_SPAN.encode(SAMPLE, NovatelOptions(imu="isa100c"))
    (record,) = read(log, gyro_lsb_rad=2e-9, accel_lsb_m_s=1e-8)
    assert record.delta_angle_rad == pytest.approx([2 * v for v in SAMPLE.delta_angle_rad])
    assert record.delta_velocity_m_s == pytest.approx([v / 2 for v in SAMPLE.delta_velocity_m_s])


def test_kvh_1750_can_tell_the_rotation_of_the_earth() -> None:
    """Its count is in degrees: in radians one count a sample would be 4.5 deg/h."""
    count_deg_h = math.degrees(SCALES["kvh1750"].gyro_rad) * 200 * 3600
    assert count_deg_h == pytest.approx(0.078, abs=0.001)


def test_a_unit_not_in_the_list() -> None:
    fields = ["00", "77", "0", "1.5", "00000000", "1", "2", "3", "4", "5", "6"]
    log = ascii_log("%RAWIMUSXA,0,1.500", fields)
    assert 77 not in TYPES
    (record,) = read(log)
    assert isinstance(record, OtherFrame)
    assert record.name == "RAWIMUSX of an unknown IMU"
    (known,) = read(log, gyro_lsb_rad=1e-6, accel_lsb_m_s=1e-3)
    assert known.delta_angle_rad == pytest.approx([6e-6, -5e-6, 4e-6])
    assert known.delta_velocity_m_s == pytest.approx([3e-3, -2e-3, 1e-3])


def test_fields_behind_the_last_are_left() -> None:
    fields = ["26", "1.5", "00000000", "1", "2", "3", "4", "5", "6"]
    records = (
        read(ascii_log("%RAWIMUSA,0,1.500", [*fields, *more]), imu="isa100c")[0]
        for more in ((), ("7", "8"))
    )
    told, longer = (record.delta_angle_rad for record in records)
    assert longer == told == pytest.approx([6e-9, -5e-9, 4e-9])


def test_other_logs_are_passed_on() -> None:
    best = long(42, bytes(72), 3.0)
    text = ascii_log("#BESTPOSA,COM1,0,1.0,FINE,0,3.0,00000000,0000,0", ["SOL_COMPUTED"])
    records = read(best + text)
    assert [record.name for record in records] == ["message 42", "BESTPOSA"]
    assert [record.data for record in records] == [best, text]


@pytest.mark.parametrize(
    "fields",
    [
        ["00", "26", "0", "1.5", "00000000", "1", "2", "3", "4", "5"],
        ["00", "26", "0", "1.5", "00000000", "1", "2", "3", "4", "5", "x"],
        ["zz", "26", "0", "1.5", "00000000", "1", "2", "3", "4", "5", "6"],
        ["00", "nan", "0", "1.5", "00000000", "1", "2", "3", "4", "5", "6"],
    ],
)
def test_text_that_is_no_log(fields: list[str]) -> None:
    (record,) = read(ascii_log("%RAWIMUSXA,0,1.500", fields))
    assert isinstance(record, Rejected)
    assert record.reason == "syntax"


@pytest.mark.parametrize("seconds", ["-1", "604801", "nan", "inf"])
def test_a_time_that_is_none(seconds: str) -> None:
    fields = ["00", "26", "0", seconds, "00000000", "1", "2", "3", "4", "5", "6"]
    (record,) = read(ascii_log("%RAWIMUSXA,0,1.500", fields))
    assert (type(record), record.reason) == (Rejected, "range")


def test_a_length_beyond_belief_is_not_waited_for() -> None:
    header = bytearray(long(42, b"", 0.0)[:28])
    header[8:10] = (MESSAGE_MAX + 1).to_bytes(2, "little")
    log = NOVATEL_SPAN.encode(SAMPLE, NovatelOptions())
    reader = NOVATEL_SPAN.decoder(NovatelOptions())
    assert [type(r) for r in reader.feed(bytes(header) + log, 0)] == [Rejected, ImuRecord]


def test_crc_is_that_of_zip_without_its_inversions() -> None:
    """The reflected polynomial, bit by bit."""
    data, remainder = b"NovAtel", 0
    for byte in data:
        remainder ^= byte
        for _ in range(8):
            remainder = remainder >> 1 ^ (0xEDB88320 if remainder & 1 else 0)
    assert crc(data) == remainder
