"""What an acoustic array measures of the replies: range, direction, and the same at its elements.

The array pings, the beacon answers after its turnaround, the vehicle moves meanwhile. The
instrument turns the travel time into a range with the sound speed it was told, and measures the
angles when the reply arrives.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gateway.emulator.acoustics.water import Ear, Mask, Ways, moorings
from gateway.emulator.faults.sound import astray
from gateway.emulator.scenario import Scenario, UsblModel
from gateway.emulator.streams import generator
from gateway.emulator.trajectory import Trajectory
from gateway.nav.attitude import C_from_euler

Array = NDArray[np.float64]


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
    array = _MovingArray(scenario, name, model, trajectory)
    asked = moorings(scenario, model.beacons)
    t_ping = np.arange(0.0, scenario.duration_s, model.period_s)
    ways = Ways.in_turn(array.ear, t_ping, asked)
    names = [asked[k % len(asked)].name for k in range(t_ping.size)]
    noise = _draw_noise(scenario, name, model, t_ping)

    bearing, elevation = array.angles(ways.t_rx, ways.b_e)
    bearing, elevation = _wrap(bearing + noise.bearing), _fold(elevation + noise.elevation)
    slant_range = scenario.sound_speed_m_s * ways.one_way * (1.0 + array.errors.range_scale)
    slant_range += noise.slant_range
    near = (slant_range > 0.0) & (slant_range < model.max_range_m)
    heard = noise.heard & ways.answered & near

    arrival = [ear.hears(ways.t_reply, ways.b_e) - ways.t_rx for ear in array.elements]
    echo = -direction(bearing, elevation) @ array.places_u.T / array.ear.sound_speed
    arrivals = np.where(noise.outlier[:, None], echo, np.stack(arrival, axis=-1)) + noise.arrival
    rates = np.stack(
        [ear.range_rate(ways.t_rx, ways.b_e, ways.v_e) for ear in array.elements], axis=-1
    )
    return Fixes(
        t_tx=t_ping[heard],
        t_rx=ways.t_rx[heard],
        beacon=[names[k] for k in np.flatnonzero(heard)],
        bearing=bearing[heard],
        elevation=elevation[heard],
        slant_range=slant_range[heard],
        arrival=arrivals[heard],
        range_rate=(rates.mean(axis=-1) + noise.range_rate)[heard],
        element_rates=(rates + noise.element_rates)[heard],
        outlier=noise.outlier[heard],
        unanswered=[(float(t_ping[k]), names[k]) for k in np.flatnonzero(~heard)],
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
        self.places_u = np.array(model.elements_m or ((0.0, 0.0, 0.0),))
        self._l_bu_b = np.array(model.lever_arm_m) + self.errors.lever_arm
        c = scenario.true_sound_speed_m_s or scenario.sound_speed_m_s
        places_b = self._l_bu_b + self.places_u @ self._C_bu.T
        self.ear = Ear(trajectory, self._l_bu_b, c)
        self.elements = [Ear(trajectory, l_b, c) for l_b in places_b]

    def angles(self, t_rx: Array, b_e: Array) -> tuple[Array, Array]:
        """True bearing and elevation in the true array axes, with the constant offsets."""
        pose = self.ear.trajectory.pose(t_rx)
        r_b = np.einsum("nij,ni->nj", pose.C_eb, b_e - pose.r_e) - self._l_bu_b
        x, y, z = np.moveaxis(r_b @ self._C_bu, -1, 0)
        bearing = np.arctan2(y, x) + self.errors.bearing
        return bearing, np.arctan2(-z, np.hypot(x, y)) + self.errors.elevation


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


def _draw_noise(scenario: Scenario, name: str, model: UsblModel, t_ping: Array) -> _Noise:
    """White noise, multipath and missed replies; the same draws whatever is switched on."""

    def rng(what: str) -> np.random.Generator:  # one each: a longer run begins like a shorter one
        return generator(scenario.seed, name, what)

    n, elements = t_ping.size, max(1, len(model.elements_m))
    white = rng("noise").standard_normal((n, 3))
    outlier = rng("outlier").random(n) < model.outliers.probability
    outlier |= astray(scenario, name, t_ping)
    heard = rng("missed").random(n) >= model.missed_probability
    longer = model.outliers.extra_range_m * rng("longer").standard_exponential(n)
    aside = np.deg2rad(model.outliers.angle_deg) * rng("aside").standard_normal((n, 2))
    arrival = rng("arrival").standard_normal((n, elements))
    rate = model.noise.range_rate_m_s * rng("rate").standard_normal(n)
    rates = model.noise.range_rate_m_s * rng("element rates").standard_normal((n, elements))
    return _Noise(
        bearing=np.deg2rad(model.noise.bearing_deg) * white[:, 0] + outlier * aside[:, 0],
        elevation=np.deg2rad(model.noise.elevation_deg) * white[:, 1] + outlier * aside[:, 1],
        slant_range=model.noise.range_m * white[:, 2] + outlier * longer,
        arrival=1e-6 * model.element_noise_us * arrival,
        range_rate=rate,
        element_rates=rates,
        outlier=outlier,
        heard=heard,
    )


def _wrap(angle: Array) -> Array:
    """Into (-pi, pi]."""
    wrapped: Array = np.pi - (np.pi - angle) % (2.0 * np.pi)
    return wrapped


def _fold(elevation: Array) -> Array:
    """Into [-pi/2, pi/2], as an instrument would state it."""
    return np.arcsin(np.sin(elevation))
