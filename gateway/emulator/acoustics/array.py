"""What an acoustic array measures of the replies: range, direction, and the same at its elements.

The array pings, the beacon answers after its turnaround, the vehicle moves meanwhile. The
instrument turns the travel time into a range with the sound speed it was told, and measures the
angles when the reply arrives.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gateway.emulator.acoustics.timing import timeout_s
from gateway.emulator.acoustics.water import Ear, Mask, Ways, moorings, slope
from gateway.emulator.faults.sound import astray
from gateway.emulator.scenario import Scenario, UsblModel
from gateway.emulator.streams import Draws, generator
from gateway.emulator.trajectory import Trajectory
from gateway.nav.attitude import C_from_euler

Array = NDArray[np.float64]

_ROUNDS = 4
"""From a tenth of a millisecond, each gains a factor c / v: beyond rounding."""


@dataclass(frozen=True, slots=True)
class AcousticErrors:
    """Constant errors of an array (rad, rad, 1); ``theta`` (3,) rad turns it in body axes.

    ``lever_arm`` (3,) m and ``latency`` s: true less stated.
    """

    theta: Array
    bearing: float
    elevation: float
    range_scale: float
    lever_arm: Array = field(default_factory=lambda: np.zeros(3))
    latency: float = 0.0


@dataclass(frozen=True, slots=True)
class Fixes:
    """What the array measured, one row a reply, in the order of the pings.

    ``t_tx``, ``t_rx`` (n,) s: ping (one way: the beacon's) and reply at the array. ``beacon`` (n,)
    names. ``bearing``, ``elevation`` (n,) rad in array axes, ``slant_range`` (n,) m. ``arrival``
    (n, elements) s: how much later than ``t_rx`` each element heard it. ``range_rate`` (n,) m/s:
    the one it makes of all elements; ``element_rates`` (n, elements) those of each. ``outlier``
    (n,) bool. ``unanswered``: pings without a reply, s, and to whom.
    """

    t_tx: Array
    t_rx: Array
    beacon: list[str]
    bearing: Array
    elevation: Array
    slant_range: Array
    arrival: Array
    range_rate: Array
    element_rates: Array
    outlier: Mask
    unanswered: list[tuple[float, str]]


def acoustic_errors(scenario: Scenario, name: str, model: UsblModel) -> AcousticErrors:
    """Constant errors of a device: given in the scenario or drawn from its prior."""
    draw = generator(scenario.seed, name, "constants").standard_normal(6)
    installed = generator(scenario.seed, name, "installation").standard_normal(4)
    given, prior = model.errors, model.prior

    def choose(value: float | None, sigma: float, z: float) -> float:
        return float(sigma * z) if value is None else value

    theta = given.mounting_deg if given.mounting_deg is not None else prior.mounting_deg * draw[:3]
    lever = given.lever_arm_m
    return AcousticErrors(
        theta=np.deg2rad(theta),
        bearing=np.deg2rad(choose(given.bearing_deg, prior.bearing_deg, draw[3])),
        elevation=np.deg2rad(choose(given.elevation_deg, prior.elevation_deg, draw[4])),
        range_scale=choose(given.range_scale, prior.range_scale, draw[5]),
        lever_arm=prior.lever_arm_m * installed[:3] if lever is None else np.array(lever),
        latency=1e-3 * choose(given.latency_ms, prior.latency_ms, installed[3]),
    )


def measure(scenario: Scenario, name: str, model: UsblModel, trajectory: Trajectory) -> Fixes:
    """All replies of a scenario."""
    listening = Listening(scenario, name, model, trajectory)
    return listening.next(listening.t_ping.size)


class Listening:
    """An array at work: its replies, some pings at a time."""

    def __init__(
        self, scenario: Scenario, name: str, model: UsblModel, trajectory: Trajectory
    ) -> None:
        self._array = _MovingArray(scenario, name, model, trajectory)
        self._asked = moorings(scenario, model.beacons)
        self._scenario, self._name, self._model = scenario, name, model
        self._draws = Draws(scenario.seed, name)
        self.t_ping = np.arange(0.0, scenario.duration_s, model.period_s)

    def blocks(self, least: int) -> Iterator[tuple[Fixes, float]]:
        """All replies, some pings at a time, with the moment before which no later one is heard."""
        turns = len(self._asked) * -(-least // len(self._asked))
        while self.t_ping.size:
            fixes = self.next(turns)
            yield fixes, float(self.t_ping[0]) if self.t_ping.size else np.inf

    def next(self, n: int) -> Fixes:
        """The replies to the next ``n`` pings; whole turns of the beacons, but at the end."""
        scenario, array = self._scenario, self._array
        t_ping, self.t_ping = self.t_ping[:n], self.t_ping[n:]
        ways = Ways.in_turn(array.ear, t_ping, self._model.period_s, self._asked)
        names = [self._asked[k % len(self._asked)].name for k in range(t_ping.size)]
        noise = self._noise(t_ping)

        bearing, elevation = array.angles(ways.t_rx, ways.b_e)
        bearing, elevation = _wrap(bearing + noise.bearing), _fold(elevation + noise.elevation)
        slant_range = scenario.sound_speed_m_s * ways.one_way * (1.0 + array.errors.range_scale)
        slant_range += noise.slant_range
        near = (slant_range > 0.0) & (slant_range < self._model.max_range_m)
        soon = ways.t_rx - t_ping <= timeout_s(self._model, scenario.sound_speed_m_s)
        heard = noise.heard & ways.answered & near & soon

        arrivals = np.where(
            noise.outlier[:, None], array.echo(bearing, elevation), array.arrivals(ways)
        )
        rates = array.rates(ways)
        return Fixes(
            t_tx=t_ping[heard],
            t_rx=ways.t_rx[heard],
            beacon=[names[k] for k in np.flatnonzero(heard)],
            bearing=bearing[heard],
            elevation=elevation[heard],
            slant_range=slant_range[heard],
            arrival=(arrivals + noise.arrival)[heard],
            range_rate=(rates.mean(axis=-1) + noise.range_rate)[heard],
            element_rates=(rates + noise.element_rates)[heard],
            outlier=noise.outlier[heard],
            unanswered=[(float(t_ping[k]), names[k]) for k in np.flatnonzero(~heard)],
        )

    def _noise(self, t_ping: Array) -> "_Noise":
        """White noise, multipath and missed replies; the same draws whatever is switched on."""
        rng, model = self._draws, self._model
        n, elements = t_ping.size, max(1, len(model.elements_m))
        white = rng("noise").standard_normal((n, 3))
        outlier = rng("outlier").random(n) < model.outliers.probability
        outlier |= astray(self._scenario, self._name, t_ping, model.period_s, rng)
        heard = rng("missed").random(n) >= model.missed_probability
        longer = model.outliers.extra_range_m * rng("longer").standard_exponential(n)
        aside = np.deg2rad(model.outliers.angle_deg) * rng("aside").standard_normal((n, 2))
        arrival = rng("arrival").standard_normal((n, elements))
        rate = rng("rate").standard_normal(n)
        rates = rng("element rates").standard_normal((n, elements))
        return _Noise(
            bearing=np.deg2rad(model.noise.bearing_deg) * white[:, 0] + outlier * aside[:, 0],
            elevation=np.deg2rad(model.noise.elevation_deg) * white[:, 1] + outlier * aside[:, 1],
            slant_range=model.noise.range_m * white[:, 2] + outlier * longer,
            arrival=1e-6 * model.element_noise_us * arrival,
            range_rate=model.noise.range_rate_m_s * rate,
            element_rates=model.noise.range_rate_m_s * rates,
            outlier=outlier,
            heard=heard,
        )


def direction(bearing: Array, elevation: Array) -> Array:
    """Unit vectors towards, (n, 3) forward, starboard, down."""
    level = np.cos(elevation)
    return np.stack([level * np.cos(bearing), level * np.sin(bearing), -np.sin(elevation)], axis=-1)


class _MovingArray:
    """The array's true place and axes along the trajectory, and those of its elements."""

    def __init__(
        self, scenario: Scenario, name: str, model: UsblModel, trajectory: Trajectory
    ) -> None:
        self.errors = acoustic_errors(scenario, name, model)
        C_bu_nominal = C_from_euler(*np.deg2rad(model.mounting_deg))
        self._C_bu = Rotation.from_rotvec(self.errors.theta).as_matrix() @ C_bu_nominal
        self._places_u = np.array(model.elements_m or ((0.0, 0.0, 0.0),))
        self._l_bu_b = np.array(model.lever_arm_m) + self.errors.lever_arm
        c = scenario.true_sound_speed_m_s or scenario.sound_speed_m_s
        self._places_b = self._l_bu_b + self._places_u @ self._C_bu.T
        self.ear = Ear(trajectory, self._l_bu_b, c)

    def angles(self, t_rx: Array, b_e: Array) -> tuple[Array, Array]:
        """True bearing and elevation in the true array axes, with the constant offsets."""
        pose = self.ear.trajectory.pose(t_rx)
        r_b = np.einsum("nij,ni->nj", pose.C_eb, b_e - pose.r_e) - self._l_bu_b
        x, y, z = np.moveaxis(r_b @ self._C_bu, -1, 0)
        bearing = np.arctan2(y, x) + self.errors.bearing
        return bearing, np.arctan2(-z, np.hypot(x, y)) + self.errors.elevation

    def arrivals(self, ways: Ways) -> Array:
        """How much later than the array's origin each element hears it, (n, elements) s."""
        places_b = np.broadcast_to(self._places_b, (ways.t_rx.size, *self._places_b.shape))
        later = np.zeros(places_b.shape[:2])
        for _ in range(_ROUNDS):
            pose = self.ear.trajectory.pose((ways.t_rx[:, None] + later).ravel())
            r_e = pose.r_e + np.einsum("nij,nj->ni", pose.C_eb, places_b.reshape(-1, 3))
            way = np.linalg.norm(r_e.reshape(places_b.shape) - ways.b_e[:, None], axis=-1)
            later = (ways.t_reply - ways.t_rx)[:, None] + way / self.ear.sound_speed
        return later

    def echo(self, bearing: Array, elevation: Array) -> Array:
        """The same of a wave from a direction, the array at rest."""
        later: Array = -direction(bearing, elevation) @ self._places_u.T / self.ear.sound_speed
        return later

    def rates(self, ways: Ways) -> Array:
        """Range rate of each element, (n, elements) m/s."""

        def distances(t: Array) -> Array:
            pose = self.ear.trajectory.pose(t)
            r_e = pose.r_e[:, None] + np.einsum("nij,kj->nki", pose.C_eb, self._places_b)
            b_e = ways.b_e + (t - ways.t_rx)[:, None] * ways.v_e
            return np.asarray(np.linalg.norm(r_e - b_e[:, None], axis=-1))

        return slope(distances, ways.t_rx)


@dataclass(frozen=True, slots=True)
class _Noise:
    bearing: Array
    elevation: Array
    slant_range: Array
    arrival: Array
    range_rate: Array
    element_rates: Array
    outlier: Mask
    heard: Mask


def _wrap(angle: Array) -> Array:
    """Into (-pi, pi]."""
    wrapped: Array = np.pi - (np.pi - angle) % (2.0 * np.pi)
    return wrapped


def _fold(elevation: Array) -> Array:
    """Into [-pi/2, pi/2], as an instrument would state it."""
    return np.arcsin(np.sin(elevation))
