"""The TrackLink lines of the shared vectors decode to what they say."""

import math

import pytest

from drivers import registry
from drivers.records import Rejected, UsblRecord
from tests.shared_data import shared


def fixes(name: str, file: str) -> list[UsblRecord]:
    """Records of the sentences in a file; its comment lines must all be rejected."""
    raw = shared("vectors", "usbl", f"{file}.txt").read_bytes()
    codec = registry.lookup(name)
    reader = codec.decoder(codec.options())
    records = [*reader.feed(raw.replace(b"\n", b"\r\n"), 0), *reader.close()]
    rejected = [record.data for record in records if isinstance(record, Rejected)]
    assert rejected == [line + b"\r\n" for line in raw.splitlines() if line.startswith(b"#")]
    return [record for record in records if isinstance(record, UsblRecord)]


def test_lxt_mask() -> None:
    """The guide's mask shows each field at its full scale: decoded, but never a good fix."""
    (fix,) = fixes("tracklink-lxt", "tracklink_lxt")
    assert fix.beacon == "1"
    assert fix.slant_range_m == 9999.9
    assert fix.bearing_deg == 359.9 - 360 or fix.bearing_deg == pytest.approx(-0.1, abs=1e-9)
    assert fix.elevation_deg == -89.9
    assert (fix.valid, fix.error_code) == (False, "full_scale")


def test_tp2() -> None:
    track, ore, micronav = fixes("tracklink-tp2", "tracklink_tp2")

    assert (track.beacon, track.valid, track.error_code) == ("1", True, None)
    assert track.t_device_s == 11 * 3600 + 8 * 60 + 51
    assert track.bearing_deg == pytest.approx(229.4 - 360)
    assert track.slant_range_m == 199.7
    assert track.xyz_m == (-9.3, -10.8, 199.2)
    # The sentence agrees with itself, which settles the axes: X is to starboard.
    assert math.degrees(math.atan2(track.xyz_m[1], track.xyz_m[0])) % 360 == pytest.approx(
        229.27, abs=0.01
    )
    assert track.elevation_deg == pytest.approx(-math.degrees(math.asin(199.2 / 199.71)), abs=0.05)

    assert (ore.beacon, ore.valid, ore.error_code) == ("1", False, "50")
    assert ore.t_device_s == 15 * 3600 + 32 * 60 + 53
    assert ore.bearing_deg == pytest.approx(-3.9)
    assert ore.slant_range_m == 196.6
    assert ore.xyz_m == (169.4, -11.5, 100.0)

    # World coordinates in the columns of XYZ: read, but not a fix from the array.
    assert (micronav.beacon, micronav.valid, micronav.error_code) == ("0", False, "inconsistent")
    assert micronav.bearing_deg == pytest.approx(277.6 - 360)
    assert micronav.slant_range_m == 20.8
    assert micronav.xyz_m == (602501.0, 503871.9, 13.0)


def test_gll() -> None:
    (fix,) = fixes("tracklink-gll", "tracklink_gll")
    assert fix.lat_deg == pytest.approx(49.274166667)
    assert fix.lon_deg == pytest.approx(-123.185333333)
    assert fix.t_device_s == 22 * 3600 + 54 * 60 + 44
    assert fix.valid
