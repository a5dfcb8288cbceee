"""The inertial sensor: exact increments of the true motion, its errors, its frames.

A strapped-down integrating IMU gives, for each interval, the integrals of angular rate and specific
force in its own rotating axes; they are computed here by Gauss-Legendre quadrature of the analytic
motion, without any strapdown.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drivers import registry
from drivers.records import ImuRecord
from gateway.emulator.faults.clocks import ImuClock
from gateway.emulator.scenario import ImuModel, Scenario, codec_options
from gateway.emulator.streams import Emission, generator
from gateway.emulator.trajectory import Trajectory
from gateway.nav.attitude import C_from_euler

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_DEG_H = np.deg2rad(1.0) / 3600.0
_UG = 1e-6 * STANDARD_GRAVITY


def increments(trajectory: Trajectory, t_end: Array, dt: float) -> Array:
    """What a perfect IMU accumulates over intervals of length ``dt``.

    Parameters
    ----------
    t_end
        (n,) end of each interval, s.
    dt
        Length of the intervals, s.

    Returns
    -------
    (n, 6) integrals of ``omega_ib_b`` (rad) and ``f_ib_b`` (m/s).
    """
    t = (t_end[:, None] - 0.5 * dt * (1.0 - _NODES)).ravel()
    sensed = np.hstack(trajectory.inertial(t)).reshape(t_end.size, _NODES.size, 6)
    return np.asarray(np.einsum("ijk,j->ik", sensed, 0.5 * dt * _WEIGHTS))


class ImuErrorSource:
    """Errors of one IMU in sensor axes: constant or Gauss-Markov biases and white noise.

    Attributes
    ----------
    bias
        (6,) present bias, rad/s and m/s^2.
    """

    def __init__(self, model: ImuModel, seed: int, name: str) -> None:
        self._dt = 1.0 / model.rate_hz
        self._noise_rng = generator(seed, name, "noise")
        self._drift_rng = generator(seed, name, "drift")
        noise = model.noise
        arw = np.deg2rad(noise.angle_random_walk_deg_sqrt_h) / 60.0
        vrw = noise.velocity_random_walk_ug_sqrt_hz * _UG
        self._white = np.sqrt(self._dt) * np.repeat([arw, vrw], 3)
        self._sigma = np.repeat([noise.gyro_bias_deg_h * _DEG_H, noise.accel_bias_ug * _UG], 3)
        correlation = [noise.gyro_bias_correlation_s, noise.accel_bias_correlation_s]
        self._wanders = any(c is not None for c in correlation)
        decay = [1.0 if c is None else np.exp(-self._dt / c) for c in correlation]
        self._decay = np.repeat(decay, 3)
        drawn = self._sigma * generator(seed, name, "bias").standard_normal(6)
        self.bias = _given(model, drawn)

    def next(self, n: int) -> Array:
        """Errors of the next ``n`` increments, (n, 6) rad and m/s."""
        white = self._white * self._noise_rng.standard_normal((n, 6))
        return np.asarray(white + self._dt * self._biases(n))

    def _biases(self, n: int) -> Array:
        if not self._wanders:
            return np.broadcast_to(self.bias, (n, 6))
        kick = self._sigma * np.sqrt(1.0 - self._decay**2)
        steps = kick * self._drift_rng.standard_normal((n, 6))
        biases = np.empty((n, 6))
        for k, step in enumerate(steps):
            biases[k] = self.bias
            self.bias = self._decay * self.bias + step
        return biases


def imu_stream(
    scenario: Scenario, name: str, model: ImuModel, trajectory: Trajectory, block_s: float
) -> Iterator[Emission]:
    """Frames of an IMU in the order they leave it, computed ``block_s`` at a time."""
    dt, errors = 1.0 / model.rate_hz, ImuErrorSource(model, scenario.seed, name)
    jitter_rng = generator(scenario.seed, name, "jitter")
    roll, pitch, heading = np.deg2rad(model.mounting_deg)
    C_bs = C_from_euler(roll, pitch, heading)
    frames = _Frames(model)
    clock = ImuClock(scenario, name, registry.lookup(model.codec).counting, model.rate_hz)
    total = int(scenario.duration_s * model.rate_hz)
    block = max(1, int(block_s * model.rate_hz))
    left = 0.0
    for first in range(0, total, block):
        k = np.arange(first, min(first + block, total))
        t_end = np.asarray((k + 1) * dt, dtype=np.float64)
        sensed = increments(trajectory, t_end, dt).reshape(-1, 2, 3) @ C_bs
        sensed = sensed.reshape(-1, 6) + errors.next(k.size)
        delay = 1e-3 * (
            model.clock.latency_ms + model.jitter_ms * jitter_rng.exponential(size=k.size)
        )
        leaves = np.maximum.accumulate(np.maximum(t_end + delay, left))
        left = float(leaves[-1])
        numbers, times = clock.tell(t_end)
        for number, t, t_out, row in zip(
            numbers, times, leaves.tolist(), sensed.tolist(), strict=True
        ):
            yield Emission(t_out, name, frames.encode(number, t, row))


class _Frames:
    """Samples as bytes in the device's own format."""

    def __init__(self, model: ImuModel) -> None:
        self._codec = registry.lookup(model.codec)
        self._options = codec_options(model)
        self._temperature = model.temperature_c
        self._rate_hz = model.rate_hz

    def encode(self, number: int, t: float, row: list[float]) -> bytes:
        """One frame; the record says every form of the sample, the codec's options choose one."""
        x, y, z, u, v, w = row
        hz = self._rate_hz
        record = ImuRecord(
            t_rx_ns=0,
            sequence=number,
            t_device_s=t,
            delta_angle_rad=(x, y, z),
            rate_rad_s=(hz * x, hz * y, hz * z),
            delta_velocity_m_s=(u, v, w),
            specific_force_m_s2=(hz * u, hz * v, hz * w),
            temperature_c=self._temperature,
        )
        return self._codec.encode(record, self._options)


def _given(model: ImuModel, drawn: Array) -> Array:
    """Biases the scenario states, else the drawn ones; (6,) rad/s and m/s^2."""
    gyro, accel = model.errors.gyro_bias_deg_h, model.errors.accel_bias_ug
    return np.concatenate(
        [
            drawn[:3] if gyro is None else np.array(gyro) * _DEG_H,
            drawn[3:] if accel is None else np.array(accel) * _UG,
        ]
    )
