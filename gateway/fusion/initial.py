"""The first state: pose, covariance and noise densities from the words of the configuration."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gateway.config import (
    Config,
    DepthDevice,
    DvlDevice,
    GnssDevice,
    HeadingDevice,
    ImuNoise,
    Initial,
    LblDevice,
    UsblDevice,
)
from gateway.config import Filter as FilterChoice
from gateway.fusion.errors import FAMILY
from gateway.fusion.observation import AcousticArray, Loose, Model, Mount, Responder, Transponder
from gateway.fusion.state import (
    ATT,
    BA,
    BG,
    DALPHA,
    DBETA,
    DKD,
    LATENCY,
    LEVER,
    N_FULL,
    POS,
    THETA,
    VEL,
    State,
)
from gateway.fusion.usbl import ArrayGeometry
from gateway.nav.attitude import C_from_euler, euler_error_map
from gateway.nav.covariance import N_CORE
from gateway.nav.earth import C_en, lla_to_ecef

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

G0 = 9.80665
"""Standard gravity (m/s^2), the unit behind g and ug."""
DEG_H = np.radians(1.0) / 3600.0
UG = 1e-6 * G0
SWAY_SD_DEG = 10.0
"""1-sigma of roll and pitch of which nothing is known."""
ANY_HEADING_SD_DEG = 180.0 / math.sqrt(3.0)
"""1-sigma of a heading that may be any."""


def noise_densities(noise: ImuNoise) -> Array:
    """(4,) of angle and velocity random walk and of the bias walks, SI.  # (M.17), (M.18)

    A bias with a correlation time tau walks with density 2 sigma^2 / tau, a constant one does not.
    """
    gyro = noise.gyro_bias_deg_h * DEG_H
    accel = noise.accel_bias_ug * UG
    tau_g, tau_a = noise.gyro_bias_correlation_s, noise.accel_bias_correlation_s
    return np.array(
        [
            (np.radians(noise.angle_random_walk_deg_sqrt_h) / 60.0) ** 2,
            (noise.velocity_random_walk_ug_sqrt_hz * UG) ** 2,
            2.0 * gyro**2 / tau_g if tau_g else 0.0,
            2.0 * accel**2 / tau_a if tau_a else 0.0,
        ]
    )


def initial_state(config: Config) -> State:
    """State and covariance at the first sample; what has no prior is not estimated.  # (M.19)"""
    first, sigma = config.initial, config.initial.sigma
    lat, lon = np.radians(first.lat_deg), np.radians(first.lon_deg)
    (roll, pitch, heading), attitude_sd = np.radians(attitude_deg(first))
    C = C_en(lat, lon)
    M = C @ euler_error_map(pitch, heading)
    P = np.zeros((N_FULL, N_FULL))
    P[ATT, ATT] = M @ np.diag(attitude_sd**2) @ M.T
    P[VEL, VEL] = np.eye(3) * sigma.velocity_m_s**2
    P[POS, POS] = C @ np.diag(np.square(sigma.position_m)) @ C.T
    noise = config.imu[1].noise
    _set(P, BG, noise.gyro_bias_deg_h * DEG_H)
    _set(P, BA, noise.accel_bias_ug * UG)
    for array in config.usbl.values():
        _set(P, THETA, np.radians(array.prior.mounting_deg))
        _set(P, DALPHA, np.radians(array.prior.elevation_deg))
        _set(P, DBETA, np.radians(array.prior.bearing_deg))
    for device in config.acoustic.values():
        _widen(P, DKD, device.prior.range_scale)
        _widen(P, LEVER, device.prior.lever_arm_m)
        _widen(P, LATENCY, device.prior.latency_ms * 1e-3)
    columns = np.flatnonzero((P.diagonal() > 0.0) | (np.arange(N_FULL) < N_CORE))
    return State.at(
        C @ C_from_euler(roll, pitch, heading),
        C @ np.asarray(first.velocity_ned_m_s),
        lla_to_ecef(lat, lon, first.height_m),
        P[np.ix_(columns, columns)],
        columns,
    )


def attitude_deg(first: Initial) -> tuple[Triple, Triple]:
    """Attitude and its 1-sigma: as given, or what is known before it has been found."""
    given, sigma = first.attitude_deg, first.sigma.attitude_deg
    if first.align is None:
        assert given is not None and sigma is not None
        return given, sigma
    if first.align.heading == "config":
        assert given is not None and sigma is not None
        return (0.0, 0.0, given[2]), (SWAY_SD_DEG, SWAY_SD_DEG, sigma[2])
    return (0.0, 0.0, 0.0), (SWAY_SD_DEG, SWAY_SD_DEG, ANY_HEADING_SD_DEG)


def model(config: Config) -> Model:
    """Everything the filter takes as known."""
    arrays = {name: _array(device) for name, device in config.usbl.items()}
    transducers = {name: _transducer(device) for name, device in config.lbl.items()}
    return Model(
        error=FAMILY[config.filter.error],
        q=noise_densities(config.imu[1].noise),
        gate=config.filter.innovation_gate,
        sound_speed=config.sound_speed_m_s,
        arrays=arrays | transducers,
        beacons={
            name: Transponder(
                lla_to_ecef(np.radians(b.lat_deg), np.radians(b.lon_deg), b.height_m),
                b.turnaround_ms * 1e-3,
                b.travel == "two_way",
            )
            for name, b in config.moored.items()
        },
        targets={
            name: Responder(b.turnaround_ms * 1e-3, b.travel == "two_way")
            for name, b in config.targets.items()
        },
        mounts=_mounts(config),
        loose=_loose(config.filter),
        robust=config.filter.robust,
        adaptive_noise=config.filter.adaptive_noise,
    )


def _array(device: UsblDevice) -> AcousticArray:
    """An array and its noise."""
    noise = device.noise
    angles = np.radians([noise.elevation_deg, noise.bearing_deg])
    return AcousticArray(
        ArrayGeometry(np.asarray(device.lever_arm_m), mounting(device.mounting_deg)),
        np.array([*angles, noise.range_m]),
        noise.range_rate_m_s,
        np.array(device.elements_m or ((0.0, 0.0, 0.0),)),
        device.radial_rate == "elements",
        (math.radians(noise.tilt_deg), math.radians(noise.heading_deg)),
        device.navigates_by == "gateway",
    )


def _transducer(device: LblDevice) -> AcousticArray:
    """An array of one element, which has no angles."""
    return AcousticArray(
        ArrayGeometry(np.asarray(device.lever_arm_m), np.eye(3)),
        np.array([np.inf, np.inf, device.noise.range_m]),
        device.noise.range_rate_m_s,
    )


def _mounts(config: Config) -> dict[str, Mount]:
    """Where the sensors sit that measure the vehicle itself, by name."""
    mounts: dict[str, Mount] = {}
    for name, device in config.devices.items():
        match device:
            case GnssDevice(lever_arm_m=lever_arm) | DepthDevice(lever_arm_m=lever_arm):
                mounts[name] = Mount(np.asarray(lever_arm), np.eye(3))
            case DvlDevice(lever_arm_m=lever_arm, mounting_deg=angles):
                mounts[name] = Mount(np.asarray(lever_arm), mounting(angles))
            case HeadingDevice(mounting_deg=angles):
                mounts[name] = Mount(np.zeros(3), mounting(angles))
    return mounts


def _loose(choice: FilterChoice) -> Loose | None:
    """How acoustic fixes are coupled."""
    if choice.coupling == "tight":
        return None
    return Loose(choice.loose_sigma_m if choice.loose_noise == "fixed" else None)


def mounting(angles_deg: Sequence[float]) -> Array:
    """(3, 3) C_bs of roll, pitch, heading of a sensor's axes in the body (degrees)."""
    return C_from_euler(*np.radians(angles_deg))


def _widen(P: Array, where: slice | int, sigma: float) -> None:
    """The same where another device may have a say: the larger counts."""
    _set(P, where, max(sigma, float(np.sqrt(P.diagonal()[where].max()))))


def _set(P: Array, where: slice | int, sigma: float) -> None:
    """Set variances of independent states."""
    i = np.arange(N_FULL)[where]
    P[i, i] = sigma**2
