"""Frames of acoustic positioning systems, from their makers' documents, logs and drivers."""

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
}
USBL_STRONG: frozenset[str] = frozenset()
"""Of these, the codecs whose check finds every single flipped bit."""
