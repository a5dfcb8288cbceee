"""Every measurement model but the tight fix: derivatives by all 25 errors of every definition.

Left out by the models, and so bounded here instead of compared: the gyro bias in the rate that
carries an attitude back over the latency, the turning of north-east-down with the position (v/R_e
and tan(lat)/R_e a metre), and the vehicle's acceleration over the latency.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gateway.fusion import (
    bottom_velocity,
    depth,
    heading,
    lbl,
    loose,
    position,
    radial_velocity,
    stationary,
    usbl,
    velocity,
)
from gateway.fusion.errors import FAMILY
from gateway.fusion.kalman import Linearised
from gateway.fusion.ranging import Past
from gateway.fusion.state import ATT, BG, POS, THETA, VEL, State
from gateway.nav import earth, strapdown
from tests.gateway.states import NAMES, ORIGIN, STEPS, derivative, error_map, random_state

LEVER = np.array([8.0, -3.0, 4.0])
"""A ship's."""
ELEMENTS = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.02], [0.0, 0.1, 0.0], [0.0, -0.1, 0.05]])
SIGMA = np.array([0.01, 0.02, 0.3])
LATENCY_IN_MEAN = strapdown.N_MEAN + 9

LONG = STEPS.copy()
"""Rates depend on the mounting by the elements' places only: a step must move those, too."""
LONG[THETA] = 3e-2

Model = Callable[[State], Linearised]


@dataclass
class Case:
    """A state, what is seen from it, and the model of it as a function of the state alone."""

    state: State
    geometry: usbl.ArrayGeometry
    beacon_e: np.ndarray
    transmit: Past | None

    def past(self, y: State) -> Past | None:
        """The ping's moment seen from `y`: a velocity error was there all the while."""
        if self.transmit is None:
            return None
        moved = self.transmit.age_s * (y.v_eb_e - self.state.v_eb_e)
        return self.transmit._replace(s_e=self.transmit.s_e - moved)


def case(seed, *, two_way=True, range_m=120.0, latency=True):
    rng = np.random.default_rng(seed)
    state = random_state(rng)
    if not latency:
        state.x[LATENCY_IN_MEAN] = 0.0
    turn = Rotation.random(rng=rng).as_matrix()
    geometry = usbl.ArrayGeometry(LEVER, state.C_theta.T @ state.C_eb.T @ turn)
    past = None
    if two_way:
        age = 2.0 * range_m / 1500.0
        back = state.v_eb_e * age + rng.normal(0.0, 0.1, 3)
        chain = state.chain @ Rotation.from_rotvec(rng.normal(0.0, 0.1, 3)).as_matrix()
        past = Past(state.s_e - back, chain, age)
    beacon_e = state.r_e + range_m * (turn @ np.array([np.cos(0.6), 0.0, np.sin(0.6)]))
    return Case(state, geometry, beacon_e, past)


def ranges(c: Case) -> Model:
    return lambda y: lbl.linearise(y, LEVER, lbl.Reply(100.0, 0.3, c.beacon_e, c.past(y)))


def loose_fix(c: Case) -> Model:
    range_m = float(np.linalg.norm(c.beacon_e - c.state.r_e))
    measured = np.array([-0.5, 0.3, range_m])
    return lambda y: loose.linearise(
        y, c.geometry, usbl.Sighting(measured, SIGMA, c.beacon_e, c.past(y)), None
    )


def rate_of(elements: np.ndarray, by_element: bool) -> Callable[[Case], Model]:
    doppler = radial_velocity.Doppler(np.zeros(len(elements)), 0.02, np.zeros(3), by_element)
    return lambda c: (
        lambda y: radial_velocity.linearise(
            y, c.geometry, elements, doppler._replace(beacon_e=c.beacon_e)
        )
    )


def gnss_position(c: Case) -> Model:
    place = position.Place(c.state.r_e + 3.0, earth.C_en(0.78, 2.2), np.ones(3))
    return lambda y: position.linearise(y, LEVER, place)


def gnss_velocity(c: Case) -> Model:
    measured = velocity.OverGround(np.ones(3), np.ones(3))
    return lambda y: velocity.linearise(y, LEVER, measured)


def pressure(c: Case) -> Model:
    return lambda y: depth.linearise(y, LEVER, -20.0, 0.1)


def log(c: Case) -> Model:
    measured = bottom_velocity.OverBottom(np.zeros(3), np.ones(3))
    return lambda y: bottom_velocity.linearise(y, LEVER, c.geometry.C_bu, measured)


def compass(c: Case) -> Model:
    lat, lon, _ = earth.ecef_to_lla(c.state.r_e)
    forward = earth.C_en(lat, lon).T @ c.state.C_eb @ c.geometry.C_bu[:, 0]
    true = float(np.arctan2(forward[1], forward[0]))
    return lambda y: heading.linearise(y, c.geometry.C_bu, true, 0.01)


def rest(c: Case) -> Model:
    return lambda y: stationary.linearise(y, 0.01)


ACOUSTIC = {
    "range": ranges,
    "loose": loose_fix,
    "mean_rate": rate_of(ELEMENTS, by_element=False),
    "element_rates": rate_of(ELEMENTS, by_element=True),
    "one_element": rate_of(np.zeros((1, 3)), by_element=False),
}
OF_THE_VEHICLE = {
    "position": gnss_position,
    "velocity": gnss_velocity,
    "depth": pressure,
    "bottom_velocity": log,
    "heading": compass,
    "stationary": rest,
}
NED_TURNS = {"velocity", "heading", "stationary"}
"""Their rows stand in north-east-down at the estimated place."""


def relative_error(found, exact):
    """Largest error of each row relative to its largest element of the same kind of column."""
    worst = 0.0
    for columns in (*(slice(i, i + 3) for i in range(0, 24, 3)), slice(24, 25)):
        scale = np.abs(exact[:, columns]).max(axis=1, keepdims=True)
        scale = np.where(scale < 1e-7, 1.0, scale)
        worst = max(worst, float((np.abs(found - exact)[:, columns] / scale).max()))
    return worst


def compare(name, model, c, definition):
    """Both sets of derivatives, (m, 25) each in the definition's error."""
    z = model(c)(c.state)
    found = derivative(lambda y: model(c)(y).residual, c.state, definition, LONG)
    return z, z.H @ error_map(definition, c.state), found


@pytest.mark.parametrize("definition", NAMES)
@pytest.mark.parametrize("two_way", [True, False], ids=["two_way", "one_way"])
@pytest.mark.parametrize("name", ACOUSTIC)
@pytest.mark.parametrize("range_m", [40.0, 2500.0])
@pytest.mark.parametrize("seed", range(2))
def test_acoustic_models(definition, two_way, name, range_m, seed):
    c = case(seed, two_way=two_way, range_m=range_m, latency=False)
    _, H, found = compare(name, ACOUSTIC[name], c, FAMILY[definition])
    assert relative_error(H, found) < 1e-6


@pytest.mark.parametrize("definition", NAMES)
@pytest.mark.parametrize("name", ["range", "loose"])
def test_a_latency_that_is_not_zero(definition, name):
    c = case(3)
    z, H, found = compare(name, ACOUSTIC[name], c, FAMILY[definition])
    bound = abs(c.state.latency_s) * np.linalg.norm(z.H[:, ATT], axis=1)
    assert np.all(np.linalg.norm(found[:, BG], axis=1) < 1.01 * bound + 1e-6)
    found[:, BG] = 0.0
    assert relative_error(H, found) < 1e-6


@pytest.mark.parametrize("definition", NAMES)
@pytest.mark.parametrize("name", OF_THE_VEHICLE)
@pytest.mark.parametrize("seed", range(3))
def test_models_of_the_vehicle(definition, name, seed):
    c = case(seed)
    z, H, found = compare(name, OF_THE_VEHICLE[name], c, FAMILY[definition])
    if name in NED_TURNS:
        T = np.linalg.inv(error_map(FAMILY[definition], c.state))
        left_out = (found - H) @ T
        assert np.abs(left_out[:, POS]).max() < 2.0 * np.abs(z.residual).max() / 6.3e6 + 2e-6
        found = found - left_out[:, POS] @ np.linalg.inv(T)[POS]
    assert relative_error(H, found) < 1e-6


def test_a_stationary_vehicle_has_no_velocity():
    c = case(1)
    z = stationary.linearise(c.state, 0.01)
    lat, lon, _ = earth.ecef_to_lla(c.state.r_e)
    np.testing.assert_allclose(earth.C_en(lat, lon) @ z.residual, c.state.v_eb_e, atol=1e-12)
    assert np.linalg.matrix_rank(z.H[:, VEL]) == 3


def test_only_the_estimated_columns_are_given():
    c = case(2)
    part = State(c.state.x, np.eye(15), np.arange(15))
    for model in (ACOUSTIC | OF_THE_VEHICLE).values():
        whole, some = model(c)(c.state), model(c)(part)
        np.testing.assert_array_equal(some.H, whole.H[:, :15])
        assert some.H.flags.c_contiguous
        assert len(some.names) == len(some.residual) == len(some.R)


def test_the_origin_is_near_the_states():
    assert np.linalg.norm(case(0).state.r_e - ORIGIN) < 2e3
