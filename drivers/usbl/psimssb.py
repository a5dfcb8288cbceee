"""Kongsberg HiPAP, HPR 400 and what speaks like them: ``$PSIMSSB`` and ``$PSIMSNS``.

``$PSIMSSB,time,beacon,status,error,system,orientation,filter,x,y,depth,accuracy,info,v,w*hh``
    One fix. System ``C`` cartesian, ``P`` polar (horizontal range m, bearing deg) or ``U`` UTM;
    orientation ``H`` the vessel's head, ``N`` north or ``E`` east; filter ``M`` measured, ``F``
    filtered, ``P`` predicted; info ``T``: v is the sound's one way to the transducer (s).

    ====== =============================
    C, H   x to starboard, y forward
    C, N   x north, y east
    C, E   x east, y north
    P, H   x range, y bearing off the head
    P, N   x range, y bearing off north
    U, N   x northing, y easting
    U, E   x easting, y northing
    ====== =============================

``$PSIMSNS,time,item,transceiver,transducer,roll,pitch,heave,heading,tag,params,age,,id*hh``
    What the attitude sensors told when the reply came; roll positive starboard down, pitch bow up.

Every other sentence comes out as it is.
"""

from math import cos, radians, sin

import msgspec
from msgspec import UNSET, UnsetType

from drivers.codec import Codec, Counting, Decoder
from drivers.fields import clock, maybe, number, plain, seconds_of_day
from drivers.framing import UnreadableError
from drivers.nmea0183 import Checksum
from drivers.records import HeadingRecord, NmeaSentence, Record, UsblRecord, Vec3
from drivers.sentences import Fields, Heard, Reader, expect, table_decoder, written
from drivers.usbl.geometry import place, polar

LONGEST = 120
TRAVEL_MAX_S = 60.0
_MODES = frozenset({"CH", "CN", "CE", "PH", "PN", "UN", "UE"})
_ERRORS = frozenset(
    ("NRy", "AmX", "AmY", "Rej", "Mi2", "Mi3", "Pre", "VRU", "GYR", "ATT", "ExD", "ExM", "???")
)


class PsimssbOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the topside was set to do before it speaks.

    With ``levelled`` it has taken roll and pitch out, as the maker's description says; without, a
    fix by the vessel's head is one in the array's axes. ``filtered`` says whether fixes of its
    filter, each of which depends on those before it, are good ones.
    """

    checksum: Checksum = "required"
    levelled: bool = True
    filtered: bool = True


def decoder(options: PsimssbOptions) -> Decoder:
    """Make a decoder of a topside's sentences."""
    return table_decoder(_READERS, options, options.checksum)


def encode(record: Record, options: PsimssbOptions) -> bytes:
    """Write a fix as cartesian PSIMSSB, attitude as PSIMSNS.

    Raises
    ------
    ValueError
        If neither can say the record.
    """
    match record:
        case NmeaSentence():
            address = record.talker + record.formatter
            return written(address, record.fields, options.checksum, LONGEST)
        case HeadingRecord(
            heading_deg=float(heading_deg), roll_deg=float(roll_deg), pitch_deg=float(pitch_deg)
        ):
            attitude = [plain(roll_deg, 2), plain(pitch_deg, 2), "0.00", plain(heading_deg, 2)]
            fields = [
                clock(record.t_device_s, 3),
                "",
                "1",
                "1",
                *attitude,
                "",
                "0",
                "0.000",
                "",
                "",
            ]
            return written("PSIMSNS", fields, options.checksum, LONGEST)
        case UsblRecord():
            return written("PSIMSSB", _ssb_fields(record), options.checksum, LONGEST)
    raise ValueError(f"psimssb cannot say this {type(record).__name__}")


def _ssb(fields: Fields, options: PsimssbOptions, heard: Heard) -> Record:
    expect(fields, 14)
    time, beacon, status, error, system, orientation, kind, x, y, depth, _, info, value, _ = fields
    if not beacon or status not in ("A", "V") or kind not in ("M", "F", "P"):
        raise UnreadableError("syntax", "no beacon, status or filter")
    if system + orientation not in _MODES:
        raise UnreadableError("syntax", f"{system} and {orientation} are no coordinates")
    fault = _fault(status, error, kind, options)
    xyz_m: Vec3 | None = None
    depth_m: float | UnsetType = UNSET
    bearing_deg = elevation_deg = slant_m = None
    if system == "U":
        # The zone is not in the sentence: a place nobody can find is no fix.
        depth_m = number(depth) if depth else UNSET
        fault = fault or "utm"
    elif x or y or depth or fault is None:
        xyz_m = _place(system + orientation, number(x), number(y), number(depth))
        bearing_deg, elevation_deg, slant_m = polar(xyz_m)
    return UsblRecord(
        **heard,
        beacon=beacon,
        bearing_deg=bearing_deg,
        elevation_deg=elevation_deg,
        slant_range_m=slant_m,
        xyz_m=xyz_m,
        t_device_s=seconds_of_day(time) if time else None,
        valid=fault is None,
        error_code=fault,
        axes="north" if orientation != "H" else "level" if options.levelled else "array",
        depth_m=depth_m,
        one_way_s=number(value, 0, TRAVEL_MAX_S) if info == "T" and value else UNSET,
    )


def _fault(status: str, error: str, kind: str, options: PsimssbOptions) -> str | None:
    """Status A does not tell a fresh measurement: without a reply it stays A for a while."""
    if error:
        return error
    if status == "V":
        return "V"
    if kind == "P":
        return "predicted"
    return "filtered" if kind == "F" and not options.filtered else None


def _place(mode: str, x: float, y: float, depth: float) -> Vec3:
    if mode[0] == "P":
        if not (x >= 0 and 0 <= y <= 360):
            raise UnreadableError("range", f"no range {x} m and bearing {y} deg")
        return x * cos(radians(y)), x * sin(radians(y)), depth
    return (x, y, depth) if mode == "CN" else (y, x, depth)


def _sns(fields: Fields, _options: PsimssbOptions, heard: Heard) -> HeadingRecord:
    expect(fields, 13)
    heading_deg = maybe(fields[7], 0, 360)
    return HeadingRecord(
        **heard,
        heading_deg=heading_deg,
        roll_deg=maybe(fields[4], -180, 180),
        pitch_deg=maybe(fields[5], -90, 90),
        t_device_s=seconds_of_day(fields[0]) if fields[0] else None,
        valid=heading_deg is not None,
    )


def _ssb_fields(record: UsblRecord) -> list[str]:
    fault = None if record.valid else record.error_code or "???"
    status = "A" if fault in (None, "predicted", "filtered") else "V"
    error = fault if fault in _ERRORS else ""
    kind = {"predicted": "P", "filtered": "F"}.get(fault or "", "M")
    xyz_m = place(record)
    if xyz_m is None and record.valid:
        raise ValueError("psimssb needs a place of the beacon")
    x, y, z = (None, None, None) if xyz_m is None else xyz_m
    orientation = "N" if record.axes == "north" else "H"
    if orientation == "H":
        x, y = y, x
    told = record.one_way_s is not UNSET
    info = ["T", f"{record.one_way_s:.6f}", ""] if told else ["N", "", ""]
    return [
        *(clock(record.t_device_s, 3), record.beacon, status, error or "", "C", orientation, kind),
        *(plain(x, 3), plain(y, 3), plain(z, 3), "", *info),
    ]


_READERS: dict[str, Reader] = {"PSIMSSB": _ssb, "PSIMSNS": _sns}

PSIMSSB = Codec(
    name="psimssb",
    kind="usbl",
    devices="Kongsberg HiPAP, HPR 400 and other makes: PSIMSSB, PSIMSNS",
    options=PsimssbOptions,
    decoder=decoder,
    encode=encode,
    counting=Counting(time_modulus_s=86_400.0),
    also=("heading",),
)
