"""Fixes inside the gate that may be echoes: the probability, the mixture, and what it saves."""

import dataclasses

import numpy as np
import pytest
import scipy.stats
from msgspec import structs

from gateway.fusion.echo import WIDE, directness, mixed, passing
from gateway.fusion.errors import FAMILY
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.state import ATT, POS, State
from gateway.fusion.usbl import angles
from gateway.messages import UsblFix
from gateway.nav.earth import C_en, ecef_to_lla
from tests.gateway.states import ORIGIN, random_state
from tests.gateway.test_bent_fixes import model

GATE = 0.999
BESIDE = np.array([60.0, 0.0, -60.0])


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_the_probability_is_the_share_of_direct_ones(rows):
    """Counted over draws: Gaussian ones inside the gate, and one of five anywhere in it."""
    rng = np.random.default_rng(rows)
    n, share = 400_000, 0.2
    edge = scipy.stats.chi2.ppf(GATE, rows)
    direct = rng.chisquare(rows, n)
    echoes = edge * rng.random(round(n * share / (1.0 - share))) ** (2.0 / rows)
    for low in np.linspace(0.5, edge - 2.0, 6):
        n_direct, n_echoes = (((low < x) & (x < low + 0.2)).sum() for x in (direct, echoes))
        counted = n_direct / (n_direct + n_echoes)
        expected = directness(low + 0.1, rows, GATE, share)
        assert abs(counted - expected) < 5.0 * np.sqrt(counted * (1 - counted) / n_direct) + 3e-3


@pytest.mark.parametrize("error", sorted(FAMILY))
def test_the_mixture_has_the_moments_of_both(error):
    """Of draws of the error about each of two states close together."""
    rng = np.random.default_rng(3)
    definition, share, n = FAMILY[error], 0.7, 6_000
    prior = random_state(rng)
    k = len(prior.P)
    scale = np.full(k, 1e-6)
    prior.P[:] = np.diag(scale**2)
    used = definition.boxplus(prior, scale * rng.standard_normal(k), ORIGIN)
    used.P[:] = np.diag((0.5 * scale) ** 2)
    found = mixed(prior, used, share, definition, ORIGIN)
    drawn = np.array(
        [
            FAMILY["additive"].boxminus(found, x, ORIGIN)
            - np.sqrt(x.P.diagonal()) * rng.standard_normal(k)
            for x in (used if one else prior for one in rng.random(n) < share)
        ]
    )
    sigma = np.sqrt(found.P.diagonal())
    np.testing.assert_allclose(drawn.mean(axis=0) / sigma, 0.0, atol=5.0 / np.sqrt(n))
    np.testing.assert_allclose(drawn.std(axis=0) / sigma, 1.0, atol=0.05)


def vehicle(fresh, b_e, sigma_n, heading_sd=1e-6):
    """60 m beside and above a beacon, heading north, its place known to `sigma_n` (3,) m."""
    lat, lon, _ = ecef_to_lla(b_e)
    C_eb = C_en(lat, lon)
    P = np.diag(np.full(len(fresh.P), 1e-12))
    P[POS, POS] = C_eb @ np.diag(np.square(sigma_n)) @ C_eb.T
    P[ATT, ATT] = C_eb @ np.diag([1e-4, 1e-4, heading_sd**2]) @ C_eb.T
    return State.at(C_eb, np.zeros(3), b_e + C_eb @ BESIDE, P, fresh.columns)


def seen(array, r_b):
    """What an array of a level vehicle sees of a beacon at `r_b`, without noise."""
    r_u = array.geometry.C_bu.T @ r_b
    return UsblFix(0, "usbl0", "1", *angles(tuple(r_u)), float(np.linalg.norm(r_u)))


def error_after(error, echoes, longer_m):
    """Largest error north, east or down in its sigma after a fix whose range is too long."""
    known, fresh = model(error)
    known = dataclasses.replace(known, echoes=echoes)
    state = vehicle(fresh, known.beacons["1"].r_e, [2.0, 2.0, 2.0])
    truth, C_eb = state.r_e.copy(), state.C_eb.copy()
    fix = seen(known.arrays["usbl0"], -BESIDE)
    fix = structs.replace(fix, slant_range=fix.slant_range + longer_m)
    filter_ = Filter(known, Memory(state))
    verdict = filter_.apply(fix, None)
    assert verdict.accepted
    e = C_eb.T @ (filter_.memory.state.r_e - truth)
    P_n = C_eb.T @ filter_.memory.state.P[POS, POS] @ C_eb
    return verdict.nis, np.abs(e / np.sqrt(P_n.diagonal())).max()


@pytest.mark.parametrize("error", sorted(FAMILY))
def test_an_echo_inside_a_wide_gate_does_not_claim_its_place(error):
    nis, believed = error_after(error, 0.0, 7.5)
    assert 12.0 < nis < 16.0
    assert believed > 5.0
    assert error_after(error, 0.02, 7.5)[1] < 3.0
    assert error_after(error, 0.02, 0.1)[1] < 1.0


@pytest.mark.parametrize("heading_deg", [1.0, 10.0, 25.0])
def test_who_is_lost_and_knows_the_height_believes_no_other_height(heading_deg):
    known, fresh = model("right_invariant")
    for down_m, accepted in ((-60.0, True), (-120.0, False)):
        state = vehicle(fresh, known.beacons["1"].r_e, [100.0, 100.0, 0.1], np.radians(heading_deg))
        fix = seen(known.arrays["usbl0"], -np.array([-50.0, 90.0, down_m]))
        assert Filter(known, Memory(state)).apply(fix, None).accepted == accepted


def test_a_narrow_gate_lets_few_echoes_in():
    """As it is where fixes come often: the state is uncertain by little beside the noise."""
    R = np.diag([1e-4, 1e-4, 0.25])
    assert passing(0.02, R, R) == pytest.approx(0.02 / WIDE)
    assert passing(0.02, 4.0 * R, R) == pytest.approx(0.02 * 8.0 / WIDE)
    assert passing(0.02, 1e3 * R, R) == 0.02
    narrow, wide = (directness(14.0, 3, GATE, passing(0.02, k * R, R)) for k in (2.0, 1e3))
    assert narrow > 0.85
    assert wide < 0.5
