"""KVH 1725/1750/1775: units, status, time, magnetic field, built-in test, impossible values."""

import math
import struct

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.imu.kvh import KVH1750, KvhOptions
from drivers.imu.sample import G0
from drivers.records import DeviceStatus, ImuRecord, Record, Rejected
from tests.drivers.test_checksums import divided


def read(frame: bytes, **options: str) -> Record | Rejected:
    reader = KVH1750.decoder(msgspec.convert(options, KvhOptions))
    records = [*reader.feed(frame, 7), *reader.close()]
    assert len(records) == 1
    return records[0]


def sealed(body: bytes) -> bytes:
    return body + struct.pack(">I", divided(body))


def format_a(
    values: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
    status: int = 0x77,
    sequence: int = 5,
    temperature: int = 20,
) -> bytes:
    return sealed(
        b"\xfe\x81\xff\x55" + struct.pack(">6fBBh", *values, status, sequence, temperature)
    )


def f32(value: float) -> float:
    return struct.unpack(">f", struct.pack(">f", value))[0]


GYRO = tuple(map(f32, (0.1, 0.2, 0.3)))
ACCEL = tuple(map(f32, (0.4, 0.5, 0.6)))


@pytest.mark.parametrize(
    ("gyro", "field", "scale"),
    [
        ("delta_angle_rad", "delta_angle_rad", 1.0),
        ("delta_angle_deg", "delta_angle_rad", math.pi / 180),
        ("rate_rad_s", "rate_rad_s", 1.0),
        ("rate_deg_s", "rate_rad_s", math.pi / 180),
    ],
)
def test_gyro_units(gyro: str, field: str, scale: float) -> None:
    record = read(format_a(), gyro=gyro)
    assert getattr(record, field) == tuple(value * scale for value in GYRO)
    other = {"delta_angle_rad": "rate_rad_s", "rate_rad_s": "delta_angle_rad"}[field]
    assert getattr(record, other) is msgspec.UNSET


@pytest.mark.parametrize(
    ("accel", "field", "scale"),
    [
        ("g", "specific_force_m_s2", 9.80665),
        ("delta_v_m_s", "delta_velocity_m_s", 1.0),
        ("delta_v_ft_s", "delta_velocity_m_s", 0.3048),
    ],
)
def test_accelerometer_units(accel: str, field: str, scale: float) -> None:
    record = read(format_a(), accel=accel)
    assert getattr(record, field) == tuple(value * scale for value in ACCEL)


@pytest.mark.parametrize(
    ("temperature", "raw", "celsius"),
    [("c", -5, -5.0), ("c_100", 2150, 21.5), ("f", 50, 10.0), ("f_100", -400, -20.0)],
)
def test_temperature_units(temperature: str, raw: int, celsius: float) -> None:
    assert read(format_a(temperature=raw), temperature=temperature).temperature_c == pytest.approx(
        celsius, abs=1e-12
    )


def test_sample_is_valid_only_if_all_six_axes_are() -> None:
    for status in range(128):
        expected = all(status >> bit & 1 for bit in (0, 1, 2, 4, 5, 6))
        assert read(format_a(status=status)).valid is expected


def test_format_b_counter() -> None:
    body = b"\xfe\x81\xff\x56" + struct.pack(">6fIBBh", *GYRO, *ACCEL, 2**32 - 1, 0x77, 127, 31)
    record = read(sealed(body))
    assert record.t_device_s == 4294.967295
    assert (record.sequence, record.temperature_c) == (127, 31.0)
    assert record.delta_angle_rad == GYRO


@pytest.mark.parametrize(("sequence", "axis"), [(0, None), (5, "x"), (6, "y"), (127, "z")])
def test_format_c_takes_turns(sequence: int, axis: str | None) -> None:
    body = b"\xfe\x81\xff\x57" + struct.pack(">6ffBB", *GYRO, *ACCEL, 0.25, 0x77, sequence)
    record = read(sealed(body))
    if axis is None:
        assert record.temperature_c == 0.25
        assert record.magnetic_gauss is msgspec.UNSET
    else:
        assert record.temperature_c is None
        assert record.magnetic_gauss == (axis, 0.25)


@pytest.mark.parametrize("place", range(6))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30])
def test_impossible_values_are_out_of_range(place: int, value: float) -> None:
    values = [0.0] * 6
    values[place] = value
    frame = format_a(tuple(values))
    assert read(frame) == Rejected(t_rx_ns=7, line_bytes=36, reason="range", data=frame)


def test_impossible_extra_and_sequence() -> None:
    body = b"\xfe\x81\xff\x57" + struct.pack(">6ffBB", *GYRO, *ACCEL, math.nan, 0x77, 1)
    assert read(sealed(body)).reason == "range"
    assert read(format_a(sequence=128)).reason == "range"


def test_degrees_taken_for_radians_are_noticed() -> None:
    frame = format_a((300.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert read(frame, gyro="rate_rad_s").reason == "range"
    assert read(frame, gyro="rate_deg_s").rate_rad_s[0] == pytest.approx(5.236, abs=1e-3)


def test_failed_tests_are_named() -> None:
    body = bytes.fromhex("fe8100ab7e7f7f7f7f3f777f")
    record = read(body + bytes([sum(body) % 256]))
    assert record == DeviceStatus(
        t_rx_ns=7,
        line_bytes=13,
        healthy=False,
        failed=("byte 0 bit 0", "byte 5 bit 6", "SR MAG offset"),
    )


def test_test_frame_with_the_bit_that_is_always_zero() -> None:
    body = bytes.fromhex("fe8100aaff7f7f7f7f7f")
    assert read(body + bytes([sum(body) % 256])).reason == "range"


def test_corrupted_test_frame() -> None:
    reader = KVH1750.decoder(KvhOptions())
    frame = bytes.fromhex("fe8100aa7f7f7f7f7f7f24")
    found = [*reader.feed(frame, 0), *reader.close()]
    assert [(record.reason, record.data) for record in found] == [("checksum", frame)]


FINITE = st.floats(-1.0, 1.0, width=32)


@given(
    gyro=st.tuples(FINITE, FINITE, FINITE),
    accel=st.tuples(FINITE, FINITE, FINITE),
    sequence=st.integers(0, 127),
    extra=st.integers(-40, 80),
    time_us=st.integers(0, 2**32 - 1),
    options=st.builds(
        KvhOptions,
        gyro=st.sampled_from(["delta_angle_rad", "delta_angle_deg", "rate_rad_s", "rate_deg_s"]),
        accel=st.sampled_from(["g", "delta_v_m_s", "delta_v_ft_s"]),
        temperature=st.sampled_from(["c", "c_100", "f", "f_100"]),
        format=st.sampled_from(["a", "b", "c"]),
    ),
)
def test_decode_encode_gives_the_same_bytes(
    gyro: tuple[float, ...],
    accel: tuple[float, ...],
    sequence: int,
    extra: int,
    time_us: int,
    options: KvhOptions,
) -> None:
    axes = (*gyro, *accel)
    body = {
        "a": b"\xfe\x81\xff\x55" + struct.pack(">6fBBh", *axes, 0x77, sequence, extra),
        "b": b"\xfe\x81\xff\x56" + struct.pack(">6fIBBh", *axes, time_us, 0x77, sequence, extra),
        "c": b"\xfe\x81\xff\x57" + struct.pack(">6ffBB", *axes, extra, 0x77, sequence),
    }[options.format]
    frame = sealed(body)
    reader = KVH1750.decoder(options)
    (record,) = reader.feed(frame, 0)
    assert isinstance(record, ImuRecord)
    assert struct.unpack(">6f", KVH1750.encode(record, options)[4:28]) == pytest.approx(
        axes, rel=2e-7, abs=1e-38
    )
    (again,) = KVH1750.decoder(options).feed(KVH1750.encode(record, options), 0)
    assert again.temperature_c == pytest.approx(record.temperature_c, abs=1e-5)
    assert msgspec.structs.asdict(again)["magnetic_gauss"] == record.magnetic_gauss
    assert (again.sequence, again.t_device_s, again.valid) == (sequence, record.t_device_s, True)


@pytest.mark.parametrize("failed", [(), ("SR MAG offset", "GCB Y volts"), ("byte 3 bit 2",)])
def test_status_round_trip(failed: tuple[str, ...]) -> None:
    status = DeviceStatus(t_rx_ns=7, line_bytes=0, healthy=not failed, failed=failed)
    record = read(KVH1750.encode(status, KvhOptions()))
    assert msgspec.structs.replace(record, line_bytes=0) == status


def test_encode_refuses_what_the_options_do_not_say() -> None:
    record = read(format_a())
    with pytest.raises(ValueError, match="does not carry rate_rad_s"):
        KVH1750.encode(record, KvhOptions(gyro="rate_deg_s"))
    with pytest.raises(ValueError, match="no test called"):
        KVH1750.encode(DeviceStatus(t_rx_ns=0, healthy=False, failed=("?",)), KvhOptions())


def test_standard_gravity() -> None:
    assert G0 == 9.80665
