"""A target's place by a fix: where the sound came from, and how surely."""

import numpy as np
import pytest

from gateway.fusion import target, usbl
from gateway.fusion.errors import FAMILY
from gateway.fusion.observation import AcousticArray, Model, Responder
from gateway.messages import Covariance3, UsblFix
from gateway.nav import earth
from tests.gateway.states import derivative
from tests.gateway.test_fusion_usbl import SIGMA, Case, case

SOUND = 1500.0
T_NS = 10_000_000_000


class Was:
    """The track of a case: it knows the moment of the ping alone, as far as the state moves it."""

    def __init__(self, of: Case, state=None) -> None:
        past = of.sight.transmit
        moved = np.zeros(3)
        if past is not None and state is not None:
            moved = past.age_s * (state.v_eb_e - of.state.v_eb_e)
        self._row = None if past is None else np.concatenate([past.s_e - moved, past.chain.ravel()])

    def at(self, t_ns: int) -> np.ndarray:
        assert self._row is not None, "nobody asks of a one-way range"
        return self._row


def model(of: Case) -> Model:
    past = of.sight.transmit
    return Model(
        error=FAMILY["additive"],
        q=np.zeros(4),
        gate=0.999,
        sound_speed=SOUND,
        arrays={"usbl0": AcousticArray(of.geometry, SIGMA)},
        beacons={},
        targets={"2": Responder(0.0, past is not None)},
    )


def heard(of: Case) -> np.ndarray:
    """Elevation, bearing and range that the verified model of a fix predicts."""
    z = usbl.linearise(of.state, of.geometry, of.sight)
    assert z is not None
    return z.residual + of.sight.measured


def place(of: Case, rows: np.ndarray, state=None) -> np.ndarray:
    fix = UsblFix(T_NS, "usbl0", "2", *rows.tolist())
    found = target.sighting(model(of), state or of.state, fix, Was(of, state))
    assert found is not None
    return earth.lla_to_ecef(found.lat, found.lon, found.h)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("two_way", [True, False])
def test_it_is_where_the_sound_came_from(seed: int, two_way: bool) -> None:
    of = case(seed, two_way=two_way, range_m=400.0)
    fix = UsblFix(T_NS, "usbl0", "2", *heard(of).tolist())
    found = target.sighting(model(of), of.state, fix, Was(of))
    assert found is not None
    r_e = earth.lla_to_ecef(found.lat, found.lon, found.h)
    np.testing.assert_allclose(r_e, of.sight.beacon_e, atol=1e-6)
    assert T_NS - found.t_ns == pytest.approx(400.0 / SOUND * 1e9, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_its_covariance_is_that_of_the_fix_and_of_ourselves(seed: int) -> None:
    of = case(seed, two_way=True, range_m=400.0)
    rng = np.random.default_rng(seed)
    scale = np.repeat([1e-3, 0.05, 0.5, 1e-6, 1e-5, 1e-3, 1e-3, 0.05, 1e-3], 3)[:25]
    A = rng.normal(size=(25, 25)) * scale[:, None]
    of.state.P[:] = A @ A.T
    rows = heard(of)
    C_ne = earth.C_en(*earth.ecef_to_lla(of.sight.beacon_e)[:2]).T
    by_state = C_ne @ derivative(lambda state: place(of, rows, state), of.state, FAMILY["additive"])
    steps = np.array([1e-4, 1e-4, 1e-2])
    by_rows = np.column_stack(
        [
            C_ne @ (place(of, rows + h) - place(of, rows - h)) / (2.0 * h.sum())
            for h in np.diag(steps)
        ]
    )
    own = by_state @ of.state.P @ by_state.T
    of_fix = by_rows @ np.diag(SIGMA**2) @ by_rows.T
    fix = UsblFix(T_NS, "usbl0", "2", *rows.tolist())
    found = target.sighting(model(of), of.state, fix, Was(of))
    assert found is not None
    # The ways of (M.83) are taken to a beacon that stays: off by the array's way over the range.
    for told, expected in ((found.own_cov, own), (found.cov, of_fix)):
        np.testing.assert_allclose(square(told), expected, atol=1e-2 * np.trace(expected))


def square(told: Covariance3) -> np.ndarray:
    nn, ee, dd, ne, nd, ed = told
    return np.array([[nn, ne, nd], [ne, ee, ed], [nd, ed, dd]])


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_a_fix_without_a_part_tells_no_place(missing: int) -> None:
    of = case(1, two_way=False)
    rows: list[float | None] = heard(of).tolist()
    rows[missing] = None
    fix = UsblFix(T_NS, "usbl0", "2", *rows)
    assert target.sighting(model(of), of.state, fix, Was(of)) is None


def test_a_range_shorter_than_the_way_between_tells_no_place() -> None:
    of = case(3, two_way=True, range_m=120.0)
    past = of.sight.transmit
    assert past is not None
    of.sight = usbl.Sighting(
        of.sight.measured,
        of.sight.sigma,
        of.sight.beacon_e,
        past._replace(s_e=of.state.s_e - np.array([900.0, 0.0, 0.0])),
    )
    rows = np.array([0.1, 0.2, 100.0])
    assert target.sighting(model(of), of.state, UsblFix(T_NS, "usbl0", "2", *rows), Was(of)) is None
