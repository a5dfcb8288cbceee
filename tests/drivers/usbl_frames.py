"""Frames of acoustic positioning systems, from their makers' documents, logs and drivers."""

from drivers import registry
from drivers.records import UsblRecord

OUTPUTS = ("lxt", "tp2", "gll", "log")
"""Of TrackLink."""


def _seatrac() -> list[bytes]:
    """None of a real beacon was found."""
    made = registry.lookup("seatrac")
    records = (
        UsblRecord(
            t_rx_ns=0, beacon="2", bearing_deg=53.1, elevation_deg=-45.5, slant_range_m=70.7
        ),
        UsblRecord(t_rx_ns=0, beacon="3", slant_range_m=70.8),
        UsblRecord(t_rx_ns=0, beacon="4", valid=False, error_code="no_reply"),
    )
    return [made.encode(record, made.options()) for record in records]


def _tracklink(codec: str) -> list[bytes]:
    made = registry.lookup(codec)
    records = (
        UsblRecord(
            t_rx_ns=0,
            beacon=beacon,
            bearing_deg=53.1,
            elevation_deg=-45.0,
            slant_range_m=70.7,
            xyz_m=(30.0, 40.0, 50.0),
            t_device_s=t_s,
            lat_deg=-33.375,
            lon_deg=151.25,
            depth_m=50.0,
        )
        for beacon, t_s in (("1", 10.0), ("2", 11.0), ("3", 12.0), ("4", 13.0))
    )
    return [made.encode(record, made.options()) for record in records]


USBL: dict[str, list[bytes]] = {
    "evologics": [
        b"+++AT:118:USBLLONG,455.600823,455.346033,1,1.2601,0.9197,-0.3958,1.2601,0.9197,-0.3958,"
        b"0.0000,-0.0000,0.0000,1073,-37,146,0.0022\r\n",
        b"USBLANGLES,10.250000,10.125000,2,-0.7854,-0.5236,-0.7854,-0.5236,0.0000,0.0000,0.0000,"
        b"-40,150,0.0100\r\n",
        b"+++AT:99:USBLPHYD,10446.992626,10446.534642,3,0,-39278,-10591,16777215,-12608,-27941,"
        b"23818,16777215,16777215\r\n",
        b"RECVIM,5,3,1,noack,182272,-36,77,-0.2500,a\r\n,\xff\r\n",
        b"+++AT:23:SENDSTART,3,im,182272,0\r\n",
        b"USBLLONG,1377811852.499612,1377811852.365264,2,1099.5699,-1000.1375,2.3383,1000.1375,"
        b"-1099.5699,-2.3382,3.1416,-0.0000,-1.5708,990922,-40,120,0.0001\r\n",
    ],
    "psimssb": [
        b"$PSIMSSB,083733.386,M17,A,,C,N,F,46.649,1.632,24.829,1.414,T,0.033681,*54\r\n",
        b"$PSIMSSB,180554.432,M44,A,,C,N,M,-61.300,39.017,34.026,0.072,T,0.050576,*47\r\n",
        b"$PSIMSNS,075617.446,,1,1,-1.27,-1.13,-0.04,250.87,,a0,0.000,,M121*59\r\n",
        b"$PSIMSSB,094532.523,M17,V,NRy,C,N,M,,,,,T,0.002245,*25\r\n",
        b"$PSIMSSB,083733.036,M17,A,NRy,C,N,F,0.000,0.000,0.000,20.000,T,0.003731,*08\r\n",
        b"$PSIMSSB,120000.500,B12,A,,C,H,M,-40.000,30.000,50.000,0.5,N,,*4F\r\n",
    ],
    "gaps": [
        b"$PTSAX,#2383172,071216.870,05,04,2018,4,-412.45,526.85,F,0631.8,1,9999.0*23\r\n",
        b"$PTSAG,#2374110,055648.831,05,04,2018,0,2718.19917,N,01747.61373,W,F,0005.8,1,9999.0*39"
        b"\r\n",
        b"$PTSAY,#2383173,071216.870,05,04,2018,4,-651.98,150.33,F,0631.8,1,9999.0*2E\r\n",
        b"$PTSAG,#02754,043516.771,14,07,2016,0,2640.20937,N,12751.97519,E,F,0000.0,0,0000.0*2A"
        b"\r\n",
        b"$PTSAH,0,359.671,0.000*4D\r\n",
    ],
    "psonlld": [
        b"$PSONLLD,170004.53,ALVIN 914,A,28.8114807,-87.80925696,1951.156,13.96,13.96,0.00,2.62,,,,"
        b"*6F\r\n",
        b"$PSONALL,Ship 1,CRP,134446.175,650879.00,5688874.16,0.00,180.00,,G,0.00,0.00,,0.109,"
        b"0.001*51\r\n",
        b"$PSONLLD,170005.53,ALVIN 914,V,,,,,,,,,,,*7B\r\n",
        b"$PSONLLD,133707.59,Ship 1,A,51.3306281,-0.83499295,0.000,0.08,0.08,0.00,0.01,,,,*1D\r\n",
    ],
    "pazm3": [
        b"$PAZM3,1,0,0,38,23.8,0.080975,115.3,113.0,22.8,325.8,11.4,1147.22,4.5,,2.6,-2.9*0E\r\n",
        b"$PAZM3,2,5,0,0,,,,,,,,,,,,*32\r\n",
        b"$PAZM3,1,2,0,38,21.0,0.333333,500.0,433.0,250.0,90.0,30.0,1147.22,4.5,,2.6,-2.9*0C\r\n",
    ],
    "usrth": [
        b"$USRTH,358.5,1.5,2.8,142.8,52.8,37.2,2.8,-0.6,1.9,178.1,271.9,16*49\r\n",
        b"$USRTH,120.5,239.5,-30.5,70.5,210.5,239.5,-30.5,0.0,0.0,0.0,0.0,0*64\r\n",
        b"$USRTH,358.5,1.5,2.8,142.8,52.8,37.2,2.8,-0.6,1.9,178.1,271.9,16,T,T,1,3313,B,-2,-2*14"
        b"\r\n",
        b"$USRTH,358.5,1.5,2.8,,52.8,37.2,2.8,-0.6,1.9,178.1,271.9,16*68\r\n",
    ],
    **{f"tracklink-{output}": _tracklink(f"tracklink-{output}") for output in OUTPUTS},
    "seatrac": _seatrac(),
    "micronnav": [
        b"%D0033082031,0,-18686,+4764,+4100,0.8,30,15315632\r\n",
        b"%D0049082001000-0000018686+0000004764+0000004100+0.80000E+0003015315632\r\n",
        b"%D0030082031,3,+500,-4764,+100,2.5,14,15315782\r\n",
        b"%D003E082030,0,+503868.427,6025011.669,+4102,0.8,30,15315632\r\n",
    ],
}
USBL_STRONG = frozenset({"psimssb", "gaps", "psonlld", "usrth"})
"""Of these, the codecs whose check finds every single flipped bit."""
