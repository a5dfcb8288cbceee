"""What one count of a raw inertial log is worth, by the type of the unit behind the receiver.

Types as INSCONFIG counts them, scales as NovAtel's own driver has them; its feet are taken as
0.3048 m. The Epson units count rates: theirs are divided by the rate that belongs to the type. For
the two KVH units the driver gives 0.1 / (3600 x 256), the very number it has for the FSAS in
arcseconds, as if it were radians; with that the KVH 1750 could not tell 4 deg/h from nothing, so
they are taken to be degrees here.
"""

from typing import Literal, NamedTuple

from drivers.imu.sample import DEG, G0

ImuName = Literal[
    "hg1700_ag11",
    "hg1700_ag17",
    "hg1900_ca29",
    "ln200",
    "hg1700_ag58",
    "hg1700_ag62",
    "imar_fsas",
    "kvh_cots",
    "hg1930_aa99",
    "isa100c",
    "hg1900_ca50",
    "hg1930_ca50",
    "adis16488",
    "stim300",
    "kvh1750",
    "epson_g320",
    "litef_microimu",
    "stim300d",
    "hg4930_an01",
    "epson_g370",
    "epson_g320_200hz",
    "hg4930_an04",
    "hg4930_an04_400hz",
]


class Scale(NamedTuple):
    """One count, in rad and in m/s, both per sample."""

    gyro_rad: float
    accel_m_s: float


_FOOT = 0.3048
_HG_27 = Scale(2**-33, 2**-27 * _FOOT)
_HG_26 = Scale(2**-33, 2**-26 * _FOOT)
_HG4930 = Scale(2**-33, 2**-29)
_FSAS = Scale(0.1 / 3600 / 2**8 * DEG, 0.05 * 2**-15)
_ISA = Scale(1e-9, 2e-8)
_STIM = Scale(2**-21 * DEG, 2**-22)


def _epson(gyro_deg_s: float, accel_mg: float, rate_hz: float) -> Scale:
    return Scale(gyro_deg_s / 2**16 * DEG / rate_hz, accel_mg / 2**16 * G0 / 1000 / rate_hz)


TYPES: dict[int, tuple[ImuName, Scale]] = {
    1: ("hg1700_ag11", _HG_27),
    4: ("hg1700_ag17", _HG_26),
    5: ("hg1900_ca29", _HG_27),
    8: ("ln200", Scale(2**-19, 2**-14)),
    11: ("hg1700_ag58", _HG_27),
    12: ("hg1700_ag62", _HG_26),
    13: ("imar_fsas", _FSAS),
    16: ("kvh_cots", _FSAS),
    20: ("hg1930_aa99", _HG_27),
    26: ("isa100c", _ISA),
    27: ("hg1900_ca50", _HG_27),
    28: ("hg1930_ca50", _HG_27),
    31: ("adis16488", Scale(720 / 2**31 * DEG, 200 / 2**31)),
    32: ("stim300", _STIM),
    33: ("kvh1750", _FSAS),
    41: ("epson_g320", _epson(0.008, 0.2, 125)),
    52: ("litef_microimu", _ISA),
    56: ("stim300d", _STIM),
    58: ("hg4930_an01", _HG4930),
    61: ("epson_g370", _epson(0.0151515, 0.4, 200)),
    62: ("epson_g320_200hz", _epson(0.008, 0.2, 200)),
    68: ("hg4930_an04", _HG4930),
    69: ("hg4930_an04_400hz", _HG4930),
}
SCALES: dict[ImuName, Scale] = dict(TYPES.values())
NUMBERS = {name: number for number, (name, _) in TYPES.items()}
