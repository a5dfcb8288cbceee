"""No shared golden file is left out, and those of formats without a codec are read by none."""

import pytest

from drivers import registry
from drivers.nmea0183 import xor8
from drivers.records import NmeaSentence, Rejected
from tests.golden.usbl_lines import lines, read
from tests.shared_data import ROOT, shared


def test_every_shared_file_is_in_a_test() -> None:
    """By its name, without what it ends in."""
    paths = [path for path in (ROOT / "tests").rglob("*.py") if path.parent.name != "fuzz"]
    tests = "".join(path.read_text() for path in paths)
    held = [shared("captures"), shared("vectors", "imu"), shared("vectors", "usbl")]
    names = {path.name.partition(".")[0] for folder in held for path in folder.iterdir()}
    assert names - {"README"}
    assert {name for name in names - {"README"} if name not in tests} == set()


def test_saab_minipos_is_a_sentence() -> None:
    """A vehicle's own navigation: no codec makes more of it."""
    (told,) = read("nmea0183", *lines("saab_minipos"))
    assert isinstance(told, NmeaSentence)
    assert (told.talker, told.formatter, told.fields[0]) == ("P", "SAAS", "101301.06")


def test_trackpoint() -> None:
    """STANDARD-EC is the parent of TP2; of the other two there is one printed line each."""
    standard, compact, binned = lines("ore_trackpoint")
    (fix,) = read("tracklink-tp2", standard)
    assert (fix.beacon, fix.error_code, fix.xyz_m) == ("1", "50", (169.4, -11.5, 100.0))
    for output in ("tracklink-tp2", "tracklink-lxt"):
        assert [type(record) for record in read(output, compact)] == [Rejected]
    (told,) = read("nmea0183", binned)
    assert (type(told), told.reason) == (Rejected, "checksum")
    assert xor8(binned[1 : binned.index(b"*")]) != 0x16


@pytest.mark.parametrize("name", sorted(registry.CODECS))
def test_a_template_is_no_line(name: str) -> None:
    """EasyTrak AAE: letters where the digits would be, and no captured line."""
    assert {type(record) for record in read(name, *lines("applied_acoustics_aae"))} == {Rejected}
