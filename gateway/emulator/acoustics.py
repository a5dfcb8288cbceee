"""The acoustic array: sound on its way between a moving array and moored beacons.

The array pings, the beacon answers after its turnaround, the vehicle moves meanwhile. The
instrument turns the travel time into a range with the sound speed it was told, and measures the
angles when the reply arrives.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drivers import registry
from drivers.records import UsblRecord
from gateway.config.blocks import Beacon
from gateway.emulator.scenario import Scenario, UsblModel, codec_options
from gateway.emulator.streams import Emission, generator
from gateway.emulator.trajectory import Trajectory
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler

Array = NDArray[np.float64]

_FIXED_POINT_ROUNDS = 8
"""Each gains a factor c / v, more than 100: far beyond rounding."""


@dataclass(frozen=True, slots=True)
class AcousticErrors:
    """Constant errors of an array (rad, rad, 1); ``theta`` (3,) rad turns it in body axes."""

    theta: Array
    bearing: float
    elevation: float
    range_scale: float


@dataclass(frozen=True, slots=True)
class Fixes:
    """What the array measured, one row a reply, in the order of the pings.

    ``t_tx``, ``t_rx`` (n,) s: ping (one way: the beacon's) and reply at the array. ``beacon`` (n,)
    names. ``bearing``, ``elevation`` (n,) rad in array axes, ``slant_range`` (n,) m. ``outlier``
    (n,) bool.
    """

    t_tx: Array
    t_rx: Array
    beacon: list[str]
    bearing: Array
    elevation: Array
    slant_range: Array
    outlier: NDArray[np.bool_]


def acoustic_errors(scenario: Scenario, name: str, model: UsblModel) -> AcousticErrors:
    """Constant errors of a device: given in the scenario or drawn from its prior."""
    draw = generator(scenario.seed, name, "constants").standard_normal(6)
    given, prior = model.errors, model.prior

    def choose(value: float | None, sigma: float, z: float) -> float:
        return float(sigma * z) if value is None else value

    theta = given.mounting_deg if given.mounting_deg is not None else prior.mounting_deg * draw[:3]
    return AcousticErrors(
        theta=np.deg2rad(theta),
        bearing=np.deg2rad(choose(given.bearing_deg, prior.bearing_deg, draw[3])),
        elevation=np.deg2rad(choose(given.elevation_deg, prior.elevation_deg, draw[4])),
        range_scale=choose(given.range_scale, prior.range_scale, draw[5]),
    )


def measure(scenario: Scenario, name: str, model: UsblModel, trajectory: Trajectory) -> Fixes:
    """All replies of a scenario."""
    array = _MovingArray(scenario, name, model, trajectory)
    t_ping = np.arange(0.0, scenario.duration_s, model.period_s)
    names = list(scenario.beacons)
    which = np.arange(t_ping.size) % len(names)
    beacons = [scenario.beacons[n] for n in names]
    b_e = np.stack([_position(b) for b in beacons])[which]
    turnaround = np.array([1e-3 * b.turnaround_ms for b in beacons])[which]
    two_way = np.array([b.travel == "two_way" for b in beacons])[which]

    t_reply, t_rx = array.travel(t_ping, b_e, turnaround, two_way)
    bearing, elevation = array.angles(t_rx, b_e)
    travel_time = np.where(two_way, 0.5 * (t_rx - t_ping - turnaround), t_rx - t_reply)
    slant_range = scenario.sound_speed_m_s * travel_time * (1.0 + array.errors.range_scale)
    noise = _draw_noise(scenario, name, model, t_ping.size)
    slant_range += noise.slant_range
    heard = noise.heard & (slant_range > 0.0) & (slant_range < model.max_range_m)
    return Fixes(
        t_tx=t_ping[heard],
        t_rx=t_rx[heard],
        beacon=[names[k] for k in which[heard]],
        bearing=_wrap(bearing + noise.bearing)[heard],
        elevation=_fold(elevation + noise.elevation)[heard],
        slant_range=slant_range[heard],
        outlier=noise.outlier[heard],
    )


def usbl_stream(
    scenario: Scenario, name: str, model: UsblModel, trajectory: Trajectory, start_unix_s: float
) -> Iterator[Emission]:
    """Sentences of an array in the order they leave it.

    ``Emission.t`` is when the first byte leaves: the latency after the reply. A fix that the format
    cannot say (LXT: a beacon above the array) is an emission without bytes.
    """
    encode = sentence_writer(model)
    fixes = measure(scenario, name, model, trajectory)
    t_out = fixes.t_rx + 1e-3 * model.clock.latency_ms
    xyz = _cartesian(fixes.bearing, fixes.elevation, fixes.slant_range).tolist()
    for k in np.argsort(t_out, kind="stable"):
        if t_out[k] > scenario.duration_s:
            break
        record = UsblRecord(
            t_rx_ns=0,
            beacon=fixes.beacon[k],
            bearing_deg=float(np.rad2deg(fixes.bearing[k])),
            elevation_deg=float(np.rad2deg(fixes.elevation[k])),
            slant_range_m=float(fixes.slant_range[k]),
            xyz_m=(xyz[k][0], xyz[k][1], xyz[k][2]),
            t_device_s=float(start_unix_s + t_out[k]),
        )
        try:
            sentence = encode(record)
        except ValueError:
            sentence = b""
        yield Emission(float(t_out[k]), name, sentence)


def sentence_writer(model: UsblModel) -> Callable[[UsblRecord], bytes]:
    """The device's ``encode`` with its options bound."""
    codec, options = registry.lookup(model.codec), codec_options(model)
    return lambda record: codec.encode(record, options)


class _MovingArray:
    """The array's true place and axes along the trajectory, and the sound that reaches it."""

    def __init__(
        self, scenario: Scenario, name: str, model: UsblModel, trajectory: Trajectory
    ) -> None:
        self.errors = acoustic_errors(scenario, name, model)
        self._trajectory = trajectory
        self._l_bu_b = np.array(model.lever_arm_m)
        roll, pitch, heading = np.deg2rad(model.mounting_deg)
        C_bu_nominal = C_from_euler(roll, pitch, heading)
        self._C_bu = Rotation.from_rotvec(self.errors.theta).as_matrix() @ C_bu_nominal
        self._c = scenario.true_sound_speed_m_s or scenario.sound_speed_m_s

    def travel(
        self, t_ping: Array, b_e: Array, turnaround: Array, two_way: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """When each beacon sends (a one-way beacon at the ping) and when the array hears it."""
        out = np.linalg.norm(self._position(t_ping) - b_e, axis=-1) / self._c
        t_reply = t_ping + np.where(two_way, out + turnaround, 0.0)
        t_rx = t_reply + out
        for _ in range(_FIXED_POINT_ROUNDS):
            t_rx = t_reply + np.linalg.norm(self._position(t_rx) - b_e, axis=-1) / self._c
        return t_reply, t_rx

    def angles(self, t_rx: Array, b_e: Array) -> tuple[Array, Array]:
        """True bearing and elevation in the true array axes, with the constant offsets."""
        pose = self._trajectory.pose(t_rx)
        r_b = np.einsum("nij,ni->nj", pose.C_eb, b_e - pose.r_e) - self._l_bu_b
        x, y, z = np.moveaxis(r_b @ self._C_bu, -1, 0)
        bearing = np.arctan2(y, x) + self.errors.bearing
        return bearing, np.arctan2(-z, np.hypot(x, y)) + self.errors.elevation

    def _position(self, t: Array) -> Array:
        pose = self._trajectory.pose(t)
        r_e: Array = pose.r_e + pose.C_eb @ self._l_bu_b
        return r_e


@dataclass(frozen=True, slots=True)
class _Noise:
    bearing: Array
    elevation: Array
    slant_range: Array
    outlier: NDArray[np.bool_]
    heard: NDArray[np.bool_]


def _draw_noise(scenario: Scenario, name: str, model: UsblModel, n: int) -> _Noise:
    """White noise, multipath and missed replies; the same draws whatever is switched on."""

    def rng(what: str) -> np.random.Generator:  # one each: a longer run begins like a shorter one
        return generator(scenario.seed, name, what)

    white = rng("noise").standard_normal((n, 3))
    outlier = rng("outlier").random(n) < model.outliers.probability
    heard = rng("missed").random(n) >= model.missed_probability
    longer = model.outliers.extra_range_m * rng("longer").standard_exponential(n)
    aside = np.deg2rad(model.outliers.angle_deg) * rng("aside").standard_normal((n, 2))
    return _Noise(
        bearing=np.deg2rad(model.noise.bearing_deg) * white[:, 0] + outlier * aside[:, 0],
        elevation=np.deg2rad(model.noise.elevation_deg) * white[:, 1] + outlier * aside[:, 1],
        slant_range=model.noise.range_m * white[:, 2] + outlier * longer,
        outlier=outlier,
        heard=heard,
    )


def _position(beacon: Beacon) -> Array:
    lat, lon = np.deg2rad([beacon.lat_deg, beacon.lon_deg])
    return earth.lla_to_ecef(lat, lon, beacon.height_m)


def _cartesian(bearing: Array, elevation: Array, slant_range: Array) -> Array:
    level = slant_range * np.cos(elevation)
    return np.stack(
        [level * np.cos(bearing), level * np.sin(bearing), -slant_range * np.sin(elevation)],
        axis=-1,
    )


def _wrap(angle: Array) -> Array:
    """Into (-pi, pi]."""
    wrapped: Array = np.pi - (np.pi - angle) % (2.0 * np.pi)
    return wrapped


def _fold(elevation: Array) -> Array:
    """Into [-pi/2, pi/2], as an instrument would state it."""
    return np.arcsin(np.sin(elevation))
