"""An inertial unit whose data cannot be right claims no place, whatever the fixes say."""

from functools import cache

import msgspec
import numpy as np
import pytest

from gateway.estimator import Estimator
from gateway.fusion.credible import ENOUGH, OVER, Credible
from gateway.fusion.state import N_STATES, State
from gateway.messages import (
    Checkpoint,
    FilterOutput,
    Measurement,
    NavSolution,
    SavedState,
)
from gateway.modes import Mode
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler
from gateway.replay.passes import SmoothedPass
from tests.gateway.emulated import demo_data, make
from tests.gateway.voyages import T0_NS, Voyage, block, configuration

RATE_HZ = 50.0
BREAKS_S = 24.0
SECONDS = 44.0
G_M_S2 = 9.80665
TURN, FORCE = slice(1, 4), slice(4, 7)


@cache
def voyage() -> Voyage:
    data = demo_data() | {"duration_s": SECONDS, "seed": 5}
    data["devices"]["imu0"]["rate_hz"] = RATE_HZ
    return Voyage(make(data))


def turned(rows: np.ndarray, roll_deg: float, pitch_deg: float) -> None:
    """As a unit feels it that sits otherwise than configured."""
    C_sb = np.asarray(C_from_euler(np.radians(roll_deg), np.radians(pitch_deg), 0.0))
    rows[:, TURN] = rows[:, TURN] @ C_sb.T
    rows[:, FORCE] = rows[:, FORCE] @ C_sb.T


def scaled(rows: np.ndarray, columns: slice, factor: float) -> None:
    rows[:, columns] *= factor


WRONG = {
    "upside down": lambda rows: turned(rows, 180.0, 0.0),
    "on its side": lambda rows: turned(rows, 90.0, 0.0),
    "on its nose": lambda rows: turned(rows, 0.0, -90.0),
    "forces in g": lambda rows: scaled(rows, FORCE, 1.0 / G_M_S2),
    "forces twice": lambda rows: scaled(rows, FORCE, 2.0),
    "of a slower unit": lambda rows: scaled(rows, slice(7), 1.25),
    "of a faster unit": lambda rows: scaled(rows, slice(7), 0.8),
    "turns in degrees": lambda rows: scaled(rows, TURN, 180.0 / np.pi),
}


def arrivals(name: str, samples: int = 10) -> list[Measurement]:
    """Samples that go wrong under way, in blocks of so many; each second the fixes of it."""
    trip, out = voyage(), []
    rows, fixes = trip.rows.copy(), list(trip.fixes)
    WRONG[name](rows[round(BREAKS_S * RATE_HZ) :])
    for k in range(0, len(rows), samples):
        while fixes and k % RATE_HZ == 0.0 and fixes[0].t_ns <= trip.t_ns[k]:
            out.append(fixes.pop(0))
        out.append(block(trip.t_ns[k : k + samples], rows[k : k + samples]))
    return out


def navs(outputs: list[FilterOutput]) -> list[NavSolution]:
    return [output for output in outputs if isinstance(output, NavSolution)]


def fed(estimator: Estimator, measurements: list[Measurement]) -> list[FilterOutput]:
    return [output for m in measurements for output in estimator.feed(m)]


@pytest.mark.parametrize("name", WRONG)
def test_what_it_feels_cannot_be_and_nothing_is_claimed(name: str) -> None:
    """Though fixes are used, and the heading is thought to be known."""
    outputs = fed(Estimator(configuration(voyage().scenario), 2.0), arrivals(name))
    modes = {(nav.t_ns - T0_NS) * 1e-9: nav.mode for nav in navs(outputs)}
    assert {mode for t_s, mode in modes.items() if 5.0 < t_s < BREAKS_S} == {Mode.AIDED}
    late_s = BREAKS_S + OVER + 1.0
    assert {mode for t_s, mode in modes.items() if t_s > late_s} == {Mode.ALIGNING}
    heard = [nav for nav in navs(outputs) if nav.t_ns > T0_NS + late_s * 1e9]
    assert all(nav.fix_age_s is not None for nav in heard)


def test_it_does_not_depend_on_batches_nor_on_who_runs_it() -> None:
    config = configuration(voyage().scenario, filter={"history_s": 1.0})
    wrong = arrivals("forces in g", samples=1)
    outputs = fed(Estimator(config, 2.0), wrong)
    for samples in (5, 50):
        again = navs(fed(Estimator(config, 2.0), arrivals("forces in g", samples)))
        assert [nav.mode for nav in again] == [nav.mode for nav in navs(outputs)]
    notes = [output for output in outputs if isinstance(output, Checkpoint)]
    (note,) = [n for n in notes if T0_NS + 26.5e9 < n.t_ns < T0_NS + 27.5e9]  # on its way to it
    said = [o for o in outputs if not isinstance(o, SavedState | Checkpoint)][note.said :]
    went_on = fed(Estimator(config, 2.0, note), wrong[note.received :])
    assert [msgspec.msgpack.encode(nav) for nav in navs(went_on)] == [
        msgspec.msgpack.encode(nav) for nav in navs(said)
    ]


def test_no_smoother_believes_it_either() -> None:
    smoothed = SmoothedPass(configuration(voyage().scenario), 2.0)
    for measurement in arrivals("forces twice"):
        assert not list(smoothed.feed(measurement))
    late = [n for n in navs(list(smoothed.finish())) if n.t_ns > T0_NS + (BREAKS_S + 6.0) * 1e9]
    assert {nav.mode for nav in late} == {Mode.ALIGNING}


def ends(rows: np.ndarray) -> np.ndarray:
    """When samples end that come as fast as they say."""
    return np.rint(1e9 * np.cumsum(rows[:, 0])).astype(np.int64)


@pytest.mark.parametrize(
    ("pause_s", "is_told", "believed"),
    [(0.01, False, True), (2.0, False, False), (2.0, True, True)],
)
def test_samples_are_as_long_as_the_time_in_which_they_come(
    pause_s: float, is_told: bool, believed: bool
) -> None:
    """Unless somebody says that the time between was left out."""
    rows = np.zeros((50, 8))
    rows[:, 0], rows[:, FORCE.stop - 1] = 0.02, -0.02 * G_M_S2
    at = earth.lla_to_ecef(0.7, 2.0, 0.0)
    level = State.at(earth.C_en(0.7, 2.0), np.zeros(3), at, np.zeros((N_STATES, N_STATES)))
    credible = Credible()
    for second in range(4):
        credible.add(ends(rows) + round(second * (1.0 + pause_s) * 1e9), rows)
        credible.end_second(level)
        if is_told:
            credible.pass_over()
    assert credible.is_credible is believed


@pytest.mark.parametrize("pitch_deg", [-85.0, -60.0, 0.0, 80.0])
@pytest.mark.parametrize("gains_m_s2", [0.0, 4.5])
def test_steep_and_fast_vehicles_are_believed(pitch_deg: float, gains_m_s2: float) -> None:
    """A dive, and a boat at 30 knots in a turn of 50 m."""
    at = earth.lla_to_ecef(0.7, 2.0, -30.0)
    C_en = earth.C_en(0.7, 2.0)
    C_nb = np.asarray(C_from_euler(0.1, np.radians(pitch_deg), 1.0))
    state = State.at(C_en @ C_nb, np.zeros(3), at, np.zeros((N_STATES, N_STATES)))
    f_b = C_nb.T @ (np.array([gains_m_s2, 0.0, 0.0]) - earth.gravity_n(0.7, -30.0))
    rows = np.zeros((20, 8))
    rows[:, 0], rows[:, FORCE] = 0.05, 0.05 * f_b
    credible = Credible()
    for _ in range(2 * OVER):
        credible.add(ends(rows), rows)
        credible.pass_over()
        credible.end_second(state)
    assert credible.is_credible
    assert len(credible.seconds) == OVER
    for _ in range(ENOUGH):
        credible.add(ends(rows), rows * [1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 1.0])
        credible.pass_over()
        credible.end_second(state)
    assert not credible.is_credible


def test_a_vehicle_may_roll_all_the_time() -> None:
    """Ten seconds at 60 deg/s, which its attitude follows."""
    at, C_en = earth.lla_to_ecef(0.7, 2.0, -30.0), earth.C_en(0.7, 2.0)
    credible = Credible()
    for second in range(10):
        rows = np.zeros((50, 8))
        rows[:, 0], rows[:, 1] = 0.02, 0.02 * np.radians(60.0)
        for n, row in enumerate(rows):
            C_nb = np.asarray(
                C_from_euler(np.radians(60.0) * (second + (n + 0.5) * 0.02), 0.3, 1.0)
            )
            row[FORCE] = -0.02 * C_nb.T @ earth.gravity_n(0.7, -30.0)
        C_nb = np.asarray(C_from_euler(np.radians(60.0) * (second + 1.0), 0.3, 1.0))
        credible.add(ends(rows), rows)
        credible.pass_over()
        credible.end_second(State.at(C_en @ C_nb, np.zeros(3), at, np.zeros((N_STATES, N_STATES))))
        assert credible.is_credible
    level = np.asarray(C_from_euler(0.0, 0.3, 1.0))  # what says that it does not is not believed
    for _ in range(ENOUGH):
        credible.add(ends(rows), rows)
        credible.pass_over()
        credible.end_second(State.at(C_en @ level, np.zeros(3), at, np.zeros((N_STATES, N_STATES))))
    assert not credible.is_credible


def test_what_stands_in_for_lost_samples_tells_nothing() -> None:
    credible, rows = Credible(), np.ones((5, 8))
    credible.add(ends(rows), rows)
    credible.end_second(
        State.at(np.eye(3), np.zeros(3), np.ones(3), np.zeros((N_STATES, N_STATES)))
    )
    assert credible.seconds == ()
