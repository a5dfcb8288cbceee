"""STIM300: every identifier, units and ranges, configuration, CR LF, status, integrated outputs."""

import math
from itertools import pairwise

import msgspec
import pytest

from drivers.imu.sample import G0
from drivers.imu.stim300 import STIM300, Stim300Options, configuration
from drivers.records import DeviceStatus, ImuRecord, OtherFrame, Record, Rejected
from tests.drivers.test_checksums import divided

# Identifiers with their length and dummy bytes as the data sheet lists them (tables 5-21, 5-22),
# those with AUX as a public driver does.
PLAIN, PPS, AUX = map(bytes.fromhex, ("9091929394a5a6a7", "f0f1f2f3f4f5f6f7", "98999a9b9cadaeaf"))
LENGTHS = {
    **dict(zip(PLAIN, (18, 28, 28, 38, 25, 42, 42, 59), strict=True)),
    **dict(zip(PPS, (22, 32, 32, 42, 29, 46, 46, 63), strict=True)),
    **dict(zip(AUX, (22, 32, 32, 42, 29, 46, 46, 63), strict=True)),
}
DUMMIES = {
    **dict(zip(PLAIN, (2, 0, 0, 2, 3, 2, 2, 1), strict=True)),
    **dict(zip(PPS, (2, 0, 0, 2, 3, 2, 2, 1), strict=True)),
    **dict(zip(AUX, (2, 0, 0, 2, 3, 2, 2, 1), strict=True)),
    **dict(zip(b"\xb1\xb5\xbc\xbd\xbe\xd1", (0, 0, 2, 2, 3, 0), strict=True)),
}


def i24(value: int) -> bytes:
    return value.to_bytes(3, "big", signed=True)


def sealed(body: bytes) -> bytes:
    crc = divided(body + bytes(DUMMIES[body[0]]))
    return body + crc.to_bytes(4, "big")


def sample(
    gyro: tuple[int, int, int] = (1 << 14, -(2 << 14), 3),
    accel: tuple[int, int, int] = (1 << 19, -(1 << 18), 5),
    status: tuple[int, int] = (0, 0),
    counter: int = 17,
    pulse: bytes = b"",
) -> bytes:
    """Gyro and accelerometer, or these with PPS."""
    body = b"\xf1" if pulse else b"\x91"
    for values, flags in zip((gyro, accel), status, strict=True):
        body += b"".join(map(i24, values)) + bytes([flags])
    return sealed(body + pulse + bytes([counter, 0x01, 0xFA]))


def read(stream: bytes, t_rx_ns: int = 7, **options: object) -> list[Record | Rejected]:
    reader = STIM300.decoder(msgspec.convert(options, Stim300Options))
    return [*reader.feed(stream, t_rx_ns), *reader.close()]


@pytest.mark.parametrize("identifier", sorted(LENGTHS))
def test_every_normal_datagram(identifier: int) -> None:
    body = bytes([identifier]) + bytes(LENGTHS[identifier] - 8) + bytes([200, 0x01, 0x00])
    (record,) = read(sealed(body))
    assert isinstance(record, ImuRecord)
    assert (record.sequence, record.age_s) == (200, pytest.approx(256e-6))
    has_accel = identifier in bytes.fromhex("9193a5a7 f1f3f5f7 999badaf")
    assert record.valid is has_accel
    assert (record.specific_force_m_s2 is not msgspec.UNSET) is has_accel
    has_temperature = identifier in bytes.fromhex("94a5a6a7 f4f5f6f7 9cadaeaf")
    assert (record.temperature_c is not None) is has_temperature
    assert (record.since_pulse_s is not msgspec.UNSET) is (identifier >= 0xF0)


@pytest.mark.parametrize(
    ("unit", "field", "lsb_deg"),
    [("rate", "rate_rad_s", 2**-14), ("increment", "delta_angle_rad", 2**-21)],
)
def test_gyro_units(unit: str, field: str, lsb_deg: float) -> None:
    (record,) = read(sample(), gyro=unit)
    wanted = [math.radians(n * lsb_deg) for n in (1 << 14, -(2 << 14), 3)]
    assert getattr(record, field) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize(
    ("range_g", "lsb_g", "lsb_m_s"),
    [(5, 2**-20, 2**-23), (10, 2**-19, 2**-22), (30, 2**-18, 2**-21), (80, 2**-16, 2**-19)],
)
def test_accelerometer_units(range_g: int, lsb_g: float, lsb_m_s: float) -> None:
    ticks = (1 << 19, -(1 << 18), 5)
    (record,) = read(sample(), accel_range_g=range_g)
    assert record.specific_force_m_s2 == pytest.approx([n * lsb_g * G0 for n in ticks], rel=1e-14)
    (record,) = read(sample(), accel_range_g=range_g, accel="increment")
    assert record.delta_velocity_m_s == pytest.approx([n * lsb_m_s for n in ticks], rel=1e-14)


@pytest.mark.parametrize(
    ("flags", "valid"),
    [(0x00, True), (0x20, True), (0x80, False), (0x40, False), (0x11, False), (0x0C, False)],
)
def test_status(flags: int, valid: bool) -> None:
    for status in ((flags, 0), (0, flags)):
        (record,) = read(sample(status=status))
        assert record.valid is valid


def test_pulse() -> None:
    (record,) = read(sample(pulse=i24(1_000_123) + b"\x00"))
    assert record.since_pulse_s == pytest.approx(1.000123)
    (saturated,) = read(sample(pulse=i24((1 << 23) - 1) + b"\x10"))
    assert saturated.since_pulse_s is msgspec.UNSET
    (filtered,) = read(sample(pulse=i24(1 << 22) + b"\x00"), pps="filtered")
    assert filtered.since_pulse_s is msgspec.UNSET


def test_configuration_overrules_the_options() -> None:
    """Byte 5: incremental angle; 8: incremental velocity; 17-18: ranges 30, 5 and 80 g."""
    body = bytearray(b"\xbc" + bytes(21))
    body[3:4], body[5:6], body[8:9], body[17:19] = b"\x52", b"\x71", b"\x71", b"\x43\x60"
    said, record = read(sealed(bytes(body)) + sample())
    assert isinstance(said, OtherFrame)
    assert said.name == "configuration"
    assert record.delta_angle_rad[0] == pytest.approx(math.radians(2**14 * 2**-21))
    wanted = [(1 << 19) * 2**-21, -(1 << 18) * 2**-23, 5 * 2**-19]
    assert record.delta_velocity_m_s == pytest.approx(wanted)


@pytest.mark.parametrize("crlf", [False, True])
@pytest.mark.parametrize("gyro", ["rate", "increment", "integrated"])
@pytest.mark.parametrize("accel", ["acceleration", "increment", "integrated", "integrated_g"])
@pytest.mark.parametrize("range_g", [5, 10, 30, 80])
def test_configuration_as_written_is_read(gyro: str, accel: str, range_g: int, crlf: bool) -> None:
    options = {"gyro": gyro, "accel": accel, "accel_range_g": range_g, "crlf": crlf}
    datagram = configuration(msgspec.convert(options, Stim300Options))
    assert len(datagram) == 26 + 2 * crlf
    end = crlf * b"\r\n"
    samples = [sample((n << 10,) * 3, (n << 11,) * 3, counter=n) + end for n in range(4)]
    told = read(datagram + b"".join(samples))[1:]
    assert told == read(datagram + b"".join(samples), **options)[1:]
    assert not any(isinstance(record, Rejected) for record in told)


def test_termination_that_does_not_come_loses_nothing() -> None:
    records = read(3 * sample() + b"-", crlf=True)
    assert [type(record) for record in records] == [*3 * [ImuRecord], Rejected]
    assert [type(record) for record in read(3 * (sample() + b"\r\n"), crlf=True)] == 3 * [ImuRecord]


def test_special_datagrams() -> None:
    part, serial = sealed(b"\xb1" + bytes(15)), sealed(b"\xb5N" + bytes(14))
    trim = sealed(b"\xd1" + bytes(35))
    names = [record.name for record in read(part + serial + trim)]
    assert names == ["part number", "serial number", "bias trim offset"]
    errors = bytearray(b"\xbe" + bytes(16))
    errors[14] = 0x01
    errors[4] = 0x20
    (status,) = read(sealed(bytes(errors)))
    assert isinstance(status, DeviceStatus)
    assert (status.healthy, status.failed) == (False, ("E16", "E101"))
    (well,) = read(sealed(b"\xbe" + bytes(16)))
    assert well.healthy


def test_integrated_outputs_become_mean_rates() -> None:
    """A turn of 3 deg/s read at 500 Hz, wrapping at 4 deg; one datagram lost; one long silence."""
    reader = STIM300.decoder(Stim300Options(gyro="integrated", accel="integrated"))
    records = []
    for n in [*range(700), *range(701, 710), *range(1000, 1003)]:
        turned = round(3.0 * n / 500 * 2**21)
        moved = round(9.8 * n / 500 * 2**22)
        ticks = [(k + (1 << 23)) % (1 << 24) - (1 << 23) for k in (turned, -turned, moved)]
        frame = sample((ticks[0], ticks[1], 0), (0, 0, ticks[2]), counter=4 * n % 256)
        records += reader.feed(frame, n * 2_000_000)
    lost = [n for n, record in enumerate(records) if not record.valid]
    assert lost == [0, 709]
    for record in records:
        if record.valid:
            assert record.rate_rad_s == pytest.approx(
                [math.radians(3), -math.radians(3), 0], rel=1e-3
            )
            assert record.specific_force_m_s2 == pytest.approx([0, 0, 9.8], rel=1e-3)


def test_what_is_beyond_the_range_is_marked_overloaded() -> None:
    record = ImuRecord(
        t_rx_ns=0, rate_rad_s=(math.radians(600), 0, 0), specific_force_m_s2=(0, 0, -9.8)
    )
    (back,) = read(STIM300.encode(record, Stim300Options()))
    assert not back.valid
    assert math.degrees(back.rate_rad_s[0]) == pytest.approx(512)
    assert back.specific_force_m_s2[2] == pytest.approx(-9.8, abs=1e-4)


@pytest.mark.parametrize("temperature", [False, True])
@pytest.mark.parametrize("inclination", [False, True])
@pytest.mark.parametrize("pps", [False, True])
def test_round_trip(temperature: bool, inclination: bool, pps: bool) -> None:
    options = Stim300Options(
        with_inclination=inclination, with_temperature=temperature, with_pps=pps, crlf=True
    )
    record = ImuRecord(
        t_rx_ns=7,
        sequence=511,
        age_s=5e-4,
        rate_rad_s=(0.5, -0.25, 0.125),
        specific_force_m_s2=(1.0, -2.0, 9.8),
        temperature_c=-12.5,
        since_pulse_s=0.125,
    )
    (back,) = read(STIM300.encode(record, options), crlf=True)
    assert (back.sequence, back.age_s) == (255, pytest.approx(5e-4))
    assert back.rate_rad_s == pytest.approx(record.rate_rad_s, abs=1e-6)
    assert back.specific_force_m_s2 == pytest.approx(record.specific_force_m_s2, abs=1e-5)
    assert back.temperature_c == (-12.5 if temperature else None)
    assert back.since_pulse_s == (pytest.approx(0.125) if pps else msgspec.UNSET)


def test_encode_refuses_what_one_record_does_not_hold() -> None:
    record = ImuRecord(t_rx_ns=0, rate_rad_s=(0, 0, 0), specific_force_m_s2=(0, 0, 0))
    for options in ({"gyro": "integrated"}, {"accel": "integrated_g"}, {"gyro": "increment"}):
        with pytest.raises(ValueError, match=r"integrated|does not carry"):
            STIM300.encode(record, msgspec.convert(options, Stim300Options))


def test_counter_runs_at_2000_a_second() -> None:
    counting = STIM300.counting
    counts = [4 * n % counting.sequence_modulus for n in range(200)]
    steps = {(b - a) % counting.sequence_modulus * counting.sequence_s for a, b in pairwise(counts)}
    assert steps == {0.002}
