"""One voyage of the emulator, made once for a study: truth, perfect increments, perfect replies.

Every ping is answered by all beacons, as in the seeds; the emulator's own player asks them in turn.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.config import Config
from gateway.emulator import acoustics, twin
from gateway.emulator.scenario import ImuModel, Scenario, UsblErrors, UsblModel
from gateway.emulator.sensors import increments
from gateway.emulator.trajectory import Trajectory
from gateway.errors import ConfigError
from gateway.nav.earth import C_en
from gateway.schema import build

Array = NDArray[np.float64]
Times = NDArray[np.int64]

SCENARIOS = Path(__file__).parent / "scenarios"
EPOCH_S = 1.0
"""Distance of the moments at which a solution is compared with the truth."""


@dataclass(frozen=True)
class Truth:
    """The true motion at the epochs.

    ``t_s`` (m,); ``C_eb``, ``C_en`` (m, 3, 3); ``v_eb_e`` (m/s), ``r_e`` (m) (m, 3).
    """

    t_s: Array
    C_eb: Array
    C_en: Array
    v_eb_e: Array
    r_e: Array


@dataclass(frozen=True)
class Replies:
    """What a perfect array hears, in the order of time.

    ``t_ping_ns``, ``t_ns`` (k,) ping and reply at the array; ``beacon`` (k) names; ``direction_u``
    (k, 3) unit vectors to the beacon in nominal array axes; ``slant_range`` (k,) m.
    """

    t_ping_ns: Times
    t_ns: Times
    beacon: list[str]
    direction_u: Array
    slant_range: Array


@dataclass(frozen=True)
class Voyage:
    """What all runs of a study share.

    Attributes
    ----------
    scenario, config
        The voyage and the gateway's configuration that matches it, with the true first state.
    t_ns, rows
        (n,) end of each IMU interval; (n, 8) perfect increments as the strapdown takes them.
    replies
        Perfect fixes.
    truth
        At the epochs, whose first is 0 and whose spacing is ``EPOCH_S``.
    """

    scenario: Scenario
    config: Config
    t_ns: Times
    rows: Array
    replies: Replies
    truth: Truth

    @property
    def imu(self) -> tuple[str, ImuModel]:
        """Name and model of the IMU."""
        return next((n, m) for n, m in self.scenario.devices.items() if isinstance(m, ImuModel))

    @property
    def usbl(self) -> tuple[str, UsblModel]:
        """Name and model of the array."""
        return usbl_of(self.scenario)


def load(name: str) -> Scenario:
    """One of the packaged scenarios of the studies."""
    return twin.load(SCENARIOS / f"{name}.yaml")


def make(scenario: Scenario) -> Voyage:
    """Compute all that does not depend on the errors."""
    trajectory = Trajectory(scenario.trajectory, scenario.duration_s)
    imu = next(m for m in scenario.devices.values() if isinstance(m, ImuModel))
    dt = 1.0 / imu.rate_hz
    t_imu = np.asarray((np.arange(round(scenario.duration_s * imu.rate_hz)) + 1) * dt, np.float64)
    rows = np.zeros((t_imu.size, 8))
    rows[:, 0] = dt
    rows[:, 1:7] = increments(trajectory, t_imu, dt)
    return Voyage(
        scenario=scenario,
        config=_config(scenario),
        t_ns=np.rint(t_imu * 1e9).astype(np.int64),
        rows=rows,
        replies=_replies(scenario, trajectory),
        truth=_truth(trajectory, np.arange(0.0, scenario.duration_s + 1e-9, EPOCH_S)),
    )


def refit(of: Voyage, scenario: Scenario) -> Voyage:
    """The same motion and IMU rate with another scenario's array, beacons or first state."""
    trajectory = Trajectory(scenario.trajectory, scenario.duration_s)
    return replace(
        of,
        scenario=scenario,
        config=_config(scenario),
        replies=_replies(scenario, trajectory),
    )


def usbl_of(scenario: Scenario) -> tuple[str, UsblModel]:
    """Name and model of the array of a scenario."""
    return next((n, m) for n, m in scenario.devices.items() if isinstance(m, UsblModel))


def _config(scenario: Scenario) -> Config:
    """The matching configuration; its first state is replaced by every run's own."""
    faults: list[str] = []
    config = build(Config, twin.gateway_config(scenario), faults)
    if config is None:
        raise ConfigError(faults)
    return config


def _truth(trajectory: Trajectory, t_s: Array) -> Truth:
    pose, g = trajectory.pose(t_s), trajectory.geodetic(t_s)
    C = C_en(g.lat, g.lon)
    return Truth(t_s, pose.C_eb, C, np.einsum("mij,mj->mi", C, g.v_eb_n), pose.r_e)


def _replies(scenario: Scenario, trajectory: Trajectory) -> Replies:
    """Ask every beacon at every ping, without any error."""
    name, model = usbl_of(scenario)
    perfect = msgspec.structs.replace(
        model,
        noise=msgspec.structs.replace(model.noise, bearing_deg=0.0, elevation_deg=0.0, range_m=0.0),
        errors=UsblErrors(
            mounting_deg=(0.0, 0.0, 0.0), bearing_deg=0.0, elevation_deg=0.0, range_scale=0.0
        ),
    )
    heard = [
        (beacon, acoustics.measure(alone, name, perfect, trajectory))
        for beacon, block in scenario.moored.items()
        for alone in [msgspec.structs.replace(scenario, beacons={beacon: block})]
    ]
    t_tx = np.concatenate([fixes.t_tx for _, fixes in heard])
    t_rx = np.concatenate([fixes.t_rx for _, fixes in heard])
    bearing = np.concatenate([fixes.bearing for _, fixes in heard])
    elevation = np.concatenate([fixes.elevation for _, fixes in heard])
    slant_range = np.concatenate([fixes.slant_range for _, fixes in heard])
    beacons = [beacon for beacon, fixes in heard for _ in fixes.t_rx]
    order = [k for k in np.argsort(t_rx, kind="stable") if t_rx[k] < scenario.duration_s]
    level = np.cos(elevation)
    direction = np.stack(
        [level * np.cos(bearing), level * np.sin(bearing), -np.sin(elevation)], axis=-1
    )
    return Replies(
        t_ping_ns=np.rint(t_tx[order] * 1e9).astype(np.int64),
        t_ns=np.rint(t_rx[order] * 1e9).astype(np.int64),
        beacon=[beacons[k] for k in order],
        direction_u=direction[order],
        slant_range=slant_range[order],
    )
