"""TrackLink lines: limits, signs, axes, agreement of bearing, range and XYZ, error codes."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import registry
from drivers.records import Record, Rejected, UsblRecord


def read(name: str, line: str, **options: object) -> Record | Rejected:
    codec = registry.lookup(f"tracklink-{name}")
    reader = codec.decoder(msgspec.convert(options, codec.options))
    records = [*reader.feed(line.encode() + b"\r\n", 0), *reader.close()]
    assert len(records) == 1
    return records[0]


def write(name: str, record: UsblRecord, **options: object) -> str:
    codec = registry.lookup(f"tracklink-{name}")
    line = codec.encode(record, msgspec.convert(options, codec.options)).decode()
    assert line.endswith("\r\n")
    return line[:-2]


def reason(name: str, line: str, **options: object) -> str:
    record = read(name, line, **options)
    assert isinstance(record, Rejected), record
    return record.reason


def test_lxt_signs() -> None:
    record = read("lxt", "1  206.2 225.6 11.4                      ")
    assert record.beacon == "1"
    assert record.slant_range_m == 206.2
    assert record.bearing_deg == -134.4
    assert record.elevation_deg == -11.4
    assert record.valid
    assert record.axes == "array"
    assert read("lxt", "1  206.2 180.0  0.0").bearing_deg == 180.0
    assert math.copysign(1, read("lxt", "1  206.2 180.0  0.0").elevation_deg) == 1
    assert read("lxt", "1  206.2 225.6 11.4", bearing_reference="north").axes == "north"


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("1 10000.0 225.6 11.4", "range"),
        ("1 -1.0 225.6 11.4", "range"),
        ("1 206.2 360.0 11.4", "range"),
        ("1 206.2 -0.1 11.4", "range"),
        ("1 206.2 225.6 90.0", "range"),
        ("1 206.2 225.6 -0.1", "range"),
        ("1 206.2 225.6", "syntax"),
        ("1 206.2 225.6 11.4 5.0", "syntax"),
        ("x 206.2 225.6 11.4", "syntax"),
        ("1 2e2 225.6 11.4", "syntax"),
        ("1 nan 225.6 11.4", "syntax"),
        ("1 206. 225.6 11.4", "syntax"),
        ("1 2_0 225.6 11.4", "syntax"),
        ("1 206.2 225.6 ١١.4", "syntax"),
        ("1 " + "9" * 20 + " 225.6 11.4", "range"),
    ],
)
def test_lxt_refuses(line: str, why: str) -> None:
    assert reason("lxt", line) == why


@pytest.mark.parametrize(("slant", "code"), [("9999.9", "full_scale"), ("   0.0", "no_range")])
def test_lxt_without_a_range_is_no_fix(slant: str, code: str) -> None:
    record = read("lxt", f"1 {slant} 225.6 11.4")
    assert (record.valid, record.error_code) == (False, code)


def test_lxt_cut_line_does_not_lend_its_digit() -> None:
    line = "2  206.2 225.6 11.4                      "
    assert len(line) == 41
    codec = registry.lookup("tracklink-lxt")
    found = list(codec.decoder(codec.options()).feed(f"1{line}\r\n".encode(), 0))
    assert [type(record) for record in found] == [Rejected, UsblRecord]
    assert found[1].beacon == "2"


def test_lxt_writes_its_columns() -> None:
    record = UsblRecord(
        t_rx_ns=0, beacon="1", bearing_deg=-0.04, elevation_deg=-89.97, slant_range_m=5.0
    )
    assert write("lxt", record) == "1    5.0   0.0 89.9".ljust(41)
    up = msgspec.structs.replace(record, elevation_deg=1.0)
    far = msgspec.structs.replace(record, slant_range_m=12000.0)
    for wrong in (up, far, msgspec.structs.replace(record, slant_range_m=None)):
        with pytest.raises(ValueError, match=r"tracklink-lxt|columns"):
            write("lxt", wrong)


TP2 = "1 11:08:51 0   229.4   199.7    -10.8     -9.3   199.2      0.0   "


def test_tp2_axes() -> None:
    assert read("tp2", TP2).xyz_m == (-9.3, -10.8, 199.2)
    turned = read("tp2", TP2, axes="forward_starboard_down")
    assert turned.xyz_m == (-10.8, -9.3, 199.2)
    assert turned.error_code == "inconsistent"
    assert read("tp2", TP2, bearing_reference="north").axes == "north"


def test_tp2_writes_its_golden_columns() -> None:
    assert write("tp2", read("tp2", TP2)) == TP2


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (TP2.replace("229.4", "230.9"), "inconsistent"),
        (TP2.replace("199.7", "200.9"), "inconsistent"),
        (TP2.replace("229.4", "229.9"), None),
        (TP2[:-2] + "50", "50"),
        (TP2[:-2] + " 0", None),
        (TP2[:-2] + "00", None),
        ("1 11:08:51 0 0.0 0.0 0.0 0.0 0.0 0.0", "no_range"),
    ],
)
def test_tp2_validity(line: str, code: str | None) -> None:
    record = read("tp2", line)
    assert isinstance(record, UsblRecord)
    assert (record.valid, record.error_code) == (code is None, code)


def test_tp2_tolerances_are_options() -> None:
    bad = TP2.replace("229.4", "230.9").replace("199.7", "200.9")
    assert read("tp2", bad, bearing_tolerance_deg=2.0, range_tolerance_m=1.5).valid
    assert not read("tp2", bad, bearing_tolerance_deg=2.0).valid


@pytest.mark.parametrize("blank", [slice(11, 14), slice(55, 63), slice(11, 12)])
def test_tp2_blank_reserved_field_falls_back_to_columns(blank: slice) -> None:
    columns = list(TP2)
    columns[blank] = " " * (blank.stop - blank.start)
    wanted = read("tp2", TP2)
    assert read("tp2", "".join(columns)) == wanted
    columns[-2:] = "50"
    assert read("tp2", "".join(columns)).error_code == "50"


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (TP2.replace("11:08:51", "25:08:51"), "range"),
        (TP2.replace("11:08:51", "11-08-51"), "syntax"),
        (TP2.replace("229.4", "361.0"), "range"),
        (TP2.replace("  199.7", " -199.7"), "range"),
        (TP2.replace("-10.8", "-1O.8"), "syntax"),
        ("1 11:08:51", "syntax"),
    ],
)
def test_tp2_refuses(line: str, why: str) -> None:
    assert reason("tp2", line) == why


@given(
    st.floats(-math.pi, math.pi),
    st.floats(0.02, math.pi / 2 - 0.001),
    st.floats(1.0, 5000.0),
    st.integers(0, 1),
)
def test_rounded_geometry_always_agrees(
    bearing: float, depression: float, slant: float, decimals: int
) -> None:
    """Coarse coordinates at short range must not look like a fault."""
    x = slant * math.cos(depression) * math.cos(bearing)
    y = slant * math.cos(depression) * math.sin(bearing)
    z = slant * math.sin(depression)
    angle = round(math.degrees(bearing) % 360, 1)
    xyz = " ".join(f"{value:.{decimals}f}" for value in (y, x, z))
    line = f"1 11:08:51 0 {angle:.1f} {slant:.1f} {xyz} 0.0"
    record = read("tp2", line)
    assert isinstance(record, UsblRecord)
    assert record.valid, (line, record)


def test_gll() -> None:
    record = read("gll", "$GPGLL,4916.45,N,12311.12,W,225444,A", beacon="7")
    assert (record.beacon, record.valid, record.t_device_s) == ("7", True, 82484.0)
    assert record.lat_deg == pytest.approx(49 + 16.45 / 60)
    assert record.lon_deg == pytest.approx(-(123 + 11.12 / 60))
    assert write("gll", record) == "$GPGLL,4916.45,N,12311.12,W,225444,A"


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("$GPGLL,4916.45,N,12311.12,W,225444,A*32", "checksum"),
        ("$GPGGA,4916.45,N,12311.12,W,225444,A", "unknown"),
        ("$GPGLL,4916.45,N,12311.12,W,225444", "syntax"),
        ("$GPGLL,4916.45,E,12311.12,W,225444,A", "syntax"),
        ("$GPGLL,9016.45,N,12311.12,W,225444,A", "range"),
        ("$GPGLL,4916.45,N,12311.12,W,245444,A", "range"),
        ("$GPGLL,,,,,225444,A", "syntax"),
        ("1  206.2 225.6 11.4", "syntax"),
    ],
)
def test_gll_refuses(line: str, why: str) -> None:
    assert reason("gll", line) == why


def test_gll_without_a_fix() -> None:
    record = read("gll", "$GPGLL,,,,,,V")
    assert (record.valid, record.error_code, record.t_device_s) == (False, "V", None)
    assert record.lat_deg is msgspec.UNSET
    assert write("gll", record) == "$GPGLL,,,,,,V"
    held = read("gll", "$GPGLL,4916.45,N,12311.12,W,225444,A*31")
    assert held.valid


LOG = (
    "3 0 2005 7 14 9 30 15 50.0 306.9 -40.0 30.0 20.0 1 -3322.5000 15112.0000 1 90.0 1 "
    "-3322.4838 15111.9742 5385 0 1 -1.5 0.5 0 0 0 0 0"
)


def test_log() -> None:
    record = read("log", LOG)
    assert record == UsblRecord(
        t_rx_ns=0,
        line_bytes=len(LOG) + 2,
        beacon="3",
        bearing_deg=-53.1,
        elevation_deg=math.degrees(math.atan2(-20.0, 50.0)),
        slant_range_m=53.85,
        xyz_m=(30.0, -40.0, 20.0),
        t_device_s=1121333415.0,
        lat_deg=-(33 + 22.4838 / 60),
        lon_deg=151 + 11.9742 / 60,
        depth_m=20.0,
    )


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("3 0 2005", "3 4 2005", "4"),
        (" 306.9 ", " 300.0 ", "inconsistent"),
        ("5385", "0", "no_range"),
    ],
)
def test_log_validity(old: str, new: str, code: str) -> None:
    record = read("log", LOG.replace(old, new))
    assert (record.valid, record.error_code) == (False, code)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (" 7 14 ", " 13 14 ", "range"),
        (" 9 30 15 ", " 9 30 61 ", "range"),
        ("2005", "9" * 30, "range"),
        ("-3322.4838", "-3360.0000", "range"),
        ("15111.9742", "18000.0001", "range"),
        (" 0 0 0 0 0", " 0 0 0 0", "syntax"),
        ("-40.0", "-4O.0", "syntax"),
    ],
)
def test_log_refuses(old: str, new: str, why: str) -> None:
    assert reason("log", LOG.replace(old, new)) == why


def test_log_separates_with_tabs_too() -> None:
    assert read("log", LOG.replace(" ", "\t")).beacon == "3"


@pytest.mark.parametrize("name", ["lxt", "tp2", "gll", "log"])
def test_encoders_name_what_is_missing(name: str) -> None:
    with pytest.raises(ValueError, match=f"tracklink-{name}"):
        write(name, UsblRecord(t_rx_ns=0, beacon="1"))


@pytest.mark.parametrize("name", ["lxt", "tp2", "log"])
@pytest.mark.parametrize("beacon", ["B1", "1234", ""])
def test_encoders_know_only_numbered_targets(name: str, beacon: str) -> None:
    fix = UsblRecord(
        t_rx_ns=0,
        beacon=beacon,
        bearing_deg=0.0,
        elevation_deg=-1.0,
        slant_range_m=5.0,
        xyz_m=(5.0, 0.0, 0.1),
    )
    with pytest.raises(ValueError, match="target number"):
        write(name, fix)
