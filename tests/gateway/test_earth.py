"""WGS84 against published figures, longer arithmetic and finite differences."""

import numpy as np
import pytest

from gateway.nav import earth

LD = np.longdouble
ALL_OVER = np.random.default_rng(1)
N = 20_000
LAT = np.concatenate([ALL_OVER.uniform(-np.pi / 2, np.pi / 2, N), [np.pi / 2, -np.pi / 2, 0.0]])
LON = ALL_OVER.uniform(-np.pi, np.pi, N + 3)
H = ALL_OVER.uniform(-11e3, 100e3, N + 3)


def ecef_in_long_double(lat, lon, h):
    lat, lon, h = LD(lat), LD(lon), LD(h)
    f = 1 / LD("298.257223563")
    e2 = f * (2 - f)
    R_N = LD(6378137) / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    p = (R_N + h) * np.cos(lat)
    return np.stack([p * np.cos(lon), p * np.sin(lon), (R_N * (1 - e2) + h) * np.sin(lat)], -1)


def test_ecef_agrees_with_longer_arithmetic():
    assert np.abs(earth.lla_to_ecef(LAT, LON, H) - ecef_in_long_double(LAT, LON, H)).max() < 4e-9


def test_geodetic_is_the_inverse_to_rounding():
    lat, lon, h = earth.ecef_to_lla(ecef_in_long_double(LAT, LON, H).astype(float))
    assert np.abs(h - H).max() < 5e-9
    assert np.abs(lat - LAT).max() * earth.A < 5e-9
    assert np.abs((lon - LON) * np.cos(LAT)).max() * earth.A < 5e-9


def test_published_point():
    """EPSG guidance note 7-2, geographic/geocentric conversions (WGS84)."""
    lat, lon = np.deg2rad(53 + 48 / 60 + 33.820 / 3600), np.deg2rad(2 + 7 / 60 + 46.380 / 3600)
    np.testing.assert_allclose(
        earth.lla_to_ecef(lat, lon, 73.0), [3771793.968, 140253.342, 5124304.349], atol=2e-3
    )


def test_columns_of_C_en_are_the_directions_of_travel():
    lat, lon, h = 0.7, -2.1, -40.0
    R_M, R_N = earth.radii(lat)
    step = 1e-6
    north = (earth.lla_to_ecef(lat + step, lon, h) - earth.lla_to_ecef(lat - step, lon, h)) / (
        2 * step * (R_M + h)
    )
    east = (earth.lla_to_ecef(lat, lon + step, h) - earth.lla_to_ecef(lat, lon - step, h)) / (
        2 * step * (R_N + h) * np.cos(lat)
    )
    down = earth.lla_to_ecef(lat, lon, h - 1.0) - earth.lla_to_ecef(lat, lon, h)
    np.testing.assert_allclose(
        earth.C_en(lat, lon), np.column_stack([north, east, down]), atol=5e-9
    )


@pytest.mark.parametrize(("lat", "lon"), [(0.7, -2.1), (-1.2, np.pi - 1e-4), (0.0, -np.pi)])
def test_north_and_east_are_those_of_the_way_between(lat, lon):
    """Against the chord in the axes half way; over 10 km it is 1 mm shorter than the arc."""
    h = -40.0
    there = lat + np.array([8e-4, -1e-6, 0.0]), lon + np.array([9e-4, 1e-6, -1e-5])
    north, east = earth.north_east(*there, lat, lon, h)
    wrapped = earth.north_east(there[0], there[1] + 2.0 * np.pi, lat, lon - 4.0 * np.pi, h)
    np.testing.assert_allclose(wrapped, (north, east), atol=1e-7)
    chord = earth.lla_to_ecef(*there, h) - earth.lla_to_ecef(lat, lon, h)
    half_way = earth.C_en(0.5 * (there[0] + lat), 0.5 * (there[1] + lon))
    expected = np.einsum("kij,ki->kj", half_way, chord)[:, :2]
    np.testing.assert_allclose(np.column_stack([north, east]), expected, atol=0.05)


def test_C_en_is_a_rotation_everywhere():
    C = earth.C_en(LAT, LON)
    np.testing.assert_allclose(
        C @ np.swapaxes(C, -1, -2), np.broadcast_to(np.eye(3), C.shape), atol=1e-15
    )
    np.testing.assert_allclose(np.linalg.det(C), 1.0, atol=1e-15)


@pytest.mark.parametrize(
    ("lat_deg", "g"), [(0.0, 9.7803253359), (45.0, 9.8061977694), (90.0, 9.8321849379)]
)
def test_normal_gravity_on_the_ellipsoid(lat_deg, g):
    """NIMA TR8350.2 table 3.4 (equator, pole), and Somigliana at 45 deg."""
    assert earth.gravity(np.deg2rad(lat_deg), 0.0) == pytest.approx(g, abs=2e-9)


def test_gravity_off_the_ellipsoid_follows_the_exact_field():
    """The closed field of the level ellipsoid (Heiskanen and Moritz 6-2), differentiated."""

    def potential(r):
        E = np.sqrt(LD(earth.A) ** 2 - LD(earth.B) ** 2)
        x, y, z = (LD(v) for v in r)
        d = x * x + y * y + z * z - E * E
        u = np.sqrt(d / 2 * (1 + np.sqrt(1 + 4 * E * E * z * z / d**2)))
        sin_b = z / u

        def q(w):
            return ((1 + 3 * w * w / E**2) * np.arctan(E / w) - 3 * w / E) / 2

        w2 = LD(earth.OMEGA_IE) ** 2
        shape = w2 * LD(earth.A) ** 2 * q(u) / q(LD(earth.B)) * (sin_b**2 - LD(1) / 3) / 2
        return LD(earth.GM) / E * np.arctan(E / u) + shape + w2 * (x * x + y * y) / 2

    for lat, h in [(0.1, -3000.0), (0.8, -50.0), (1.2, 500.0)]:
        r = earth.lla_to_ecef(lat, 0.3, h)
        step = 10.0
        gradient = [
            float((potential(r + step * e) - potential(r - step * e)) / (2 * step))
            for e in np.eye(3)
        ]
        assert np.linalg.norm(gradient) == pytest.approx(float(earth.gravity(lat, h)), abs=5e-7)


def test_gravity_vector_points_down():
    g = earth.gravity_n(LAT[:5], H[:5])
    np.testing.assert_array_equal(g[:, :2], 0.0)
    np.testing.assert_array_equal(g[:, 2], earth.gravity(LAT[:5], H[:5]))
