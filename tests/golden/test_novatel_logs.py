"""NovAtel logs of the shared vectors, captures and manual decode to the values beside them."""

import math
from collections import Counter
from itertools import pairwise

import pytest

from drivers.imu.novatel.logs import NOVATEL_SPAN, NovatelOptions
from drivers.records import CompensatedRecord, ImuRecord, OtherFrame, Record, Rejected
from tests.golden.vectors import frames, stated
from tests.shared_data import shared

RAW = "novatel_rawimusx_edie"
CORRECTED = "novatel_imuratecorrimus_oem7"
FOOT = 0.3048
MG = 9.80665e-3

# The ASCII twins of the two binary frames, as NovAtel's test file has them.
TWINS = (
    b"%RAWIMUSXA,1692,484620.664;00,11,1692,484620.664389000,00801503,43110635,-817242,-202184,"
    b"-215194,-41188,-9895*a5db8c7b\r\n",
    b"%RAWIMUSXA,0,5.998;04,41,0,5.998473,0ba4fe00,-327350056,-10403806,-14067095,-33331,111741,"
    b"345139*db627314\r\n",
)
# Examples of the manual's pages RAWIMUSX, RAWIMUX and RAWIMUS: an Epson G320 at rest, 125 Hz.
MANUAL = (
    b"%RAWIMUSXA,2209,491674.014;04,41,2209,491674.013699,ea59fe00,329308016,-2706935,4508389,"
    b"196192,417138,-1000837*038422a7\r\n"
    b"#RAWIMUXA,USB1,0,64.5,FINESTEERING,2209,491740.110,02000020,0dc5,16809;04,41,2209,"
    b"491740.109817,ea57fe00,329394068,-2396829,4481425,321199,257329,-936077*cf9c035d\r\n"
    b"%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,"
    b"607017,-1009773*1fb76c28\r\n"
)


def read(stream: bytes, options: NovatelOptions | None = None) -> list[Record | Rejected]:
    reader = NOVATEL_SPAN.decoder(options or NovatelOptions())
    return [*reader.feed(stream, 1), *reader.close()]


def test_raw_binary_equals_its_ascii_twin() -> None:
    for frame, twin, said in zip(frames(RAW), TWINS, stated(RAW)["expected"], strict=True):
        (binary,), (text,) = read(frame), read(twin)
        assert isinstance(binary, ImuRecord)
        assert binary.delta_angle_rad == text.delta_angle_rad
        assert binary.delta_velocity_m_s == text.delta_velocity_m_s
        assert text.t_device_s == pytest.approx(binary.t_device_s, abs=1e-6)
        assert binary.t_device_s == said["seconds"]
        assert binary.valid


def test_raw_scales_and_axes() -> None:
    hg1700, epson = stated(RAW)["expected"]
    (first,), (second,) = (read(frame) for frame in frames(RAW))
    assert first.delta_angle_rad == pytest.approx(
        [hg1700["x_gyro"] * 2**-33, -hg1700["minus_y_gyro"] * 2**-33, hg1700["z_gyro"] * 2**-33]
    )
    assert first.delta_velocity_m_s == pytest.approx(
        [
            hg1700["x_accel"] * 2**-27 * FOOT,
            -hg1700["minus_y_accel"] * 2**-27 * FOOT,
            hg1700["z_accel"] * 2**-27 * FOOT,
        ]
    )
    # 100 samples a second: it stands still, z up.
    assert first.delta_velocity_m_s[2] * 100 == pytest.approx(9.8, abs=0.05)
    rate = epson["x_gyro"] * math.radians(0.008 / 2**16)
    assert second.delta_angle_rad[0] == pytest.approx(rate / 125)
    assert second.delta_velocity_m_s[2] * 125 == pytest.approx(-327350056 * 0.2 / 2**16 * MG)


def test_examples_of_the_manual() -> None:
    records = read(MANUAL, NovatelOptions(imu="epson_g320"))
    assert [type(record) for record in records] == 3 * [ImuRecord]
    assert [record.t_device_s for record in records] == [
        491674.013699,
        491740.109817,
        491612.253588,
    ]
    for record in records:
        force = math.hypot(*record.delta_velocity_m_s) * 125
        assert force == pytest.approx(9.8, abs=0.1)
        assert math.hypot(*record.delta_angle_rad) * 125 < math.radians(0.2)


def test_the_short_log_needs_the_unit() -> None:
    said = read(MANUAL)
    assert [type(record) for record in said] == [ImuRecord, ImuRecord, OtherFrame]
    assert said[2].name == "RAWIMUS of an unknown IMU"


def test_corrected_logs_are_marked() -> None:
    said = stated(CORRECTED)["decoded"]
    records = read(b"".join(frames(CORRECTED)))
    for record, wanted in zip(records, said, strict=True):
        assert isinstance(record, CompensatedRecord)
        angles = [wanted[name] for name in ("pitch_rate", "roll_rate", "yaw_rate")]
        assert list(record.delta_angle_rad) == angles
        steps = [wanted[name] for name in ("lateral_acc", "longitudinal_acc", "vertical_acc")]
        assert list(record.delta_velocity_m_s) == steps
    assert [record.t_device_s for record in records[:3]] == [w["seconds"] for w in said[:3]]
    assert NOVATEL_SPAN.encode(records[0], NovatelOptions())[12:-4] == (
        bytes(4) + frames(CORRECTED)[0][16:-4]
    )


def test_capture_has_no_rejected_byte() -> None:
    """INSPVAS, INSPVAX, INSCONFIG and CORRIMUS of a receiver at rest, mixed as it sent them."""
    records = read(shared("captures", "ins1.gps").read_bytes())
    counts = Counter(getattr(record, "name", type(record).__name__) for record in records)
    assert counts == {
        "message 508": 243,
        "message 2051": 29,
        "message 1945": 2,
        "CompensatedRecord": 10,
    }
    times = [r.t_device_s for r in records if isinstance(r, CompensatedRecord)]
    assert all(0.9 < b - a < 1.1 for a, b in pairwise(times))
