"""The acoustic model: predictions against the emulator's sound, Jacobians against differences.

The moment the ping left is a function of the state at the reply: a velocity error dv carried over
the age of the ping moves the array by age * dv, an attitude error turns both lever arms alike.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gateway.fusion import loose, usbl
from gateway.fusion.errors import FAMILY
from gateway.fusion.ranging import Past
from gateway.fusion.state import ATT, BG, DALPHA, DBETA, DKD, N_FULL, THETA, State
from gateway.nav import earth, strapdown
from gateway.nav.attitude import C_from_euler
from tests.gateway.emulated import demo_data, make, quiet_usbl, track
from tests.gateway.states import NAMES, ORIGIN, derivative, error_map, random_state
from tests.gateway.voyages import Voyage, perfect_rows, trajectory, true_state

SIGMA = np.array([0.01, 0.02, 0.3])
LEVER = np.array([8.0, -3.0, 4.0])
"""A ship's."""
DKD_IN_MEAN, LATENCY_IN_MEAN = strapdown.N_MEAN + 5, strapdown.N_MEAN + 9


@dataclass
class Case:
    """A state with a fix seen from it."""

    state: State
    geometry: usbl.ArrayGeometry
    sight: usbl.Sighting

    def predict(self, y):
        """Predicted rows at `y`, the ping's moment moving with the state as the model says."""
        sight = self.sight
        if sight.transmit is not None:
            moved = sight.transmit.age_s * (y.v_eb_e - self.state.v_eb_e)
            sight = usbl.Sighting(
                sight.measured,
                sight.sigma,
                sight.beacon_e,
                sight.transmit._replace(s_e=sight.transmit.s_e - moved),
            )
        return usbl.linearise(y, self.geometry, sight).residual


def case(seed, *, two_way, range_m=120.0, lever=LEVER):
    rng = np.random.default_rng(seed)
    state = random_state(rng)
    turn = Rotation.random(rng=rng).as_matrix()
    direction = turn @ np.array([np.cos(0.6), 0.0, np.sin(0.6)])
    # the array's axes are `turn`, so the sight line stays away from its vertical
    geometry = usbl.ArrayGeometry(lever, state.C_theta.T @ state.C_eb.T @ turn)
    past = None
    if two_way:
        age = 2.0 * range_m / 1500.0
        back = state.v_eb_e * age + rng.normal(0.0, 0.1, 3)
        chain = state.chain @ Rotation.from_rotvec(rng.normal(0.0, 0.1, 3)).as_matrix()
        past = Past(state.s_e - back, chain, age)
    beacon = state.r_e + range_m * direction
    measured = rng.normal(0.0, 0.3, 3)  # near zero: residuals stay off the cut of the angle
    sight = usbl.Sighting(measured, SIGMA, beacon, past)
    return Case(state, geometry, sight)


@pytest.mark.parametrize("coupling", ["tight", "loose"])
@pytest.mark.parametrize("two_way", [False, True])
def test_a_time_in_doubt_is_noise_along_the_way(coupling, two_way):
    """By as much as the fix would have been another, so much earlier."""
    c = case(11, two_way=two_way)
    sd, step = 0.3, 1e-4
    c.state.x[33], c.state.x[34:37] = 0.01, (1e-3, -2e-3, 3e-3)

    def look(state, t_sd_s=0.0):
        sight = replace(c.sight, t_sd_s=t_sd_s, measured=np.array([-0.1, 0.2, 120.0]))
        if coupling == "tight":
            return usbl.linearise(state, c.geometry, sight)
        return loose.linearise(state, c.geometry, sight, None)

    def then(s):
        state = c.state.copy()
        state.x[LATENCY_IN_MEAN] += s
        return look(state).residual

    moved = (then(step) - then(-step)) / (2.0 * step)
    added = look(c.state, sd).R - look(c.state).R
    np.testing.assert_allclose(added, sd**2 * np.outer(moved, moved), rtol=1e-4, atol=1e-12)


def relative_error(found, exact):
    """Largest error of each row relative to its largest element of the same kind of column."""
    worst = 0.0
    for columns in (*(slice(i, i + 3) for i in range(0, 24, 3)), slice(24, 25)):
        scale = np.abs(exact[:, columns]).max(axis=1, keepdims=True)
        scale = np.where(scale == 0.0, 1.0, scale)
        worst = max(worst, float((np.abs(found - exact)[:, columns] / scale).max()))
    return worst


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("two_way", [True, False], ids=["two_way", "one_way"])
@pytest.mark.parametrize("range_m", [40.0, 120.0, 2500.0])
@pytest.mark.parametrize("seed", range(3))
def test_every_column_is_the_derivative(name, two_way, range_m, seed):
    c = case(seed, two_way=two_way, range_m=range_m)
    z = usbl.linearise(c.state, c.geometry, c.sight)
    found = derivative(c.predict, c.state, FAMILY[name])
    # left out: the gyro bias in the rate that carries the attitude back over the latency
    bound = abs(c.state.latency_s) * np.linalg.norm(z.H[:, ATT], axis=1)
    assert np.all(np.linalg.norm(found[:, BG], axis=1) < 1.01 * bound + 1e-6)
    found[:, BG] = 0.0
    assert relative_error(z.H @ error_map(FAMILY[name], c.state), found) < 1e-6


@pytest.mark.parametrize("two_way", [True, False], ids=["two_way", "one_way"])
def test_the_lever_arm_matters_to_the_range(two_way):
    c = case(5, two_way=two_way, lever=np.zeros(3))
    c.state.lever_b[:] = 0.0
    z = usbl.linearise(c.state, c.geometry, c.sight)
    np.testing.assert_array_equal(z.H[usbl.RANGE, :3], 0.0)
    c = case(5, two_way=two_way)
    z = usbl.linearise(c.state, c.geometry, c.sight)
    assert np.abs(z.H[usbl.RANGE, :3]).max() > 0.1


def test_right_invariant_attitude_columns_know_the_beacon_only():
    """After T the angles' attitude columns hold the beacon, not the estimated position (004)."""
    c = case(7, two_way=False, range_m=800.0)
    z = usbl.linearise(c.state, c.geometry, c.sight)
    H = z.H @ error_map(FAMILY["right_invariant"], c.state)
    from_origin = c.sight.beacon_e - ORIGIN
    crossed = np.cross(from_origin, H[:2, 6:9])
    np.testing.assert_allclose(H[:2, :3], crossed, rtol=1e-9, atol=1e-9)


def test_a_vertical_beacon_has_no_bearing():
    state = State.at(np.eye(3), np.zeros(3), ORIGIN, np.eye(N_FULL))
    geometry = usbl.ArrayGeometry(np.zeros(3), np.eye(3))

    def rows(x, measured):
        sight = usbl.Sighting(measured, SIGMA, ORIGIN + np.array([x, 0.0, 100.0]), None)
        z = usbl.linearise(state, geometry, sight)
        return z and z.names

    whole = np.array([-1.5, 0.0, 100.0])
    for x in (0.0, 1.9):
        assert rows(x, whole) == ("elevation_deg", "range_m")
        assert rows(x, np.array([np.nan, 0.0, np.nan])) is None
    assert rows(2.1, whole) == usbl.ROW_NAMES


def test_rows_that_were_not_measured_are_left_out():
    c = case(3, two_way=True)
    whole = usbl.linearise(c.state, c.geometry, c.sight)
    for missing in (0, 1, 2):
        measured = c.sight.measured.copy()
        measured[missing] = np.nan
        sight = usbl.Sighting(measured, SIGMA, c.sight.beacon_e, c.sight.transmit)
        part = usbl.linearise(c.state, c.geometry, sight)
        keep = [i for i in range(3) if i != missing]
        np.testing.assert_array_equal(part.H, whole.H[keep])
        np.testing.assert_array_equal(part.residual, whole.residual[keep])
        np.testing.assert_array_equal(part.R, np.diag(SIGMA[keep] ** 2))
    nothing = usbl.Sighting(np.full(3, np.nan), SIGMA, c.sight.beacon_e, c.sight.transmit)
    assert usbl.linearise(c.state, c.geometry, nothing) is None


def test_bearing_residuals_take_the_short_way_round():
    state = State.at(np.eye(3), np.zeros(3), ORIGIN, np.eye(N_FULL))
    geometry = usbl.ArrayGeometry(np.zeros(3), np.eye(3))
    astern = ORIGIN + np.array([-100.0, -1.0, 50.0])  # bearing just above -pi
    sight = usbl.Sighting(np.array([-0.46, np.pi - 0.01, 111.0]), SIGMA, astern, None)
    z = usbl.linearise(state, geometry, sight)
    assert z.residual[usbl.BEARING] == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize("travel", ["two_way", "one_way"])
@pytest.mark.parametrize("kind", ["circle", "line"])
def test_at_the_truth_the_emulators_sound_is_predicted(travel, kind):
    """Lever arm, mounting, large constant errors, turnaround and the motion meanwhile."""
    errors = {
        "mounting_deg": (3.0, -2.0, 5.0),
        "bearing_deg": 1.5,
        "elevation_deg": -1.0,
        "range_scale": 0.0,
    }
    beacon = {"lat_deg": -33.004, "lon_deg": -72.001, "height_m": -250.0}
    data = demo_data() | {
        "trajectory": track(kind, speed_m_s=6.0),
        "duration_s": 120.0,
        "beacons": {"1": beacon | {"travel": travel, "turnaround_ms": 40.0}},
    }
    mounting = (10.0, -5.0, 60.0)
    array = quiet_usbl(errors=errors, lever_arm_m=LEVER.tolist(), mounting_deg=mounting)
    data["devices"]["usbl0"] = array
    voyage = Voyage(make(data))
    geometry = usbl.ArrayGeometry(LEVER, C_from_euler(*np.radians(mounting)))
    b = np.radians([beacon["lat_deg"], beacon["lon_deg"]])
    beacon_e = earth.lla_to_ecef(b[0], b[1], beacon["height_m"])
    heard = voyage.heard
    for k in range(3, len(heard.t_rx), 7):
        state = voyage.state(heard.t_rx[k])
        assert state.constants[6] == pytest.approx(np.radians(3.0))
        past = None
        if travel == "two_way":
            age = 2.0 * heard.slant_range[k] / 1500.0 + 0.04
            then = voyage.truth.pose(np.array([heard.t_rx[k] - age]))
            state.s_e[:] = state.r_e  # displacement and chain as the truth has them
            past = Past(then.r_e[0], then.C_eb[0], age)
        measured = np.array([heard.elevation[k], heard.bearing[k], heard.slant_range[k]])
        z = usbl.linearise(state, geometry, usbl.Sighting(measured, SIGMA, beacon_e, past))
        np.testing.assert_allclose(z.residual[:2], 0.0, atol=1e-9)
        assert z.residual[usbl.RANGE] == pytest.approx(0.0, abs=2e-6)


def test_constants_enter_with_their_signs():
    """measured = true + offset, measured = true (1 + dKd); theta turns the array in body axes."""
    c = case(11, two_way=False)

    def predicted(state, geometry=c.geometry):
        return usbl.linearise(state, geometry, c.sight).residual + c.sight.measured

    bare = c.state.copy()
    bare.angle_offsets[:] = 0.0
    bare.x[DKD_IN_MEAN] = 0.0
    h, h0 = predicted(c.state), predicted(bare)
    alpha, beta = c.state.angle_offsets
    assert h[0] - h0[0] == pytest.approx(alpha, abs=1e-12)
    assert np.sin(h[1] - h0[1] - beta) == pytest.approx(0.0, abs=1e-12)
    assert h[2] / h0[2] == pytest.approx(1.0 + c.state.range_scale, abs=1e-12)
    nominal = c.state.copy()
    nominal.theta[:] = nominal.lever_b[:] = 0.0
    shifted = c.geometry.lever_b + c.state.lever_b
    turned = usbl.ArrayGeometry(shifted, c.state.C_theta @ c.geometry.C_bu)
    np.testing.assert_allclose(predicted(nominal, turned), h, atol=1e-8)


def test_latency_is_the_time_the_stamp_is_late():
    """Stamped 20 ms late, a fix is that of the vehicle 20 ms earlier, as the emulator has it."""
    truth = trajectory("circle", 60.0, speed_m_s=6.0)
    then, now = true_state(truth, 29.98), true_state(truth, 30.0)
    now = State.at(now.C_eb, now.v_eb_e, now.r_e, np.eye(N_FULL))
    now.x[strapdown.LAST] = perfect_rows(truth, 30.0, 100.0)[-1, :7]
    now.x[LATENCY_IN_MEAN] = 0.02
    geometry = usbl.ArrayGeometry(LEVER, np.eye(3))
    sight = usbl.Sighting(np.zeros(3), SIGMA, now.r_e + np.array([30.0, -70.0, 40.0]), None)
    late, early = (usbl.linearise(s, geometry, sight).residual for s in (now, then))
    np.testing.assert_allclose(late[:2], early[:2], atol=5e-5)
    assert late[2] == pytest.approx(early[2], abs=1e-3)
    now.x[LATENCY_IN_MEAN] = 0.0
    ignored = usbl.linearise(now, geometry, sight).residual
    assert np.abs(ignored - early).max() > 0.02


def test_columns_of_the_constants():
    c = case(12, two_way=True)
    z = usbl.linearise(c.state, c.geometry, c.sight)
    assert z.H[0, DALPHA] == z.H[1, DBETA] == 1.0
    assert z.H[0, DBETA] == z.H[1, DALPHA] == z.H[0, DKD] == z.H[1, DKD] == 0.0
    np.testing.assert_array_equal(z.H[usbl.RANGE, THETA], 0.0)
    assert z.H[usbl.RANGE, DKD] == pytest.approx(120.0, rel=0.1)
    np.testing.assert_array_equal(z.H[:, 9:15], 0.0)
