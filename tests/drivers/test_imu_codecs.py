"""What holds for the codecs of all inertial units, and the particulars of the smaller ones."""

import math
import struct

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import registry
from drivers.checksums import crc16_ccitt_false, crc16_kermit, crc16_xmodem, fletcher8
from drivers.codec import Codec
from drivers.imu.anpp import ANPP
from drivers.imu.mip import MIP
from drivers.imu.sbg import SBG_ECOM
from drivers.imu.vectornav import VECTORNAV
from drivers.imu.xsens import XSENS_MTDATA2
from drivers.records import ImuRecord, OtherFrame, Record, Rejected, TimeRecord, UsblRecord

INCREMENTS = [VECTORNAV, XSENS_MTDATA2, MIP]
RATES = [SBG_ECOM, ANPP, *INCREMENTS]

# As the emulator says a sample: in every form.
SAMPLE = ImuRecord(
    t_rx_ns=0,
    sequence=77,
    t_device_s=1234.5,
    rate_rad_s=(0.1, -0.2, 0.3),
    delta_angle_rad=(0.001, -0.002, 0.003),
    specific_force_m_s2=(0.5, -1.5, -9.8),
    delta_velocity_m_s=(0.005, -0.015, -0.098),
    interval_s=0.01,
    temperature_c=21.5,
)


def read(codec: Codec, stream: bytes, **options: object) -> list[Record | Rejected]:
    reader = codec.decoder(msgspec.convert(options, codec.options))
    return [*reader.feed(stream, 7), *reader.close()]


def write(codec: Codec, record: Record, **options: object) -> bytes:
    return codec.encode(record, msgspec.convert(options, codec.options))


def named(codec: Codec) -> str:
    return codec.name


@pytest.mark.parametrize("codec", RATES, ids=named)
@pytest.mark.parametrize("valid", [True, False])
def test_rates_round_trip(codec: Codec, valid: bool) -> None:
    options = {"prefer": "rates"} if codec in INCREMENTS else {}
    told = msgspec.structs.replace(SAMPLE, valid=valid)
    (record,) = read(codec, write(codec, told, **options))
    assert record.rate_rad_s == pytest.approx(SAMPLE.rate_rad_s, rel=1e-6)
    assert record.specific_force_m_s2 == pytest.approx(SAMPLE.specific_force_m_s2, rel=1e-5)
    assert (record.delta_angle_rad, record.delta_velocity_m_s) == (msgspec.UNSET, msgspec.UNSET)
    assert record.temperature_c == 21.5
    assert record.valid is (valid or codec is ANPP)
    if codec is not ANPP:
        assert record.t_device_s == 1234.5


@pytest.mark.parametrize("codec", INCREMENTS, ids=named)
def test_increments_round_trip(codec: Codec) -> None:
    (record,) = read(codec, write(codec, SAMPLE))
    assert record.delta_angle_rad == pytest.approx(SAMPLE.delta_angle_rad, rel=1e-6)
    assert record.delta_velocity_m_s == pytest.approx(SAMPLE.delta_velocity_m_s, rel=1e-6)
    assert (record.rate_rad_s, record.specific_force_m_s2) == (msgspec.UNSET, msgspec.UNSET)
    assert (record.t_device_s, record.valid) == (1234.5, True)
    if codec is not XSENS_MTDATA2:
        assert record.interval_s == pytest.approx(0.01)


@pytest.mark.parametrize("codec", [VECTORNAV, XSENS_MTDATA2, MIP, ANPP], ids=named)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e9])
@pytest.mark.parametrize("field", ["rate_rad_s", "specific_force_m_s2"])
def test_numbers_that_are_none_are_out_of_range(codec: Codec, value: float, field: str) -> None:
    options = {"prefer": "rates"} if codec in INCREMENTS else {}
    bad = msgspec.structs.replace(SAMPLE, **{field: (0.0, value, 0.0)})
    (record,) = read(codec, write(codec, bad, **options))
    assert isinstance(record, Rejected)
    assert record.reason == "range"


@pytest.mark.parametrize("codec", [VECTORNAV, XSENS_MTDATA2, MIP, ANPP], ids=named)
@pytest.mark.parametrize("value", [math.nan, math.inf, -400.0])
def test_a_temperature_that_is_none(codec: Codec, value: float) -> None:
    options = {"prefer": "rates"} if codec in INCREMENTS else {}
    bad = msgspec.structs.replace(SAMPLE, temperature_c=value)
    (record,) = read(codec, write(codec, bad, **options))
    assert (type(record), record.reason) == (Rejected, "range")


@pytest.mark.parametrize("value", [math.nan, math.inf, -0.01])
def test_an_interval_that_is_none(value: float) -> None:
    (record,) = read(VECTORNAV, write(VECTORNAV, msgspec.structs.replace(SAMPLE, interval_s=value)))
    assert (type(record), record.reason) == (Rejected, "range")


@pytest.mark.parametrize("codec", [VECTORNAV, SBG_ECOM], ids=named)
def test_a_number_beyond_its_field_is_refused(codec: Codec) -> None:
    far = msgspec.structs.replace(SAMPLE, t_device_s=1e12, temperature_c=200.0)
    with pytest.raises(ValueError, match=f"{codec.name} cannot say this ImuRecord: "):
        codec.encode(far, codec.options())


@pytest.mark.parametrize("codec", RATES, ids=named)
def test_encode_refuses_what_the_format_cannot_say(codec: Codec) -> None:
    with pytest.raises(ValueError, match="does not carry"):
        codec.encode(ImuRecord(t_rx_ns=0), codec.options())
    with pytest.raises(ValueError, match="cannot say a UsblRecord"):
        codec.encode(UsblRecord(t_rx_ns=0, beacon="1"), codec.options())


@pytest.mark.parametrize(
    "name", [name for name in registry.CODECS if registry.lookup(name).kind == "imu"]
)
def test_what_counts_wraps_as_declared(name: str) -> None:
    """A count or time beyond the modulus comes out less the modulus."""
    codec = registry.lookup(name)
    counting = codec.counting
    time_s = counting.time_modulus_s or 2e6
    told = msgspec.structs.replace(
        SAMPLE, sequence=(counting.sequence_modulus or 10**6) + 5, t_device_s=time_s + 1.5
    )
    (record, *_) = read(codec, codec.encode(told, codec.options()))
    if counting.sequence_modulus is not None:
        assert record.sequence == 5
    if counting.time_modulus_s is not None and record.t_device_s is not None:
        assert record.t_device_s == pytest.approx(1.5, abs=1e-4)


def sbg(message: int, kind: int, data: bytes) -> bytes:
    """A frame whose CRC-16/KERMIT is computed bit by bit."""
    body = bytes([message, kind]) + struct.pack("<H", len(data)) + data
    remainder = 0
    for byte in body:
        remainder ^= byte
        for _ in range(8):
            remainder = remainder >> 1 ^ (0x8408 if remainder & 1 else 0)
    return b"\xff\x5a" + body + struct.pack("<H", remainder) + b"\x33"


@pytest.mark.parametrize(("status", "scale"), [(0x3FF, 67108864), (0x7FF, 12304174)])
def test_sbg_scales(status: int, scale: int) -> None:
    data = struct.pack("<IH6ih", 5_000_000, status, 1 << 20, 0, -(2 << 20), scale, 0, -scale, 6400)
    (record,) = read(SBG_ECOM, sbg(44, 0, data))
    assert record.specific_force_m_s2 == (1.0, 0.0, -2.0)
    assert record.rate_rad_s == pytest.approx((1.0, 0.0, -1.0))
    assert (record.t_device_s, record.temperature_c, record.valid) == (5.0, 25.0, True)


@pytest.mark.parametrize("bit", range(10))
def test_sbg_status(bit: int) -> None:
    data = struct.pack("<IH6ih", 0, 0x3FF ^ 1 << bit, *6 * (0,), 0)
    (record,) = read(SBG_ECOM, sbg(44, 0, data))
    assert not record.valid


def test_sbg_turns_up_its_scale_for_what_is_fast() -> None:
    fast = msgspec.structs.replace(SAMPLE, rate_rad_s=(40.0, 0.0, 0.0))
    (record,) = read(SBG_ECOM, write(SBG_ECOM, fast))
    assert record.rate_rad_s[0] == pytest.approx(40.0)


def test_sbg_other_logs() -> None:
    (record,) = read(SBG_ECOM, sbg(2, 0, bytes(33)))
    assert (type(record), record.name) == (OtherFrame, "class 0 message 2")


def test_anpp_takes_the_time_of_its_cycle_once() -> None:
    told = msgspec.structs.replace(SAMPLE, t_device_s=1_780_000_000.25)
    pair = write(ANPP, told, with_time=True)
    records = read(ANPP, pair + write(ANPP, told) + pair)
    assert [type(r) for r in records] == [TimeRecord, ImuRecord, ImuRecord, TimeRecord, ImuRecord]
    assert [r.t_device_s for r in records if isinstance(r, ImuRecord)] == [
        1_780_000_000.25,
        None,
        1_780_000_000.25,
    ]
    assert records[0].unix_s == 1_780_000_000.25
    assert records[0].valid


def test_anpp_running_time() -> None:
    pair = write(ANPP, SAMPLE, with_time=True, time="running")
    other, record = read(ANPP, pair, time="running")
    assert (other.name, record.t_device_s) == ("packet 49", 1234.5)
    assert read(ANPP, pair)[1].t_device_s is None


def test_anpp_raw_of_an_air_data_unit_is_another_packet() -> None:
    crc = 0xFFFF
    payload = bytes(13)
    for byte in payload:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    header = bytes([28, 13, crc & 0xFF, crc >> 8])
    lrc = ((sum(header) ^ 0xFF) + 1) & 0xFF
    (record,) = read(ANPP, bytes([lrc]) + header + payload)
    assert (type(record), record.name) == (OtherFrame, "packet 28")


def mip(*fields: tuple[int, bytes]) -> bytes:
    content = b"".join(bytes([len(data) + 2, kind]) + data for kind, data in fields)
    packet = b"\x75\x65\x80" + bytes([len(content)]) + content
    one = two = 0
    for byte in packet:
        one = (one + byte) % 256
        two = (two + one) % 256
    assert fletcher8(packet) == bytes([one, two])
    return packet + bytes([one, two])


def test_mip_gps_time_and_overrange() -> None:
    vector = struct.pack(">3f", 0.0, 0.0, 1.0)
    time = struct.pack(">dHH", 100.5, 2300, 7)
    stream = mip((0xD3, time), (4, vector), (5, vector), (0x18, b"\x00\x04"))
    (record,) = read(MIP, stream)
    assert record.t_device_s == 2300 * 604800 + 100.5
    assert not record.valid
    (magnetic,) = read(MIP, mip((4, vector), (5, vector), (0x18, b"\x07\x00")))
    assert magnetic.valid


def test_mip_half_a_sample_is_not_valid() -> None:
    (record,) = read(MIP, mip((5, struct.pack(">3f", 0.0, 0.0, 1.0))))
    assert (record.valid, record.specific_force_m_s2) == (False, msgspec.UNSET)


@pytest.mark.parametrize("content", [((4, bytes(11)),), ((0xD5, bytes(4)),)])
def test_mip_fields_of_a_wrong_size(content: tuple[tuple[int, bytes], ...]) -> None:
    (record,) = read(MIP, mip(*content))
    assert (type(record), record.reason) == (Rejected, "syntax")


def xsens(data: bytes, long: bool = False) -> bytes:
    length = b"\xff" + struct.pack(">H", len(data)) if long else bytes([len(data)])
    body = b"\xff\x36" + length + data
    return b"\xfa" + body + bytes([256 - sum(body) % 256 & 0xFF])


def test_xsens_extended_length() -> None:
    vector = struct.pack(">3d", 0.1, 0.2, 0.3)
    items = b"\x80\x23\x18" + vector + b"\x40\x23\x18" + vector
    (record,) = read(XSENS_MTDATA2, xsens(items + b"\x12\x34\xfa" + bytes(250), long=True))
    assert record.rate_rad_s == record.specific_force_m_s2 == (0.1, 0.2, 0.3)


@pytest.mark.parametrize("data", [b"\x80\x20\x0b" + bytes(11), b"\x10\x20\x05\x00", b"\x10\x20"])
def test_xsens_items_that_do_not_fit(data: bytes) -> None:
    (record,) = read(XSENS_MTDATA2, xsens(data))
    assert (type(record), record.reason) == (Rejected, "syntax")


@given(st.tuples(*3 * [st.floats(-1.5, 1.5)]))
def test_xsens_orientation_increments(angle: tuple[float, float, float]) -> None:
    told = msgspec.structs.replace(SAMPLE, delta_angle_rad=angle)
    (record,) = read(XSENS_MTDATA2, write(XSENS_MTDATA2, told))
    assert record.delta_angle_rad == pytest.approx(angle, rel=1e-5, abs=1e-6)


def vectornav(header: bytes, payload: bytes) -> bytes:
    crc = 0
    for byte in header + payload:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return b"\xfa" + header + payload + struct.pack(">H", crc)


def test_vectornav_fields_of_three_groups() -> None:
    """Group 2: start-up, sync in, UTC; group 3: raw rate and force, temperature, saturation; 5."""
    header = b"\x16" + struct.pack("<3H", 1 | 1 << 4 | 1 << 6, 0x8_1C, 1 << 1)
    payload = struct.pack("<QQ8x", 2_500_000_000, 125_000_000)
    payload += struct.pack("<3f3ffH", 1.0, 2.0, -9.5, 0.25, 0.5, 0.75, 30.0, 0)
    (record,) = read(VECTORNAV, vectornav(header, payload + bytes(12)))
    assert (record.t_device_s, record.since_pulse_s) == (2.5, pytest.approx(0.125))
    assert record.specific_force_m_s2 == (1.0, 2.0, -9.5)
    assert record.rate_rad_s == (0.25, 0.5, 0.75)
    assert (record.temperature_c, record.valid) == (30.0, True)


@pytest.mark.parametrize(("bit", "valid"), [(0, True), (3, False), (8, False), (9, True)])
def test_vectornav_saturation(bit: int, valid: bool) -> None:
    header = b"\x04" + struct.pack("<H", 0x80C)
    payload = struct.pack("<6fH", *6 * (0.0,), 1 << bit)
    (record,) = read(VECTORNAV, vectornav(header, payload))
    assert record.valid is valid


def test_vectornav_takes_the_uncompensated() -> None:
    header = b"\x04" + struct.pack("<H", 1 << 2 | 1 << 3 | 1 << 9 | 1 << 10)
    payload = struct.pack("<12f", 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4)
    (record,) = read(VECTORNAV, vectornav(header, payload))
    assert (record.specific_force_m_s2[0], record.rate_rad_s[0]) == (1.0, 2.0)


@pytest.mark.parametrize("mask", [1 << 14, 1 << 15])
def test_vectornav_fields_without_a_fixed_length(mask: int) -> None:
    """Satellites' data in group 4: the packet's end is not known, so it is not one."""
    records = read(VECTORNAV, vectornav(b"\x08" + struct.pack("<H", mask), bytes(40)))
    assert {type(record) for record in records} == {Rejected}


def test_checks_of_the_catalogue() -> None:
    """The check values of the CRC catalogue for "123456789"."""
    digits = b"123456789"
    assert crc16_xmodem(digits) == 0x31C3
    assert crc16_ccitt_false(digits) == 0x29B1
    assert crc16_kermit(digits) == 0x2189
