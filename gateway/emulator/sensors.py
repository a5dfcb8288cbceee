"""The inertial sensor: exact increments of the true motion, and what its errors make of them.

A strapped-down integrating IMU gives, for each interval, the integrals of angular rate and specific
force in its own rotating axes; they are computed here by Gauss-Legendre quadrature of the analytic
motion, without any strapdown.
"""

import numpy as np
from numpy.typing import NDArray

from gateway.emulator.scenario import ImuModel
from gateway.emulator.streams import generator
from gateway.emulator.trajectory import Trajectory

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
        noise = model.sheet.noise
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


class ImuSensor:
    """From exact increments to an IMU's: scale and axes, bias and noise, range, quanta."""

    def __init__(self, model: ImuModel, seed: int, name: str) -> None:
        self._errors = ImuErrorSource(model, seed, name)
        self._sensing = sensing_matrices(model, seed, name)
        dt, sheet, quanta = 1.0 / model.rate_hz, model.sheet, model.errors
        self._most = np.repeat(
            [
                np.deg2rad(sheet.gyro_range_deg_s or np.inf) * dt,
                (sheet.accel_range_g or np.inf) * STANDARD_GRAVITY * dt,
            ],
            3,
        )
        self._quantum = np.repeat(
            [1e-6 * (quanta.angle_quantum_urad or 0), 1e-6 * (quanta.velocity_quantum_um_s or 0)], 3
        )
        self._sum = np.zeros(6)

    def sense(self, exact: Array) -> tuple[Array, NDArray[np.bool_]]:
        """What the unit makes of the next exact increments in its nominal axes.

        Parameters
        ----------
        exact
            (n, 6) rad and m/s.

        Returns
        -------
        increments
            (n, 6) rad and m/s.
        within
            (n,) whether no axis was beyond its range.
        """
        sensed = np.einsum("aij,naj->nai", self._sensing, exact.reshape(-1, 2, 3)).reshape(-1, 6)
        sensed += self._errors.next(len(exact))
        within = np.all(np.abs(sensed) <= self._most, axis=1)
        return self._counted(np.clip(sensed, -self._most, self._most)), within

    def _counted(self, sensed: Array) -> Array:
        """In whole quanta, the rest of each sample kept for the next."""
        counts = self._quantum > 0.0
        if not counts.any():
            return sensed
        sums = np.cumsum(np.vstack([self._sum, sensed]), axis=0)
        self._sum = sums[-1]
        steps = np.diff(np.rint(sums[:, counts] / self._quantum[counts]), axis=0)
        sensed[:, counts] = steps * self._quantum[counts]
        return sensed


def sensing_matrices(model: ImuModel, seed: int, name: str) -> Array:
    """(2, 3, 3): what gyros and accelerometers make of a vector in nominal axes, without bias."""
    scale = generator(seed, name, "scale").standard_normal((2, 3))
    axes = generator(seed, name, "misalignment").standard_normal((2, 6))
    sheet, given = model.sheet, model.errors
    drawn = (
        (given.gyro_scale_ppm, sheet.gyro_scale_ppm * scale[0]),
        (given.accel_scale_ppm, sheet.accel_scale_ppm * scale[1]),
        (given.gyro_misalignment_urad, sheet.gyro_misalignment_urad * axes[0]),
        (given.accel_misalignment_urad, sheet.accel_misalignment_urad * axes[1]),
    )
    parts = [1e-6 * np.array(other if said is None else said) for said, other in drawn]
    matrices = np.zeros((2, 3, 3))
    for matrix, on_axis, across in zip(matrices, parts[:2], parts[2:], strict=True):
        np.fill_diagonal(matrix, 1.0 + on_axis)
        matrix[~np.eye(3, dtype=np.bool_)] = across
    return matrices


def _given(model: ImuModel, drawn: Array) -> Array:
    """Biases the scenario states, else the drawn ones; (6,) rad/s and m/s^2."""
    gyro, accel = model.errors.gyro_bias_deg_h, model.errors.accel_bias_ug
    return np.concatenate(
        [
            drawn[:3] if gyro is None else np.array(gyro) * _DEG_H,
            drawn[3:] if accel is None else np.array(accel) * _UG,
        ]
    )
