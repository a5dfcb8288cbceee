"""Frames of receivers, compasses, depth sensors, Doppler logs and long baselines."""

import json
from typing import Any

from msgspec.structs import replace

from drivers import registry
from drivers.records import DvlRecord, LblRecord, LblReply, NmeaSentence

A50_REPORT: dict[str, Any] = {
    "time": 106.3935775756836,
    "vx": -3.713480691658333e-05,
    "vy": 5.703703573090024e-05,
    "vz": 2.4990416932269e-05,
    "fom": 0.00016016385052353144,
    "covariance": [
        [2.4471841442164077e-08, -3.3937477272871774e-09, -1.6659699175747278e-09],
        [-3.3937477272871774e-09, 1.4654466085062268e-08, 4.0409570134514183e-10],
        [-1.6659699175747278e-09, 4.0409570134514183e-10, 1.5971971523143225e-09],
    ],
    "altitude": 0.4949815273284912,
    "transducers": [
        {
            "id": n,
            "velocity": velocity,
            "distance": distance,
            "rssi": -30.494251251220703,
            "nsd": -88.73271179199219,
            "beam_valid": True,
        }
        for n, velocity, distance in (
            (0, 0.00010825289791682735, 0.5568000078201294),
            (1, -1.4719001228513662e-05, 0.5663999915122986),
            (2, 2.7863150535267778e-05, 0.537600040435791),
            (3, 1.9419496311456896e-05, 0.5472000241279602),
        )
    ],
    "velocity_valid": True,
    "status": 0,
    "format": "json_v3",
    "type": "velocity",
    "time_of_validity": 1638191471563017,
    "time_of_transmission": 1638191471752336,
}
"""The report that Water Linked's description of the protocol prints."""


def _heading() -> list[bytes]:
    return [
        b"$HEHDT,116.581,T*25\r\n",
        b"$PRDID,-4.44,2.12,154.25*56\r\n",
        b"$HCHDG,101.1,,,7.1,W*3C\r\n",
        b"$PASHR,085335.00,224.19,T,-01.26,+00.83,+00.00,0.101,0.113,0.267,1,0*36\r\n",
        b"$IIHDM,201.5,M*24\r\n",
    ]


def _depth() -> list[bytes]:
    return [
        b"$SDDPT,14.39,0.00*68\r\n",
        b"$SDDPT,10.1,-1.5,*62\r\n",
        b"$SDDBT,7.8,f,2.4,M,1.3,F*0D\r\n",
        b"$INDPT,2.3,0.0*46\r\n",
    ]


def _gnss() -> list[bytes]:
    return [
        b"$GPGGA,092725.00,4717.11399,N,00833.91590,E,1,08,1.01,499.6,M,48.0,M,,*5B\r\n",
        b"$GPRMC,083559.00,A,4717.11437,N,00833.91522,E,0.004,77.52,091202,,,A*57\r\n",
        b"$GPGGA,,,,,,0,00,99.99,,,,,,*48\r\n",
        b"$GNGNS,103600.01,5114.51176,N,00012.29380,W,ANNN,07,1.18,111.5,45.6,,,V*00\r\n",
        b"$GPVTG,77.52,T,,M,0.004,N,0.008,K,A*06\r\n",
        b"$GPZDA,082710.00,16,09,2002,00,00*64\r\n",
        b"$GPRMC,225446,A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E*68\r\n",
    ]


def _phins() -> list[bytes]:
    return [
        b"$HEHDT,116.581,T*25\r\n",
        b"$PIXSE,SPEED_,0.972,1.082,0.412*61\r\n",
        b"$PIXSE,ATITUD,-1.641,-0.490*6D\r\n",
        b"$PIXSE,DEPIN_,732.811,085832.643253*7D\r\n",
        b"$PIXSE,ALGSTS,00000045,00004000*60\r\n",
    ]


def _nmea() -> list[bytes]:
    made = registry.lookup("nmea0183")
    sentences = (("GP", "HDT", ("123.4", "T")), ("HE", "ROT", ("-0.1", "A")), ("P", "UNAV", ("",)))
    return [
        made.encode(NmeaSentence(t_rx_ns=0, talker=t, formatter=f, fields=x), made.options())
        for t, f, x in sentences
    ] + [b"$GPZDA,160012.71,11,03,2004,-1,00*7D\r\n"]


def _micromodem() -> list[bytes]:
    made = registry.lookup("micromodem")
    replies = tuple(LblReply(beacon=b, one_way_s=t) for b, t in (("A", 0.3125), ("C", 0.28)))
    records = (
        LblRecord(t_rx_ns=0, replies=replies, t_ping_s=36930.25),
        LblRecord(t_rx_ns=0, replies=(LblReply(beacon="3", one_way_s=0.5),)),
        LblRecord(t_rx_ns=0, replies=(), t_ping_s=36940.25),
    )
    return [made.encode(record, made.options()) for record in records]


def _dvl() -> list[DvlRecord]:
    return [
        DvlRecord(
            t_rx_ns=0,
            velocity_m_s=(1.5, -0.25, 0.125),
            altitude_m=12.5,
            t_device_s=1_659_947_538.0,
            age_s=age_s,
            error_velocity_m_s=0.004,
            sound_speed_m_s=1500.0,
        )
        for age_s in (0.125, 0.25, 0.5)
    ] + [DvlRecord(t_rx_ns=0, valid=False, error_code="no_lock", sound_speed_m_s=1490.0)]


def _pd0() -> list[bytes]:
    made = registry.lookup("pd0")
    return [made.encode(record, made.options()) for record in _dvl()]


def line_of(report: dict[str, Any]) -> bytes:
    """A report as the log sends it: in one line."""
    return json.dumps(report, separators=(",", ":")).encode() + b"\r\n"


def _waterlinked() -> list[bytes]:
    answer = {
        "response_to": "get_config",
        "success": True,
        "error_message": "",
        "result": {"speed_of_sound": 1475.0, "mounting_rotation_offset": 20.0},
        "format": "json_v3.1",
        "type": "response",
    }
    lost = A50_REPORT | {"altitude": -1, "velocity_valid": False, "transducers": []}
    return [line_of(report) for report in (A50_REPORT, lost, answer, A50_REPORT)]


NORTEK = b"1452244916.7508,1.234,-1.234,0.1234,0.1234,0.1234,12.34,23.45,23.45,23.45,23.45"
"""What a public reader's test prints as the fields of PNORBT7, and PNORBT9's first ones."""


def _nortek() -> list[bytes]:
    made = registry.lookup("nortek-dvl")
    moving = DvlRecord(
        t_rx_ns=0,
        age_s=0.0625,
        velocity_m_s=(1.5, -0.25, 0.125),
        t_device_s=1.7e9,
        altitude_m=12.5,
        sd_m_s=(0.0625,) * 3,
    )
    return [
        made.encode(moving, made.options()),
        b"$PNORBT7," + NORTEK + b"*39\r\n",
        b"$PNORBT9," + NORTEK + b",23.4,1567.8,1.2,12.3,0x000FFFFF*1E\r\n",
        made.encode(replace(moving, sound_speed_m_s=1490.5), made.options()),
    ]


def _pd6() -> list[bytes]:
    """What the maker of another log prints of it, and Teledyne's own without blanks."""
    return [
        b":BI,  +123,  -420, +2000,    +0,A\r\n",
        b":SA, +0.00, +0.00,  0.00\r\n",
        b":TS,22020812061800, 0.0, +0.0,   0.0,1475.0,  0\r\n",
        b":BI,-32768,-32768,-32768,-32768,V\r\n",
        b":BS,  -420,  +123, +2000,A\r\n",
        b":BE,+00000,-02345,-00439,A\r\n",
        b":BD,       +0.00,       +0.00,       +0.00,   5.32,  0.00\r\n",
        b":WI,+00000,+00000,+00000,+00000,V\r\n",
        b":BD,+00000000.00,+00000000.00,+00000000.00,0000.00,000.00\r\n",
    ]


def _paroscientific() -> list[bytes]:
    return [
        b"*000114.6959494\r\n",
        b"*0001114.6190\r\n",
        b"*0001UN=1\r\n",
        b"*0002998.25\r\n",
    ]


AIDING: dict[str, list[bytes]] = {
    "nmea-gnss": _gnss(),
    "phins": _phins(),
    "nmea0183": _nmea(),
    "nmea-heading": _heading(),
    "nmea-depth": _depth(),
    "nmea-bus": [*_gnss(), *_heading(), *_depth()],
    "paroscientific": _paroscientific(),
    "micromodem": _micromodem(),
    "pd0": _pd0(),
    "pd6": _pd6(),
    "nortek-dvl": _nortek(),
    "waterlinked-dvl": _waterlinked(),
}
AIDING_STRONG = frozenset(AIDING) - {"paroscientific", "pd6", "waterlinked-dvl"}
"""Of these, the codecs whose check finds every single flipped bit."""
