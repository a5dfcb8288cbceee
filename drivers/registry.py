"""Names of wire formats and where each one lives; a codec is imported when first asked for."""

from contextlib import suppress
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

from drivers.codec import Codec

GROUP = "usblnav.codecs"
"""Entry-point group through which other packages add codecs; a name belongs to its first owner."""

CODECS: dict[str, str] = {
    "kvh1750": "drivers.imu.kvh:KVH1750",
    "stim300": "drivers.imu.stim300:STIM300",
    "novatel-span": "drivers.imu.novatel.logs:NOVATEL_SPAN",
    "vectornav": "drivers.imu.vectornav:VECTORNAV",
    "xsens-mtdata2": "drivers.imu.xsens:XSENS_MTDATA2",
    "mip": "drivers.imu.mip:MIP",
    "sbg-ecom": "drivers.imu.sbg:SBG_ECOM",
    "anpp": "drivers.imu.anpp:ANPP",
    "hg4930": "drivers.imu.hg4930:HG4930",
    "stdbin": "drivers.imu.stdbin.telegrams:STDBIN",
    "tracklink-lxt": "drivers.usbl.tracklink.lxt:LXT",
    "tracklink-tp2": "drivers.usbl.tracklink.tp2:TP2",
    "tracklink-gll": "drivers.usbl.tracklink.gll:GLL",
    "tracklink-log": "drivers.usbl.tracklink.log:LOG",
    "evologics": "drivers.usbl.evologics:EVOLOGICS",
    "psimssb": "drivers.usbl.psimssb:PSIMSSB",
    "gaps": "drivers.usbl.gaps:GAPS",
    "psonlld": "drivers.usbl.sonardyne:PSONLLD",
    "pazm3": "drivers.usbl.zima:PAZM3",
    "usrth": "drivers.usbl.cerulean:USRTH",
    "seatrac": "drivers.usbl.seatrac:SEATRAC",
    "micronnav": "drivers.usbl.micronnav:MICRONNAV",
    "micromodem": "drivers.lbl.micromodem:MICROMODEM",
    "nmea-gnss": "drivers.gnss.nmea:NMEA_GNSS",
    "phins": "drivers.heading.phins:PHINS",
    "nmea-heading": "drivers.heading.nmea:NMEA_HEADING",
    "nmea-depth": "drivers.depth.nmea:NMEA_DEPTH",
    "nmea-bus": "drivers.nmea_bus:NMEA_BUS",
    "pd0": "drivers.dvl.pd0:PD0",
    "pd6": "drivers.dvl.pd6:PD6",
    "nortek-dvl": "drivers.dvl.nortek:NORTEK",
    "waterlinked-dvl": "drivers.dvl.waterlinked:WATERLINKED",
    "paroscientific": "drivers.depth.paroscientific:PAROSCIENTIFIC",
    "nmea0183": "drivers.nmea0183:NMEA0183",
}


class UnknownCodecError(KeyError):
    """No codec has this name; the message offers the names that look like it."""

    def __init__(self, name: str, known: list[str]) -> None:
        super().__init__(name)
        self.name = name
        self.known = known

    def __str__(self) -> str:
        near = get_close_matches(self.name, self.known, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(self.known)}"
        return f'no codec is called "{self.name}"; {hint}'


class CodecImportError(ImportError):
    """A codec another package announces could not be used."""


def names() -> list[str]:
    """Names of all codecs, built-in and installed, sorted; imports none of them."""
    return sorted({*CODECS, *_installed()})


def conflicts() -> list[str]:
    """What installed packages announce under names that are taken, a line each."""
    return [
        f'codec "{point.name}" ({_origin(point)}): the name is taken'
        for point in _announced()
        if point.name in CODECS or _installed()[point.name] != point
    ]


def lookup(name: str) -> Codec:
    """Give the codec called `name`, importing it now.

    Raises
    ------
    UnknownCodecError
        If neither this package nor an installed one provides the name.
    CodecImportError
        If an installed package announces the name but does not deliver a `Codec` of that name.
    """
    if name in CODECS:
        module, _, attribute = CODECS[name].partition(":")
        codec: Codec = getattr(import_module(module), attribute)
        return codec
    point = _installed().get(name)
    if point is None:
        raise UnknownCodecError(name, names())
    return _load(point)


def all_codecs() -> list[Codec]:
    """Every codec that can be had, sorted by name; imports them all."""
    found = []
    for name in names():
        with suppress(CodecImportError):
            found.append(lookup(name))
    return found


def _announced() -> list[EntryPoint]:
    """In an order that does not depend on where the packages lie."""
    return sorted(entry_points(group=GROUP), key=lambda point: (point.name, _origin(point)))


def _installed() -> dict[str, EntryPoint]:
    return {point.name: point for point in reversed(_announced())}


def _origin(point: EntryPoint) -> str:
    package = f"{point.dist.name} {point.dist.version}" if point.dist else "no package"
    return f"{point.value} of {package}"


def _load(point: EntryPoint) -> Codec:
    try:
        codec = point.load()
    except Exception as error:  # another's module may raise anything
        said = f"{type(error).__name__}: {error}".splitlines()[0]
        raise CodecImportError(f'codec "{point.name}" ({_origin(point)}): {said}') from error
    if not isinstance(codec, Codec):
        wrong = "is not a drivers.codec.Codec"
    elif codec.name != point.name:
        wrong = f'calls itself "{codec.name}"'
    else:
        return codec
    raise CodecImportError(f'codec "{point.name}" ({_origin(point)}) {wrong}')
