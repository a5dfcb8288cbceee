"""Fixes as an instrument with an attitude and a place of its own says them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gateway.emulator.acoustics.array import Fixes, direction
from gateway.emulator.scenario import Scenario, UsblModel
from gateway.emulator.streams import Draws
from gateway.emulator.trajectory import Geodetic, Trajectory
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sightings:
    """Where each beacon is, in the axes of the model.

    ``xyz`` (n, 3) m, ``bearing`` and ``elevation`` (n,) rad; or, of a place on the Earth, ``place``
    (n, 3): latitude, longitude (rad) and depth below the surface (m).
    """

    bearing: Array
    elevation: Array
    xyz: Array
    place: Array | None = None


def sightings(
    scenario: Scenario, draws: Draws, model: UsblModel, trajectory: Trajectory, fixes: Fixes
) -> Sightings:
    """The fixes in the model's axes, turned by the attitude at the moment of the reply."""
    xyz_u = fixes.slant_range[:, None] * direction(fixes.bearing, fixes.elevation)
    if model.axes == "array":
        return Sightings(fixes.bearing, fixes.elevation, xyz_u)
    C_bu = C_from_euler(*np.deg2rad(model.mounting_deg))
    C_nu = _own_attitude(draws, model, trajectory.geodetic(fixes.t_rx)) @ C_bu
    xyz = np.einsum("nij,nj->ni", C_nu, xyz_u)
    if model.axes == "level":
        heading = np.arctan2(C_nu[:, 1, 0], C_nu[:, 0, 0])
        xyz = np.einsum("nji,nj->ni", C_from_euler(0.0, 0.0, heading), xyz)
    x, y, z = np.moveaxis(xyz, -1, 0)
    polar = np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))
    if model.axes == "earth":
        return Sightings(*polar, xyz, _on_earth(scenario, draws, model, trajectory, fixes, xyz))
    return Sightings(*polar, xyz)


def _own_attitude(draws: Draws, model: UsblModel, truth: Geodetic) -> Array:
    """``C_nb`` as the instrument's motion sensor has it, (n, 3, 3)."""
    sigma = np.array([model.noise.tilt_deg, model.noise.tilt_deg, model.noise.heading_deg])
    white = draws("own attitude").standard_normal((truth.roll.size, 3))
    turn_n = Rotation.from_rotvec(np.deg2rad(np.array(model.errors.attitude_deg) + sigma * white))
    told: Array = turn_n.as_matrix() @ C_from_euler(truth.roll, truth.pitch, truth.heading)
    return told


def _on_earth(
    scenario: Scenario,
    draws: Draws,
    model: UsblModel,
    trajectory: Trajectory,
    fixes: Fixes,
    xyz_n: Array,
) -> Array:
    """Latitude, longitude and depth of the beacons by the place that the instrument knows."""
    pose = trajectory.pose(fixes.t_rx)
    r_e = pose.r_e + pose.C_eb @ np.array(model.lever_arm_m)
    lat, lon, _ = earth.ecef_to_lla(r_e)
    white = draws("own place").standard_normal(xyz_n.shape)
    error_n = np.array(model.place.offset_m) + np.array(model.place.noise_m) * white
    b_e = r_e + np.einsum("nij,nj->ni", earth.C_en(lat, lon), error_n + xyz_n)
    lat, lon, h = earth.ecef_to_lla(b_e)
    return np.stack([lat, lon, scenario.surface_height_m - h], axis=-1)
