"""Frames of every codec of inertial units, from its own `encode`."""

import msgspec

from drivers.codec import Codec
from drivers.imu import stim300
from drivers.imu.anpp import ANPP
from drivers.imu.hg4930 import HG4930, Hg4930Options
from drivers.imu.kvh import KVH1750, KvhOptions
from drivers.imu.mip import MIP
from drivers.imu.novatel.logs import NOVATEL_SPAN, NovatelOptions
from drivers.imu.sbg import SBG_ECOM
from drivers.imu.stdbin.telegrams import STDBIN, StdbinOptions
from drivers.imu.stim300 import Stim300Options
from drivers.imu.vectornav import VECTORNAV
from drivers.imu.xsens import XSENS_MTDATA2
from drivers.records import (
    CompensatedRecord,
    DeviceStatus,
    DvlRecord,
    HeadingRecord,
    ImuRecord,
    UsblRecord,
)


def _imu(sequence: int, **more: object) -> ImuRecord:
    return ImuRecord(
        t_rx_ns=0,
        sequence=sequence,
        delta_angle_rad=(1e-5 * sequence, -2e-5, 3e-5),
        specific_force_m_s2=(0.1, -0.2, -9.8),
        **more,
    )


def _kvh() -> list[bytes]:
    encode = KVH1750.encode
    return [
        encode(_imu(1, temperature_c=21.0), KvhOptions()),
        encode(_imu(2, t_device_s=12.000001, temperature_c=-5.0), KvhOptions(format="b")),
        encode(DeviceStatus(t_rx_ns=0, healthy=True), KvhOptions()),
        encode(_imu(3, magnetic_gauss=("z", 0.25)), KvhOptions(format="c")),
        encode(
            DeviceStatus(t_rx_ns=0, healthy=False, failed=("GCB Y volts",)),
            KvhOptions(),
        ),
        encode(_imu(4, temperature_c=22.0), KvhOptions()),
    ]


def _rates(sequence: int, **more: object) -> ImuRecord:
    return ImuRecord(
        t_rx_ns=0,
        sequence=sequence,
        rate_rad_s=(1e-2 * sequence, -2e-2, 3e-2),
        specific_force_m_s2=(0.1, -0.2, -9.8),
        **more,
    )


def _stim300() -> list[bytes]:
    options = Stim300Options()
    full = Stim300Options(with_inclination=True, with_temperature=True, with_pps=True)
    warm = Stim300Options(with_temperature=True)
    return [
        stim300.encode(_rates(250, age_s=506e-6), options),
        stim300.encode(_rates(254, age_s=507e-6, temperature_c=35.5, since_pulse_s=0.25), full),
        stim300.configuration(options),
        stim300.encode(_rates(2, age_s=506e-6, temperature_c=35.5, valid=False), warm),
    ]


def _increments(n: int, **more: object) -> ImuRecord:
    return ImuRecord(
        t_rx_ns=0,
        t_device_s=600_000.0 + 0.01 * n,
        delta_angle_rad=(1e-5 * n, -2e-5, 3e-5),
        delta_velocity_m_s=(1e-3, -2e-3, 0.098),
        **more,
    )


def _novatel() -> list[bytes]:
    encode = NOVATEL_SPAN.encode
    corrected = CompensatedRecord(
        t_rx_ns=0,
        t_device_s=600_000.25,
        delta_angle_rad=(1e-6, 2e-6, -3e-6),
        delta_velocity_m_s=(1e-4, -2e-4, 3e-4),
    )
    return [
        encode(_increments(1), NovatelOptions()),
        encode(_increments(2), NovatelOptions(log="rawimux", imu="kvh1750")),
        encode(_increments(3, valid=False), NovatelOptions(ascii=True)),
        encode(corrected, NovatelOptions()),
        encode(_increments(4), NovatelOptions(log="rawimux", imu="stim300", ascii=True)),
        encode(_increments(5), NovatelOptions(log="rawimu")),
    ]


def _either(codec: Codec, **more: object) -> list[bytes]:
    """Increments and rates in turn, with a sample that is not valid and a warm one."""
    rates = msgspec.convert({"prefer": "rates"}, codec.options)
    return [
        codec.encode(_increments(1, interval_s=0.01, **more), codec.options()),
        codec.encode(_rates(2, t_device_s=12.5, temperature_c=31.5), rates),
        codec.encode(_increments(3, valid=False), codec.options()),
        codec.encode(_rates(4), rates),
    ]


def _rated(codec: Codec) -> list[bytes]:
    return [
        codec.encode(_rates(n, temperature_c=30.0 + n, **more), codec.options())
        for n, more in enumerate(({"t_device_s": 12.5}, {}, {"valid": False}, {}))
    ]


def _hg4930() -> list[bytes]:
    rates = Hg4930Options(prefer="rates")
    return [
        HG4930.encode(_increments(1, temperature_c=-31.0), Hg4930Options()),
        HG4930.encode(_rates(2), rates),
        HG4930.encode(_increments(3, valid=False), Hg4930Options()),
        HG4930.encode(_rates(4, temperature_c=31.0), rates),
        HG4930.encode(_increments(5), Hg4930Options()),
    ]


def _stdbin() -> list[bytes]:
    aided = [
        HeadingRecord(t_rx_ns=0, t_device_s=12.5, heading_deg=123.5, roll_deg=1.5, pitch_deg=-2.5),
        UsblRecord(t_rx_ns=0, t_device_s=12.0, age_s=0.5, beacon="ABC", lat_deg=48.5, lon_deg=-4.5),
        DvlRecord(t_rx_ns=0, t_device_s=12.25, age_s=0.25, velocity_m_s=(1.5, -0.5, 0.25)),
    ]
    return [
        STDBIN.encode(_rates(7, t_device_s=12.5, temperature_c=31.5), StdbinOptions()),
        STDBIN.encode(_rates(8, t_device_s=12.51), StdbinOptions(version=3)),
        *(STDBIN.encode(record, StdbinOptions(version=4)) for record in aided),
        STDBIN.encode(_rates(9, t_device_s=12.52), StdbinOptions()),
    ]


IMU: dict[str, list[bytes]] = {
    "kvh1750": _kvh(),
    "stim300": _stim300(),
    "novatel-span": _novatel(),
    "vectornav": _either(VECTORNAV),
    "xsens-mtdata2": _either(XSENS_MTDATA2, sequence=65535),
    "mip": _either(MIP),
    "sbg-ecom": _rated(SBG_ECOM),
    "anpp": _rated(ANPP),
    "hg4930": _hg4930(),
    "stdbin": _stdbin(),
}
IMU_STRONG = frozenset(IMU)
"""Of these, the codecs whose check finds every single flipped bit."""
