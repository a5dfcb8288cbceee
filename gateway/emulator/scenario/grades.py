"""Classes of inertial units: published figures under one name; sources are in docs/emulator.md."""

from typing import Literal

from gateway.config.block import Block, NonNegative, Positive
from gateway.config.devices import ImuNoise

Grade = Literal["navigation_fog", "tactical_fog", "mems"]


class Sheet(Block, frozen=True):
    """An inertial unit's data sheet.

    1-sigma of the constant errors of each axis: scale in parts per million, misalignment of an axis
    towards each of the other two in urad. What is beyond a range (deg/s, g) saturates.
    """

    noise: ImuNoise
    gyro_scale_ppm: NonNegative = 0.0
    accel_scale_ppm: NonNegative = 0.0
    gyro_misalignment_urad: NonNegative = 0.0
    accel_misalignment_urad: NonNegative = 0.0
    gyro_range_deg_s: Positive | None = None
    accel_range_g: Positive | None = None


GRADES: dict[Grade, Sheet] = {
    "navigation_fog": Sheet(
        noise=ImuNoise(
            angle_random_walk_deg_sqrt_h=0.005,
            gyro_bias_deg_h=0.02,
            velocity_random_walk_ug_sqrt_hz=20.0,
            accel_bias_ug=100.0,
        ),
        gyro_scale_ppm=10.0,
        accel_scale_ppm=50.0,
        gyro_misalignment_urad=20.0,
        accel_misalignment_urad=20.0,
        gyro_range_deg_s=200.0,
        accel_range_g=10.0,
    ),
    "tactical_fog": Sheet(
        noise=ImuNoise(
            angle_random_walk_deg_sqrt_h=0.1,
            gyro_bias_deg_h=0.75,
            velocity_random_walk_ug_sqrt_hz=51.0,
            accel_bias_ug=1000.0,
        ),
        gyro_scale_ppm=100.0,
        accel_scale_ppm=300.0,
        gyro_misalignment_urad=200.0,
        accel_misalignment_urad=200.0,
        gyro_range_deg_s=450.0,
        accel_range_g=5.0,
    ),
    "mems": Sheet(
        noise=ImuNoise(
            angle_random_walk_deg_sqrt_h=0.15,
            gyro_bias_deg_h=10.0,
            velocity_random_walk_ug_sqrt_hz=102.0,
            accel_bias_ug=750.0,
            gyro_bias_correlation_s=3600.0,
            accel_bias_correlation_s=3600.0,
        ),
        gyro_scale_ppm=500.0,
        accel_scale_ppm=300.0,
        gyro_misalignment_urad=1000.0,
        accel_misalignment_urad=1000.0,
        gyro_range_deg_s=400.0,
        accel_range_g=10.0,
    ),
}
